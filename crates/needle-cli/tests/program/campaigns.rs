//! Campaigns as a user meets them: threads, shards, kills, full disks, changed files.

use super::{folder, needle, text};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

/// Two controllers without a solver on a short path: 240 runs in 24 chunks, about a millisecond a run.
const CAMPAIGN: &str = r#"
scenario = "scenario.toml"
seed = 11
runs_per_cell = 60
chunk_runs = 10
track_every = 5

[grid]
controller.name = ["feed_forward", "sliding_mode"]
plant.curvature_factor = [0.9, 1.1]

[random]
"needle.curvature_per_mm" = { distribution = "uniform", from = 0.002, to = 0.02 }
"plant.bevel_offset_mm" = { distribution = "normal", mean = 1.5, std = 1.0 }
"plant.start.offset_std_mm" = { distribution = "log_uniform", from = 0.1, to = 1.0 }
"limits.omega_max_rad_s" = { distribution = "uniform", from = 500, to = 1000, times = "needle.curvature_per_mm" }
"#;

const SCENARIO: &str = r#"
[needle]
curvature_per_mm = 0.006
[reference]
kind = "inputs"
curvature_factor = 0.5
segments = [{ duration_s = 4.0, v_mm_s = 5.0, omega_rad_s = 0.05 }]
[controller]
name = "feed_forward"
[plant.disturbances]
heading_std_rad_per_sqrt_mm = 0.001
"#;

/// What must not depend on threads, shards and interruptions.
const EQUAL: [&str; 2] = ["runs.parquet", "tracks.parquet"];

pub(super) fn campaign_in(folder: &Path) {
    fs::write(folder.join("campaign.toml"), CAMPAIGN).unwrap();
    fs::write(folder.join("scenario.toml"), SCENARIO).unwrap();
}

pub(super) fn done(arguments: &[&str], folder: &Path) -> String {
    let output = needle(arguments, folder);
    let words = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {words}");
    text(&output.stdout)
}

fn merged(folder: &Path) -> Vec<Vec<u8>> {
    EQUAL
        .map(|name| fs::read(folder.join(name)).unwrap())
        .to_vec()
}

/// The uninterrupted result on one thread.
fn truth(folder: &Path) -> Vec<Vec<u8>> {
    campaign_in(folder);
    let arguments = [
        "campaign",
        "campaign.toml",
        "--out",
        "truth",
        "--threads",
        "1",
    ];
    done(&arguments, folder);
    merged(&folder.join("truth"))
}

/// Names of finished chunks with their time of writing.
fn parts(folder: &Path) -> BTreeMap<String, SystemTime> {
    let entries = fs::read_dir(folder.join("parts")).into_iter().flatten();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    // Others are being written, and may have got their name or gone by the next look.
    let finished = names.filter(|name| name.starts_with("part-"));
    finished
        .map(|name| {
            let metadata = fs::metadata(folder.join("parts").join(&name)).unwrap();
            (name, metadata.modified().unwrap())
        })
        .collect()
}

