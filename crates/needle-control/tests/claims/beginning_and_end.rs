//! How an insertion begins: with the first pose that is believed, whenever that comes; and how it ends: at the end of the path.

use crate::linear::needle;
use crate::scene::{DT_S, Scene, apart};
use crate::survival::{helix, on_time, predictive};
use nalgebra::{Vector3, Vector6};
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    Origin, StopReason, Survival, Tracking,
};
use needle_model::{Input, Pose};

/// Samples without a pose to believe; ten outliers would be believed.
const WAITED: usize = 8;

#[test]
fn time_spent_waiting_for_the_first_pose_is_none_of_the_path_s() {
    let path = helix(100);
    let far = Pose {
        position_mm: Vector3::x() * 200.0,
        ..Pose::identity()
    };
    for unseen in [Measurement::default(), Measurement::of(far)] {
        for ((name, mut waits), (_, mut at_once)) in
            predictive(&path).into_iter().zip(predictive(&path))
        {
            for step in 0..WAITED {
                let decided = waits.step(&unseen, on_time(step));
                let reason = StopReason::NoMeasurement;
                assert_eq!(decided.origin, Origin::Stop { reason }, "{name}");
                assert_eq!(decided.input, Input::ZERO, "{name}");
            }
            for (step, pose) in path.poses().iter().enumerate().take(30) {
                let seen = Measurement::of(*pose);
                let late = waits.step(&seen, on_time(WAITED + step)).input;
                let punctual = at_once.step(&seen, on_time(step)).input;
                // Rounding of the clock, through the solver's tolerance of 1e-8.
                assert!(
                    apart(late, punctual) < 1e-5,
                    "{name}, {step}: {late:?} {punctual:?}"
                );
            }
        }
    }
}

#[test]
fn outliers_are_doubted_for_as_long_as_is_set_however_long_plans_are_kept() {
    let path = helix(100);
    let beside = Pose {
        position_mm: Vector3::x() * 20.0,
        ..Pose::identity()
    };
    for (max_plan_age, max_outliers) in [(3, 6), (6, 3)] {
        let configuration = LinearConfiguration {
            survival: Survival {
                max_plan_age,
                max_outliers,
                ..Survival::default()
            },
            ..LinearConfiguration::default()
        };
        let mut controller = LtvController::new(needle(), path.clone(), configuration).unwrap();
        controller.step(&Measurement::of(Pose::identity()), 0.0);
        for refused in 1..=max_outliers {
            let origin = controller
                .step(&Measurement::of(beside), on_time(refused))
                .origin;
            let reason = StopReason::NoMeasurement;
            let expected = match refused <= max_plan_age {
                true => Origin::ShiftedPlan { age: refused },
                false => Origin::Stop { reason },
            };
            assert_eq!(origin, expected, "{max_plan_age}, {max_outliers}");
        }
        let origin = controller
            .step(&Measurement::of(beside), on_time(max_outliers + 1))
            .origin;
        let believed = matches!(origin, Origin::Optimal | Origin::Degraded { .. });
        assert!(believed, "{max_plan_age}, {max_outliers}: {origin:?}");
    }
}

#[test]
fn insertion_ends_at_the_end_of_the_path_wherever_its_last_step_begins() {
    let scene = Scene::default();
    let path = scene.path();
    let end = path.poses()[path.inputs().len()];
    let ended = Origin::Stop {
        reason: StopReason::PathEnd,
    };
    for tracking in [Tracking::Time, Tracking::Progress] {
        // By progress the last step begins anywhere between two samples of the path.
        for ahead_mm in [-0.4, -0.25, -0.1, 0.05, 0.2] {
            let configuration = NmpcConfiguration {
                tracking,
                ..NmpcConfiguration::default()
            };
            let mut controller =
                NmpcController::new(scene.model, path.clone(), configuration).unwrap();
            let mut pose = Pose::exp(&Vector6::new(0.0, 0.0, ahead_mm, 0.0, 0.0, 0.0));
            let mut last = Origin::Optimal;
            for step in 0..230 {
                let decided = controller.step(&Measurement::of(pose), on_time(step));
                last = decided.origin;
                pose = scene.model.step(&pose, decided.input, DT_S).unwrap();
            }
            assert_eq!(last, ended, "{tracking:?}, {ahead_mm}");
            let left_mm = (end.position_mm - pose.position_mm).norm();
            println!("{tracking:?}, {ahead_mm}: {left_mm}");
            // A tenth of a step's way; by whole steps of the path's speed it was up to four tenths.
            assert!(left_mm < 0.05, "{tracking:?}, {ahead_mm}: {left_mm}");
        }
    }
}
