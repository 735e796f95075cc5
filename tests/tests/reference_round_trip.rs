//! Positions of an executed path, and back: the reconstructed reference can be tracked by the controllers.

use nalgebra::Vector6;
use needle_control::{
    Controller, Measurement, NmpcConfiguration, NmpcController, reconstruct_path,
};
use needle_model::{
    Input, Needle, Pose, PositionCurve, PositionPathProblem, PositionPathSettings, ReferencePath,
};

const DT_S: f64 = 0.1;

#[test]
fn reference_reconstructed_from_positions_is_tracked_to_the_positions_themselves() {
    let needle = Needle::new(1.0 / 150.0).unwrap();
    let inputs = (0..150).map(|k| Input {
        v_mm_s: 5.0,
        omega_rad_s: if k % 30 < 15 { 0.4 } else { 0.0 },
    });
    let start = Pose::exp(&Vector6::new(3.0, -2.0, 1.0, 0.3, -0.2, 0.5));
    let executed = ReferencePath::from_inputs(needle, start, inputs.collect(), DT_S).unwrap();
    let positions: Vec<_> = executed
        .poses()
        .iter()
        .map(|pose| pose.position_mm)
        .collect();
    let curve = PositionCurve::through(&positions, 0.0).unwrap();
    let problem = PositionPathProblem::new(needle, curve, PositionPathSettings::default()).unwrap();
    let found = reconstruct_path(&problem).unwrap();
    // The problem's own measure of a good fit: sigma of 0.05 mm.
    assert!(found.rms_mm < 0.05, "{}", found.rms_mm);

    let mut controller =
        NmpcController::new(needle, found.path, NmpcConfiguration::default()).unwrap();
    let (mut pose, mut worst_mm) = (start, 0.0_f64);
    for step in 0..150 {
        let input = controller
            .step(&Measurement::of(pose), step as f64 * DT_S)
            .input;
        pose = needle.step(&pose, input, DT_S).unwrap();
        let nearest = positions
            .iter()
            .map(|p| (p - pose.position_mm).norm())
            .fold(f64::INFINITY, f64::min);
        worst_mm = worst_mm.max(nearest);
    }
    // Samples lie 0.5 mm apart, so the nearest is within 0.25 mm along the path; the rest is tracking and fit.
    assert!(worst_mm < 0.4, "{worst_mm}");
}
