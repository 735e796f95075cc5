//! The built program as a user meets it: results, words, files, exit codes.

// What a test's own functions cannot unwrap fails the test.
#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "program/campaigns.rs"]
mod campaigns;
#[path = "program/reports.rs"]
mod reports;

use std::path::Path;
use std::process::{Command, Output};

fn needle(arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle"));
    command
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

#[test]
fn a_preset_runs_and_answers_on_standard_output_alone() {
    let folder = folder();
    let output = needle(&["run", "paper"], folder.path());
    assert_eq!(output.status.code(), Some(0));
    assert!(
        text(&output.stdout).starts_with("run 0 of seed 1: nmpc, 60 samples, finished, success\n")
    );
    assert_eq!(text(&output.stderr), "");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_run_leaves_the_files_that_are_asked_for_and_no_other() {
    let folder = folder();
    let arguments = [
        "run", "paper", "--track", "t.csv", "--record", "r.json", "--json",
    ];
    let output = needle(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["steps"], 60);
    let track = std::fs::read_to_string(folder.path().join("t.csv")).unwrap();
    let widths: Vec<usize> = track.lines().map(|line| line.split(',').count()).collect();
    assert_eq!(widths, vec![21; 61]);
    let record = std::fs::read(folder.path().join("r.json")).unwrap();
    let record: needle_sim::RunRecord = serde_json::from_slice(&record).unwrap();
    assert_eq!(record.steps.len(), 60);
    assert!(needle_sim::Scenario::parse(&record.scenario_toml).is_ok());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn keys_are_set_from_outside() {
    let folder = folder();
    let arguments = [
        "run",
        "paper",
        "--set",
        "controller.name=feed_forward",
        "--set",
        "controller.horizon=8",
    ];
    let output = needle(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("controller.horizon: unknown key; known here: name"));
}

#[test]
fn every_preset_printed_is_a_file_that_runs() {
    let folder = folder();
    for name in ["paper", "clinical", "phantom"] {
        let printed = needle(&["schema", "--preset", name], folder.path());
        std::fs::write(folder.path().join("my.toml"), printed.stdout).unwrap();
        let output = needle(&["run", "my.toml"], folder.path());
        assert_eq!(
            output.status.code(),
            Some(0),
            "{name}: {}",
            text(&output.stderr)
        );
    }
}

#[test]
fn a_wrong_scenario_is_told_by_file_line_and_key_with_code_2() {
    let folder = folder();
    std::fs::write(
        folder.path().join("wrong.toml"),
        "seed = 1\n\n[limits]\nv_max = 3\n",
    )
    .unwrap();
    let output = needle(&["run", "wrong.toml"], folder.path());
    assert_eq!(output.status.code(), Some(2));
    let words = text(&output.stderr);
    assert!(
        words.contains(
            "wrong.toml:4: limits.v_max: unknown key; known here: v_min_mm_s, v_max_mm_s"
        ),
        "{words}"
    );
    assert!(
        words.contains("wrong.toml: needle.curvature_per_mm: missing"),
        "{words}"
    );
    assert_eq!(text(&output.stdout), "");
}

/// Positions along 60 mm of an arc.
fn arc(radius_mm: f64) -> String {
    let position = |i: i32| {
        let turn_rad = f64::from(i) * 2.0 / radius_mm;
        let (sin, cos) = turn_rad.sin_cos();
        format!("{},0,{}\n", radius_mm * (1.0 - cos), radius_mm * sin)
    };
    (0..=30).fold("x_mm,y_mm,z_mm\n".into(), |text: String, i| {
        text + &position(i)
    })
}

#[test]
fn positions_that_bend_more_than_the_needle_are_told_and_are_no_success() {
    let folder = folder();
    // The needle bends with a radius of 150 mm.
    std::fs::write(folder.path().join("arc.csv"), arc(60.0)).unwrap();
    let scenario = "needle.curvature_per_mm = 0.0066667\ncontroller.name = 'pid'\n\
                    reference.kind = 'positions'\nreference.file = 'arc.csv'\n";
    std::fs::write(folder.path().join("arc.toml"), scenario).unwrap();
    for (command, told) in [("check", "more than the needle can"), ("run", "no success")] {
        let output = needle(&[command, "arc.toml"], folder.path());
        assert_eq!(output.status.code(), Some(3), "{command}");
        let words = text(&output.stdout) + &text(&output.stderr);
        assert!(words.contains(told), "{words}");
    }
}

#[test]
fn sensors_that_no_estimator_reads_are_an_objection() {
    let arguments = ["check", "clinical", "--set", "estimator.kind=perfect"];
    let output = needle(&arguments, folder().path());
    assert_eq!(output.status.code(), Some(3));
    let words = text(&output.stdout);
    assert!(
        words.contains("the controller sees the true pose"),
        "{words}"
    );
}

#[test]
fn another_terminal_choice_takes_the_files_keys_of_the_old_one_along() {
    let folder = folder();
    let scenario = "needle.curvature_per_mm = 0.0066667\n[controller]\nname = 'ltv'\n\
                    terminal = 'periodic'\nperiod = 5\n[reference]\nkind = 'inputs'\n\
                    segments = [{ duration_s = 4.0, v_mm_s = 5.0, omega_rad_s = 1.0 }]\n";
    std::fs::write(folder.path().join("s.toml"), scenario).unwrap();
    let arguments = ["check", "s.toml", "--set", "controller.terminal=none"];
    let output = needle(&arguments, folder.path());
    let words = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{words}");
    assert!(
        words.contains("terminal ingredients of ltv: none"),
        "{words}"
    );
}

#[test]
fn calls_that_mean_nothing_have_code_2() {
    let folder = folder();
    std::fs::write(folder.path().join("arc.csv"), arc(150.0)).unwrap();
    for arguments in [
        &["run"][..],
        &["run", "no-such-file.toml"],
        &["run", "paper", "--set", "seed"],
        &["run", "paper", "--index", "-1"],
        &["compare", "paper"],
        &["schema", "--preset", "none"],
        &["reference", "arc.csv", "--curvature-per-mm=-1"],
        &[
            "reference",
            "arc.csv",
            "--curvature-per-mm=0.01",
            "--speed-mm-s=-1",
        ],
        &[
            "reference",
            "arc.csv",
            "--curvature-per-mm=0.01",
            "--smoothing-mm=nan",
        ],
        &["walk"],
    ] {
        let output = needle(arguments, folder.path());
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        assert_eq!(text(&output.stdout), "", "{arguments:?}");
    }
}

#[test]
fn a_run_without_success_has_code_3() {
    let folder = folder();
    let output = needle(
        &["run", "clinical", "--set", "duration_s=2.0"],
        folder.path(),
    );
    assert_eq!(output.status.code(), Some(3));
    assert!(text(&output.stdout).contains("duration_over, no success"));
}

#[test]
fn a_check_tells_margin_controllability_and_certificate() {
    let folder = folder();
    let helix = "needle.curvature_per_mm = 0.0066666667\ncontroller.name = 'ltv'\nreference.kind = 'inputs'\n\
                 [[reference.segments]]\nduration_s = 10.0\nv_mm_s = 5.0\nomega_rad_s = 0.5\n";
    std::fs::write(folder.path().join("helix.toml"), helix).unwrap();
    let output = needle(&["check", "helix.toml"], folder.path());
    let words = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{words}");
    for part in [
        "50.00 mm in 10.00 s",
        "the needle's own all along",
        "controllable errors: 6 of 6",
        "helix_dare",
        "holds",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    let turned = format!(
        "{helix}[[reference.segments]]\nduration_s = 10.0\nv_mm_s = 5.0\nomega_rad_s = 1.0\n"
    );
    std::fs::write(folder.path().join("turned.toml"), turned).unwrap();
    let words = needle(&["check", "turned.toml"], folder.path());
    let words = text(&words.stdout);
    assert!(words.contains("of 2002 checks"), "{words}");
    assert!(words.lines().count() < 20, "{words}");
    assert!(
        words.contains("refused: helix_dare: the reference's input at step"),
        "{words}"
    );
    let output = needle(
        &[
            "check",
            "clinical",
            "--set",
            "reference.curvature_factor=1.2",
            "--json",
        ],
        folder.path(),
    );
    assert_eq!(output.status.code(), Some(3));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(
        report["objections"][0]
            .as_str()
            .unwrap()
            .contains("the path bends by")
    );
}

#[test]
fn scenarios_are_compared_under_the_same_disturbances() {
    let folder = folder();
    let printed = text(&needle(&["schema", "--preset", "clinical"], folder.path()).stdout);
    let pid = printed.replace("name = \"nmpc\"\nhorizon = 20", "name = \"pid\"");
    std::fs::write(folder.path().join("pid.toml"), pid).unwrap();
    let output = needle(
        &["compare", "clinical", "pid.toml", "--runs", "2"],
        folder.path(),
    );
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    let rows: Vec<Vec<&str>> = table
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert_eq!(rows.len(), 3, "{table}");
    assert_eq!(
        (rows[1][..2].to_vec(), rows[2][..2].to_vec()),
        (vec!["clinical", "nmpc"], vec!["pid.toml", "pid"])
    );
    let json = needle(
        &["compare", "clinical", "clinical", "--json"],
        folder.path(),
    );
    let twice: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(twice[0]["runs"][0]["rms_mm"], twice[1]["runs"][0]["rms_mm"]);
}

#[test]
fn positions_become_a_path_file_that_a_scenario_follows() {
    let folder = folder();
    let row = |i: u32| format!("0.0,{},{}\n", -0.0011 * f64::from(i * i), i);
    let positions = "x_mm,y_mm,z_mm\n".to_owned() + &(0..=60).map(row).collect::<String>();
    std::fs::write(folder.path().join("positions.csv"), positions).unwrap();
    let arguments = [
        "reference",
        "positions.csv",
        "--curvature-per-mm",
        "0.0066666667",
        "-o",
        "path.csv",
    ];
    let output = needle(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("mm RMS"));
    let scenario = "needle.curvature_per_mm = 0.0066666667\ncontroller.name = 'nmpc'\n\
                    reference.kind = 'poses'\nreference.file = 'path.csv'\n";
    std::fs::write(folder.path().join("my.toml"), scenario).unwrap();
    let output = needle(&["run", "my.toml"], folder.path());
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}{}",
        text(&output.stdout),
        text(&output.stderr)
    );
}

#[test]
fn places_that_cannot_be_written_are_named_and_nothing_is_left() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("taken")).unwrap();
    for place in ["taken", "no/such/folder/t.csv"] {
        let output = needle(&["run", "paper", "--track", place], folder.path());
        assert_eq!(output.status.code(), Some(1), "{place}");
        assert!(
            text(&output.stderr).contains(&format!("cannot write {place}")),
            "{}",
            text(&output.stderr)
        );
    }
    // A device that is always full.
    if Path::new("/dev/full").exists() {
        let full = std::fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_needle"));
        let output = command.args(["schema"]).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output.stderr).contains("cannot write to standard output"));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle"));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = command.args(["schema"]).stdout(writer).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "");
}

#[test]
fn help_names_every_command() {
    let folder = folder();
    let output = needle(&["--help"], folder.path());
    assert_eq!(output.status.code(), Some(0));
    for command in [
        "run",
        "check",
        "compare",
        "campaign",
        "merge",
        "reference",
        "report",
        "schema",
    ] {
        assert!(
            text(&output.stdout).contains(&format!("\n  {command} ")),
            "{command}"
        );
        let output = needle(&[command, "--help"], folder.path());
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(text(&output.stdout).contains("Usage: needle "), "{command}");
    }
}
