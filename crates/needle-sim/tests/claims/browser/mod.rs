//! Pages in a real browser: Chromium opens a copy of the page with two scripts more, one that listens for errors and requests from the
//! start, one that examines the page and writes what it found.

// That a test was skipped must be seen.
#![allow(clippy::print_stderr)]

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::LazyLock;
use std::thread;
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
pub(crate) fn examine(page: &str, script: &str, window: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("page.html");
    std::fs::write(&path, instrumented(page, script)).unwrap();
    let mut browser = Browser::start(folder.path(), window);
    let url = format!("file://{}", path.display());
    let target = browser.call(None, "Target.createTarget", json!({ "url": url }));
    let attach = json!({ "targetId": target["targetId"], "flatten": true });
    let attached = browser.call(None, "Target.attachToTarget", attach);
    let session = attached["sessionId"].as_str().unwrap();
    let read = json!({ "expression": "document.getElementById('findings')?.textContent" });
    // Many times what it takes on a busy machine.
    let deadline = Instant::now() + Duration::from_secs(180);
    loop {
        let answer = browser.call(Some(session), "Runtime.evaluate", read.clone());
        if let Some(found) = answer["result"]["value"].as_str() {
            return serde_json::from_str(found).unwrap();
        }
        assert!(Instant::now() < deadline, "the browser did not answer");
        thread::sleep(Duration::from_millis(50));
    }
}

/// A browser that takes the commands of its debugging protocol from a pipe, each closed by a zero byte. Its clock is the real one: under
/// a virtual clock, time passes on a busy machine before anything is drawn.
struct Browser {
    process: Child,
    commands: ChildStdin,
    answers: BufReader<ChildStdout>,
    sent: u64,
}

impl Browser {
    fn start(folder: &Path, window: &str) -> Self {
        let profile = folder.join("profile");
        // The protocol's pipes are descriptors 3 and 4.
        let mut process = Command::new("sh")
            .args(["-c", r#"exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null"#])
            .arg(BROWSER.as_ref().unwrap())
            .args(["--headless", "--no-sandbox", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-gpu"])
            // WebGL in software; a graphics card is not for tests.
            .args(["--enable-unsafe-swiftshader", "--remote-debugging-pipe"])
            .arg(format!("--window-size={window}"))
            .arg(format!("--user-data-dir={}", profile.display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self {
            commands: process.stdin.take().unwrap(),
            answers: BufReader::new(process.stdout.take().unwrap()),
            process,
            sent: 0,
        }
    }

    /// The result of one command, to the browser or to a page's session.
    fn call(&mut self, session: Option<&str>, method: &str, params: Value) -> Value {
        self.sent += 1;
        let mut command = json!({ "id": self.sent, "method": method, "params": params });
        if let Some(session) = session {
            command["sessionId"] = session.into();
        }
        write!(self.commands, "{command}\0").unwrap();
        loop {
            let mut answer = Vec::new();
            let read = self.answers.read_until(0, &mut answer).unwrap();
            assert!(read > 0, "the browser ended");
            let answer: Value = serde_json::from_slice(&answer[..read - 1]).unwrap();
            // Events come between.
            if answer["id"] == self.sent {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Told to close, it takes its own processes with it; it writes to the folder that the test removes next.
        let close = json!({ "id": 0, "method": "Browser.close" });
        if write!(self.commands, "{close}\0").is_err() || thread::panicking() {
            self.process.kill().ok();
        }
        self.process.wait().ok();
    }
}

fn instrumented(page: &str, script: &str) -> String {
    let (start, rest) = page.split_once("<head>").unwrap();
    let (rest, end) = rest.rsplit_once("</body>").unwrap();
    let (listen, report) = (include_str!("listen.js"), include_str!("report.js"));
    format!(
        "{start}<head><script>{listen}</script>{rest}<script>{script}{report}</script></body>{end}"
    )
}
