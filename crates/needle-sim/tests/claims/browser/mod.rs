//! Pages in a real browser: Chromium opens a copy of the page with two scripts more, one that listens for errors and requests from the
//! start, one that examines the page and writes what it found.

// That a test was skipped must be seen.
#![allow(clippy::print_stderr)]

use std::fs::File;
use std::process::{Command, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// The first browser of these that starts; CHROMIUM names another.
static BROWSER: LazyLock<Option<String>> = LazyLock::new(|| {
    let named = std::env::var("CHROMIUM").ok();
    let known = ["chromium", "chromium-browser", "google-chrome"].map(String::from);
    named.into_iter().chain(known).find(|program| {
        let version = Command::new(program)
            .arg("--version")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        version.is_ok_and(|status| status.success())
    })
});

/// True, and said, where there is no browser.
pub(crate) fn has_none() -> bool {
    let none = BROWSER.is_none();
    if none {
        eprintln!("skipped: no Chromium; set CHROMIUM to its program");
    }
    none
}

/// What `script`, which defines an asynchronous function `examine`, finds on the page, with all errors and requests.
pub(crate) fn examine(page: &str, script: &str, window: &str) -> serde_json::Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("page.html");
    std::fs::write(&path, instrumented(page, script)).unwrap();
    let dump = folder.path().join("dump.html");
    let mut browser = Command::new(BROWSER.as_ref().unwrap())
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-background-networking",
            "--no-first-run",
        ])
        // WebGL in software; a graphics card is not for tests.
        .args([
            "--enable-unsafe-swiftshader",
            "--virtual-time-budget=20000",
            "--dump-dom",
        ])
        .arg(format!("--window-size={window}"))
        .arg(format!(
            "--user-data-dir={}",
            folder.path().join("profile").display()
        ))
        .arg(format!("file://{}", path.display()))
        .stdout(File::create(&dump).unwrap())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // Many times what it takes on a busy machine.
    let deadline = Instant::now() + Duration::from_secs(180);
    while browser.try_wait().unwrap().is_none() {
        if Instant::now() > deadline {
            browser.kill().unwrap();
            panic!("the browser did not answer");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let dump = std::fs::read_to_string(dump).unwrap();
    let found = dump.rsplit_once("<pre id=\"findings\">").unwrap().1;
    serde_json::from_str(found.split_once("</pre>").unwrap().0).unwrap()
}

fn instrumented(page: &str, script: &str) -> String {
    let (start, rest) = page.split_once("<head>").unwrap();
    let (rest, end) = rest.rsplit_once("</body>").unwrap();
    let (listen, report) = (include_str!("listen.js"), include_str!("report.js"));
    format!(
        "{start}<head><script>{listen}</script>{rest}<script>{script}{report}</script></body>{end}"
    )
}
