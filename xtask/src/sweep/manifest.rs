//! `manifest.json`: what made the data.

use super::compute::ComputedFigure;
use needle_sim::published::{DT_S, PublishedRun, RunSettings};
use serde_json::{Map, Value, json};
use std::process::Command;
use std::time::Duration;

/// The workspace's lock file. It is read when it is needed: the package of this crate is built without it.
const LOCK_FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.lock");
/// The libraries whose version can change a figure.
const LIBRARIES: [&str; 4] = ["clarabel", "faer", "nalgebra", "needle-sim"];

pub(super) fn encode(
    figures: &[ComputedFigure],
    wall_time: Duration,
) -> Result<Vec<u8>, serde_json::Error> {
    let files: Map<String, Value> = figures
        .iter()
        .map(|figure| {
            let runs: Map<String, Value> = figure
                .runs
                .iter()
                .map(|run| (run.name.clone(), parameters(run)))
                .collect();
            (format!("published/{}.csv", figure.file.stem()), runs.into())
        })
        .collect();
    let manifest = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "git_revision": git(&["rev-parse", "HEAD"]),
        "git_uncommitted_changes": git(&["status", "--porcelain"]).map(|changes| !changes.is_empty()),
        "rustc": printed(Command::new("rustc").arg("--version")),
        "libraries": libraries(),
        "solver": { "name": "clarabel", "start": "cold at every step", "factorisation": "qdldl" },
        "dt_s": DT_S,
        "files": files,
        "wall_time_s": wall_time.as_secs_f64(),
    });
    let mut text = serde_json::to_vec_pretty(&manifest)?;
    text.push(b'\n');
    Ok(text)
}

fn parameters(run: &PublishedRun) -> Value {
    match &run.settings {
        RunSettings::StraightReference | RunSettings::BevelReference => {
            json!({ "kind": "reference" })
        }
        RunSettings::Straight(settings) => json!({
            "kind": "straight",
            "q_diagonal": settings.q_diagonal,
            "r_diagonal": settings.r_diagonal,
            "horizon": settings.horizon,
            "tolerance": settings.tolerance,
        }),
        RunSettings::Bevel(settings) => json!({
            "kind": "bevel",
            "q_diagonal": settings.q_diagonal,
            "r_diagonal": settings.r_diagonal,
            "horizon": settings.horizon,
            "tolerance": settings.tolerance,
        }),
    }
}

/// Version of each library, nothing where the lock file does not say.
fn libraries() -> Map<String, Value> {
    let locked = std::fs::read_to_string(LOCK_FILE).unwrap_or_default();
    LIBRARIES
        .iter()
        .map(|name| ((*name).to_owned(), locked_version(&locked, name)))
        .collect()
}

fn locked_version(locked: &str, library: &str) -> Value {
    let entry = format!("name = \"{library}\"\nversion = \"");
    let version = locked
        .split_once(&entry)
        .and_then(|(_, rest)| rest.split('"').next());
    version.into()
}

/// What git says of the repository that this program was built from, or nothing where there is no git.
fn git(arguments: &[&str]) -> Option<String> {
    printed(
        Command::new("git")
            .args(["-C", env!("CARGO_MANIFEST_DIR")])
            .args(arguments),
    )
}

fn printed(command: &mut Command) -> Option<String> {
    let output = command
        .output()
        .ok()
        .filter(|output| output.status.success())?;
    String::from_utf8(output.stdout)
        .ok()
        .map(|text| text.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_library_has_its_locked_version() {
        for (library, version) in libraries() {
            assert!(
                version
                    .as_str()
                    .is_some_and(|version| version.contains('.')),
                "{library}"
            );
        }
        assert!(locked_version("", "clarabel").is_null());
    }
}
