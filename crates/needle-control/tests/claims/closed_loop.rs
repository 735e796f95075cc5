//! Closed loops of the nonlinear controller on the cases of `docs/controllers.md`: the plant runs at half the sample time.

use needle_control::{Convergence, NmpcConfiguration, NmpcController, Tracking};
use needle_model::EulerState;
use crate::scene::{Scene, Score, run};

fn score_of(scene: &Scene, configuration: NmpcConfiguration) -> Score {
    let mut controller = NmpcController::new(scene.model, scene.path(), configuration).unwrap();
    run(&mut controller, scene)
}

/// One real-time iteration a step, the default.
fn score(scene: &Scene) -> Score {
    score_of(scene, NmpcConfiguration::default())
}

#[test]
fn nominal_path_is_tracked_to_15_micrometres() {
    let score = score(&Scene::default());
    assert!(score.rms_mm <= 0.015, "{score:?}");
}

#[test]
fn plant_that_bends_a_fifth_less_is_tracked_to_25_micrometres() {
    let score = score(&Scene { plant_curvature_factor: 0.8, ..Scene::default() });
    assert!(score.rms_mm <= 0.025, "{score:?}");
}

#[test]
fn plant_that_bends_a_fifth_more_is_tracked_to_15_micrometres() {
    let score = score(&Scene { plant_curvature_factor: 1.2, ..Scene::default() });
    assert!(score.rms_mm <= 0.015, "{score:?}");
}

#[test]
fn strongly_bent_path_is_tracked_to_6_micrometres() {
    let score = score(&Scene { path_curvature_ratio: 0.8, ..Scene::default() });
    assert!(score.rms_mm <= 0.006, "{score:?}");
}

#[test]
fn straight_path_is_tracked_by_a_bevelled_needle_to_10_micrometres() {
    let score = score(&Scene { path_curvature_ratio: 0.0, torsion_rad_per_mm: 0.0, ..Scene::default() });
    assert!(score.rms_mm <= 0.010, "{score:?}");
}

#[test]
fn noise_of_a_fifth_of_a_millimetre_is_not_amplified() {
    let score = score(&Scene { noise_mm: 0.2, ..Scene::default() });
    assert!(score.rms_mm <= 0.21, "{score:?}");
}

#[test]
fn start_off_the_path_is_corrected() {
    let off = EulerState { x_mm: 1.0, y_mm: 1.0, z_mm: 0.0, alpha_rad: 0.05, beta_rad: 0.05, gamma_rad: 1.0 }.to_pose();
    let score = score(&Scene { start: off, ..Scene::default() });
    assert!(score.rms_mm <= 0.22 && score.max_mm <= 0.87, "{score:?}");
}