fn started(folder: &Path, out: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_needle"))
        .args(["campaign", "campaign.toml", "--threads", "2", "--out", out])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits until `count` chunks are there, for at most 20 s: a machine under load is slow, not wrong.
fn await_parts(folder: &Path, count: usize) {
    let begun = Instant::now();
    while parts(folder).len() < count && begun.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn threads_shards_and_folders_do_not_change_a_byte() {
    let folder = folder();
    let folder = folder.path();
    let truth = truth(folder);
    done(
        &[
            "campaign",
            "campaign.toml",
            "--out",
            "two",
            "--threads",
            "2",
        ],
        folder,
    );
    assert!(merged(&folder.join("two")) == truth, "two threads");
    // Some draws are refused: the reason does not depend on where the campaign is called from.
    let file = folder.join("campaign.toml");
    let file = file.to_str().unwrap();
    done(&["campaign", file, "--out", "absolute"], folder);
    assert!(merged(&folder.join("absolute")) == truth, "absolute name");
    for shard in ["3/3", "1/3", "2/3"] {
        let arguments = [
            "campaign",
            "campaign.toml",
            "--out",
            "shards",
            "--shard",
            shard,
        ];
        assert_eq!(done(&arguments, folder), "", "{shard}");
    }
    done(&["merge", "shards"], folder);
    assert!(merged(&folder.join("shards")) == truth, "shards");
    for (shard, out) in [("1/2", "here"), ("2/2", "there")] {
        let arguments = ["campaign", "campaign.toml", "--out", out, "--shard", shard];
        done(&arguments, folder);
    }
    let alone = needle(&["merge", "here"], folder);
    assert_eq!(alone.status.code(), Some(1));
    assert!(text(&alone.stderr).contains("12 of 24 chunks are missing"));
    done(&["merge", "here", "there"], folder);
    assert!(merged(&folder.join("here")) == truth, "folders");
}

#[test]
fn killed_ten_times_a_campaign_ends_in_the_same_bytes_without_repeating_a_chunk() {
    let folder = folder();
    let folder = folder.path();
    let truth = truth(folder);
    let out = folder.join("out");
    let mut known = BTreeMap::new();
    for kill in 0..10 {
        let mut child = started(folder, "out");
        // Some kills come at once, some in the middle of a chunk, some as a file is written.
        await_parts(&out, known.len() + kill % 3);
        std::thread::sleep(Duration::from_micros(700 * kill as u64));
        child.kill().unwrap();
        child.wait().unwrap();
        let now = parts(&out);
        for (name, written) in &known {
            assert_eq!(now.get(name), Some(written), "{name} was written again");
        }
        known = now;
    }
    assert!(!known.is_empty());
    done(&["campaign", "campaign.toml", "--out", "out"], folder);
    let end = parts(&out);
    assert!(
        known
            .iter()
            .all(|(name, written)| end.get(name) == Some(written))
    );
    assert!(merged(&out) == truth);
    // Nor do half-written files stay: 24 chunks, each with runs and tracks.
    assert_eq!(fs::read_dir(out.join("parts")).unwrap().count(), 48);
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_complete_chunks_and_says_how_to_go_on() {
    let folder = folder();
    let folder = folder.path();
    let truth = truth(folder);
    let child = Command::new(env!("CARGO_BIN_EXE_needle"))
        .args([
            "campaign",
            "campaign.toml",
            "--threads",
            "1",
            "--out",
            "out",
        ])
        .current_dir(folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    await_parts(&folder.join("out"), 2);
    let id = child.id().to_string();
    Command::new("kill").args(["-INT", &id]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    // A machine that finishes 22 chunks before the signal arrives has nothing to interrupt.
    if output.status.code() != Some(0) {
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        assert!(text(&output.stderr).contains("the same command goes on from there"));
        assert!(!folder.join("out/runs.parquet").exists());
        let entries = fs::read_dir(folder.join("out/parts")).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        assert!(names.into_iter().all(|name| !name.starts_with(".tmp")));
    }
    done(&["campaign", "campaign.toml", "--out", "out"], folder);
    assert!(merged(&folder.join("out")) == truth);
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_an_error_without_half_a_file_and_no_end_of_the_campaign() {
    let folder = folder();
    let folder = folder.path();
    let truth = truth(folder);
    // Files may have a kilobyte or two: the manifest fits, no chunk does. The signal of a file that grows too large is ignored, so that
    // writing fails as on a full disk.
    for blocks in ["1", "4", "16"] {
        let script = format!(
            "trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" campaign campaign.toml --out full"
        );
        let output = Command::new("bash")
            .args(["-c", &script, env!("CARGO_BIN_EXE_needle")])
            .current_dir(folder)
            .output()
            .unwrap();
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{blocks}: {words}");
        assert!(words.starts_with("error: cannot write full/"), "{words}");
        assert_eq!(text(&output.stdout), "");
        assert!(!folder.join("full/runs.parquet").exists());
        let leftovers = fs::read_dir(folder.join("full")).unwrap();
        let leftovers = leftovers.map(|entry| entry.unwrap().file_name());
        assert!(
            leftovers
                .into_iter()
                .all(|name| !name.to_string_lossy().starts_with(".tmp"))
        );
    }
    done(&["campaign", "campaign.toml", "--out", "full"], folder);
    assert!(merged(&folder.join("full")) == truth);
}

#[test]
fn a_place_that_takes_no_files_is_an_error_that_names_it() {
    let folder = folder();
    campaign_in(folder.path());
    for out in ["scenario.toml/results", "/proc/results"] {
        let output = needle(&["campaign", "campaign.toml", "--out", out], folder.path());
        assert_eq!(output.status.code(), Some(1), "{out}");
        let words = text(&output.stderr);
        assert!(words.contains(out), "{words}");
    }
    fs::write(folder.path().join("bare"), CAMPAIGN).unwrap();
    let bare = needle(&["campaign", "bare"], folder.path());
    assert_eq!(bare.status.code(), Some(2));
    assert!(text(&bare.stderr).contains("give --out"));
}

#[test]
fn results_of_a_campaign_that_has_changed_are_not_mixed() {
    let folder = folder();
    let folder = folder.path();
    truth(folder);
    for (file, changed) in [
        ("campaign.toml", CAMPAIGN.replace("seed = 11", "seed = 12")),
        ("scenario.toml", SCENARIO.replace("0.001", "0.002")),
    ] {
        let before = fs::read_to_string(folder.join(file)).unwrap();
        fs::write(folder.join(file), changed).unwrap();
        let output = needle(&["campaign", "campaign.toml", "--out", "truth"], folder);
        assert_eq!(output.status.code(), Some(2), "{file}");
        assert!(text(&output.stderr).contains("holds results of another campaign"));
        fs::write(folder.join(file), before).unwrap();
    }
    done(&["campaign", "campaign.toml", "--out", "truth"], folder);
}

#[test]
fn a_damaged_chunk_is_named_and_not_merged() {
    let folder = folder();
    let folder = folder.path();
    let truth = truth(folder);
    let part = folder.join("truth/parts/part-000007.parquet");
    let whole = fs::read(&part).unwrap();
    fs::write(&part, &whole[..whole.len() / 2]).unwrap();
    let output = needle(&["merge", "truth"], folder);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("part-000007.parquet is damaged"));
    fs::copy(folder.join("truth/parts/part-000008.parquet"), &part).unwrap();
    let output = needle(&["merge", "truth"], folder);
    assert!(text(&output.stderr).contains("where runs 70 to 79 is expected"));
    fs::remove_file(&part).unwrap();
    done(&["campaign", "campaign.toml", "--out", "truth"], folder);
    assert!(merged(&folder.join("truth")) == truth);
}

#[test]
fn faults_of_a_campaign_file_come_with_file_line_and_key() {
    let folder = folder();
    fs::write(folder.path().join("scenario.toml"), SCENARIO).unwrap();
    let head = "scenario = \"scenario.toml\"\n";
    for (body, expected) in [
        (
            "sed = 3",
            "wrong.toml:2: sed: unknown key; known here: scenario, seed",
        ),
        (
            "runs_per_cell = 0",
            "wrong.toml:2: runs_per_cell: expected a whole number from 1",
        ),
        (
            "[grid]\nplant.curvature_factr = [1.0]",
            "wrong.toml:3: plant.curvature_factr: unknown key",
        ),
        (
            "[grid]\ncontroller.name = [\"lqr\", \"lqg\"]",
            "wrong.toml:3: controller.name: expected one of",
        ),
        (
            "[grid]\ndt_s = []",
            "wrong.toml:3: dt_s: expected a list of values",
        ),
        (
            "[grid]\ndt_s = { from = 0.1, to = 0.2 }",
            "wrong.toml:3: dt_s.steps: missing",
        ),
        (
            "[random]\nseed = { distribution = \"normal\", mean = 0, std = 1 }",
            "wrong.toml:3: seed: the campaign's own seed",
        ),
        (
            "[random]\ndt_s = { distribution = \"cauchy\", from = 0, to = 1 }",
            "wrong.toml:3: dt_s.distribution: expected uniform",
        ),
        (
            "[random]\ndt_s = { distribution = \"uniform\", from = 2, to = 1 }",
            "wrong.toml:3: dt_s: expected `from` not above `to`",
        ),
        (
            "[random]\ndt_s = { distribution = \"uniform\", from = -1, to = 1 }",
            "wrong.toml:3: dt_s: expected a number from 0.001 to 10, found -1",
        ),
        (
            "[random]\ndt_s = { distribution = \"uniform\", from = nan, to = 1 }",
            "wrong.toml:3: dt_s.from: expected a finite number",
        ),
        (
            "[grid]\ndt_s = [0.1]\n[random]\ndt_s = { distribution = \"choice\", values = [0.1] }",
            "wrong.toml:5: dt_s: is varied already",
        ),
        ("[grid]\ndt_s = [", "wrong.toml:3: not TOML"),
    ] {
        fs::write(folder.path().join("wrong.toml"), format!("{head}{body}\n")).unwrap();
        let output = needle(&["campaign", "wrong.toml"], folder.path());
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{body}: {words}");
        assert!(words.contains(expected), "{body}: {words}");
        assert!(!folder.path().join("wrong").exists(), "{body}");
    }
}

#[test]
fn a_run_of_a_campaign_can_be_repeated_alone() {
    let folder = folder();
    let folder = folder.path();
    truth(folder);
    // Run 130: the third cell, trial 10.
    let scenario = done(&["campaign", "campaign.toml", "--print-run", "130"], folder);
    fs::write(folder.join("run.toml"), &scenario).unwrap();
    assert!(scenario.starts_with("# Run 130: trial 10 of cell 2."));
    let alone = needle(&["run", "run.toml", "--index", "10", "--json"], folder);
    let alone: serde_json::Value = serde_json::from_slice(&alone.stdout).unwrap();
    assert_eq!(alone["seed"], 11);
    // With two trials a cell their summary's extremes are the two rows: runs 4 and 5 are the third cell's.
    let two = CAMPAIGN.replace("runs_per_cell = 60", "runs_per_cell = 2");
    fs::write(folder.join("two.toml"), two).unwrap();
    let rows = done(&["campaign", "two.toml", "--json"], folder);
    let rows: serde_json::Value = serde_json::from_str(&rows).unwrap();
    let cell = &rows["cells"][2];
    let alone = |run: &str, trial: &str| -> serde_json::Value {
        let scenario = done(&["campaign", "two.toml", "--print-run", run], folder);
        fs::write(folder.join("run.toml"), scenario).unwrap();
        let words = done(&["run", "run.toml", "--index", trial, "--json"], folder);
        serde_json::from_str(&words).unwrap()
    };
    let (first, second) = (alone("4", "0"), alone("5", "1"));
    for figure in ["rms_mm", "rotation_rev", "final_mm"] {
        let number = |run: &serde_json::Value| run[figure].as_f64().unwrap();
        let (a, b) = (number(&first), number(&second));
        let mean = cell[figure]["mean"]["value"].as_f64().unwrap();
        assert_eq!(
            cell[figure]["worst"].as_f64().unwrap(),
            a.max(b),
            "{figure}"
        );
        // Rounding of a sum of two.
        assert!((mean - (a + b) / 2.0).abs() <= 1e-14 * mean, "{figure}");
    }
    let steps = |run: &serde_json::Value| run["steps"].as_u64().unwrap();
    assert_eq!(cell["steps"], steps(&first) + steps(&second));
    let none = needle(&["campaign", "campaign.toml", "--print-run", "240"], folder);
    assert_eq!(none.status.code(), Some(2));
    assert!(text(&none.stderr).contains("runs 0 to 239"));
}

#[test]
fn a_summary_as_json_has_intervals_and_causes() {
    let folder = folder();
    campaign_in(folder.path());
    let words = done(&["campaign", "campaign.toml", "--json"], folder.path());
    let summary: serde_json::Value = serde_json::from_str(&words).unwrap();
    assert_eq!(summary["runs"], 240);
    let cells = summary["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 4);
    for cell in cells {
        let (low, high) = (&cell["success"]["low"], &cell["success"]["high"]);
        assert!(low.as_f64().unwrap() < high.as_f64().unwrap());
        assert_eq!(cell["success"]["of"], 60);
        assert!(cell["rms_mm"]["mean"]["low"].is_number());
        assert_eq!(cell["fallbacks"]["no_plan"]["runs"], 0);
    }
    // Without rotation nothing turns less: one of the feed-forward cells is on the front.
    assert!(cells.iter().any(|cell| cell["pareto"] == true));
    assert_eq!(cells[0]["settings"][0]["value"], "feed_forward");
}

/// What the merged file says, as another implementation of Parquet reads it.
#[test]
fn a_foreign_reader_opens_the_result_and_finds_the_same_means() {
    let folder = folder();
    campaign_in(folder.path());
    done(&["campaign", "campaign.toml"], folder.path());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/program/read_parquet.py");
    let venv = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/foreign-reader/bin/python");
    let python = if venv.exists() {
        venv
    } else {
        "python3".into()
    };
    let output = Command::new(&python)
        .args([script, "campaign"])
        .current_dir(folder.path())
        .output();
    // The script's code for a reader that is not installed; without Python there is none either.
    match output {
        Ok(output) if output.status.code() != Some(77) => {
            assert!(output.status.success(), "{}", text(&output.stderr));
        }
        _ => say_skipped(
            "no pyarrow, duckdb, polars or pandas: scripts/foreign-reader.sh installs one",
        ),
    }
}

#[test]
fn a_slurm_array_with_a_killed_task_ends_in_the_bytes_of_one_machine() {
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../scripts/slurm-one-node.sh"
    );
    let output = Command::new("bash")
        .args([script, env!("CARGO_BIN_EXE_needle")])
        .output();
    match output {
        Ok(output) if output.status.code() != Some(77) => {
            let words = text(&output.stdout) + &text(&output.stderr);
            assert!(output.status.success(), "{words}");
        }
        _ => say_skipped("no Slurm on this machine: docs/cluster.md names the packages"),
    }
}

/// A line that passes the test harness, which keeps the output of a test that passes to itself.
#[allow(clippy::print_stderr)]
fn say_skipped(why: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}
