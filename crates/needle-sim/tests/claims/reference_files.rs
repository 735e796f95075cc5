//! Paths from files, relative to the scenario's folder.

use needle_sim::{Experiment, PathSourceError, RunError, Scenario, run};
use std::path::Path;

const BASE: &str = "needle.curvature_per_mm = 0.0066666667\ncontroller.name = 'nmpc'\n";

fn scenario_of(folder: &Path, reference: &str) -> Scenario {
    let path = folder.join("scenario.toml");
    std::fs::write(&path, format!("{BASE}{reference}")).unwrap();
    Scenario::load(&path).unwrap()
}

/// A parabola of a third of the needle's curvature, 80 mm deep, with a column that nobody asked for.
fn parabola() -> String {
    let row = |i: u32| {
        let z = f64::from(i) * 2.0;
        format!("{z},{i},0.0,{}\n", -0.0011 * z * z)
    };
    "z_mm,frame,x_mm,y_mm\n".to_owned() + &(0..=40).map(row).collect::<String>()
}

#[test]
fn positions_become_a_path_that_is_followed() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tracked.csv"), parabola()).unwrap();
    let scenario = scenario_of(
        folder.path(),
        "reference.kind = 'positions'\nreference.file = 'tracked.csv'\n",
    );
    let record = run(&scenario, 0).unwrap();
    assert!(record.summary.success, "{:?}", record.summary);
    let end = record.reference.poses.last().unwrap().position_mm;
    // The needle's own path passes the last position to a tenth of a millimetre.
    assert!(
        (end[2] - 80.0).abs() < 0.1 && (end[1] + 0.0011 * 6400.0).abs() < 0.1,
        "{end:?}"
    );
}

#[test]
fn poses_written_by_one_run_are_the_path_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let helix = Experiment::new(&Scenario::parse(crate::closed_loops::HELIX).unwrap()).unwrap();
    std::fs::write(folder.path().join("path.csv"), helix.path().to_csv()).unwrap();
    let scenario = scenario_of(
        folder.path(),
        "reference.kind = 'poses'\nreference.file = 'path.csv'\n",
    );
    let read = Experiment::new(&scenario).unwrap();
    let (a, b) = (read.path().poses(), helix.path().poses());
    assert_eq!(a.len(), b.len());
    // Printed with the fewest digits that read back; a quaternion is normalised on reading.
    assert!((a[100].position_mm - b[100].position_mm).norm() < 1e-12);
}

#[test]
fn a_wrong_file_is_told_with_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = scenario_of(
        folder.path(),
        "reference.kind = 'positions'\nreference.file = 'p.csv'\n",
    );
    for (text, words) in [
        (
            parabola().replace("4,2,0.0", "4,2,x"),
            "line 4: x_mm: expected a finite number, found \"x\"",
        ),
        (
            parabola().replace("4,2,0.0", "4,2,inf"),
            "line 4: x_mm: expected a finite number, found \"inf\"",
        ),
        (
            parabola().replace("y_mm", "y"),
            "line 1: no column y_mm; the header is: z_mm,frame,x_mm,y",
        ),
    ] {
        std::fs::write(folder.path().join("p.csv"), text).unwrap();
        let error = Experiment::new(&scenario).unwrap_err();
        let RunError::Path(error) = error else {
            panic!("{error:?}");
        };
        assert!(error.to_string().contains(words), "{error}");
    }
    std::fs::remove_file(folder.path().join("p.csv")).unwrap();
    let error = Experiment::new(&scenario).unwrap_err();
    assert!(
        matches!(error, RunError::Path(PathSourceError::Unreadable { .. })),
        "{error:?}"
    );
}
