//! Positions in, an executable path out.

use crate::scene::{CURVATURE_PER_MM, DT_S};
use nalgebra::{Vector3, Vector6};
use needle_control::{ReconstructedPath, reconstruct_path};
use needle_model::{
    Input, Needle, Pose, PositionCurve, PositionPathProblem, PositionPathSettings, ReferencePath,
};

fn reconstructed(positions_mm: &[Vector3<f64>]) -> ReconstructedPath {
    let curve = PositionCurve::through(positions_mm, 0.0).unwrap();
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let problem = PositionPathProblem::new(needle, curve, PositionPathSettings::default()).unwrap();
    let found = reconstruct_path(&problem).unwrap();
    let defect = found.path.largest_defect(needle).unwrap().unwrap().1.norm();
    // The path is a simulation: only rounding over 100 mm is left.
    assert!(defect < 1e-12, "{defect}");
    let limits = PositionPathSettings::default();
    assert!(
        found
            .path
            .inputs()
            .iter()
            .all(|u| *u == limits.within_limits(*u))
    );
    found
}

#[test]
fn positions_of_an_executed_path_are_passed_again() {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let inputs = (0..200).map(|k| Input {
        v_mm_s: 5.0,
        omega_rad_s: if k % 40 < 20 { 0.3 } else { 0.0 },
    });
    let path =
        ReferencePath::from_inputs(needle, Pose::identity(), inputs.collect(), DT_S).unwrap();
    let positions: Vec<_> = path.poses().iter().map(|pose| pose.position_mm).collect();
    let found = reconstructed(&positions);
    // The positions' sigma is 0.05 mm; the start's roll is guessed from the curvature there.
    assert!(
        found.rms_mm < 0.05,
        "{} {} at {}",
        found.rms_mm,
        found.worst_mm,
        found.worst_step
    );
    assert!(found.excesses.is_empty(), "{:?}", found.excesses);
    assert!(found.converged, "after {}", found.iterations);
}

#[test]
fn gentle_curve_is_followed_by_spinning() {
    let twist = Vector6::new(0.0, 0.0, 0.5, 0.25 * CURVATURE_PER_MM, 0.0, 0.005);
    let positions: Vec<_> = (0..=200)
        .map(|k| Pose::exp(&(twist * f64::from(k))).position_mm)
        .collect();
    let found = reconstructed(&positions);
    assert!(
        found.rms_mm < 0.05,
        "{} {} at {}",
        found.rms_mm,
        found.worst_mm,
        found.worst_step
    );
}

#[test]
fn curve_that_bends_too_much_is_reported_with_its_distance() {
    let twist = Vector6::new(0.0, 0.0, 0.5, 0.5 * 2.0 * CURVATURE_PER_MM, 0.0, 0.0);
    let positions: Vec<_> = (0..=100)
        .map(|k| Pose::exp(&(twist * f64::from(k))).position_mm)
        .collect();
    let found = reconstructed(&positions);
    assert!(!found.excesses.is_empty());
    // Twice the needle's curvature over 50 mm: the best arc misses by millimetres.
    assert!(found.worst_mm > 0.5, "{}", found.worst_mm);
}
