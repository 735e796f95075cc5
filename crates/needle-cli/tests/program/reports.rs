//! Pages of runs and campaigns: where they go, and what is no run.

use super::campaigns::{campaign_in, done};
use super::{folder, needle, text};
use std::fs;

#[test]
fn a_recorded_run_gives_the_page_that_the_run_itself_gives() {
    let folder = folder();
    let arguments = [
        "run",
        "paper",
        "--record",
        "r.json",
        "--report",
        "direct.html",
    ];
    done(&arguments, folder.path());
    assert_eq!(done(&["report", "r.json"], folder.path()), "r.html\n");
    let page = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let (direct, later) = (page("direct.html"), page("r.html"));
    assert!(direct.starts_with("<!doctype html>"));
    assert!(direct.contains("controller nmpc"));
    // Not assert_eq: a difference would print 10 MB.
    assert!(direct == later);
}

#[test]
fn a_campaigns_folder_gives_its_page_and_is_its_title() {
    let folder = folder();
    campaign_in(folder.path());
    done(
        &["campaign", "campaign.toml", "--out", "results"],
        folder.path(),
    );
    let written = done(&["report", "results"], folder.path());
    assert_eq!(written, "results/summary.html\n");
    let page = fs::read_to_string(folder.path().join("results/summary.html")).unwrap();
    assert!(page.contains("<title>Needle campaign: results</title>"));
    assert!(page.contains("controller.name = sliding_mode, plant.curvature_factor = 1.1"));
}

#[test]
fn what_is_no_run_is_told_by_name_and_leaves_no_page() {
    let folder = folder();
    fs::write(folder.path().join("other.json"), "{}").unwrap();
    for (arguments, code, words) in [
        (
            &["report", "other.json"][..],
            1,
            "other.json is no recorded run",
        ),
        (&["report", "absent.json"], 1, "cannot read absent.json"),
        (
            &["report", "."],
            1,
            "holds neither a recorded run nor the summary of a campaign",
        ),
        (&["report"], 2, "PATH"),
    ] {
        let output = needle(arguments, folder.path());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert!(
            text(&output.stderr).contains(words),
            "{}",
            text(&output.stderr)
        );
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn one_page_cannot_hold_many_runs() {
    let folder = folder();
    for name in ["a.json", "b.json"] {
        done(&["run", "paper", "--record", name], folder.path());
    }
    let output = needle(&["report", ".", "--out", "one.html"], folder.path());
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        done(&["report", "."], folder.path()),
        "./a.html\n./b.html\n"
    );
}
