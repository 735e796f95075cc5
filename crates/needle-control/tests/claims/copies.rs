//! What survival owes to a copy of a controller, and to the first pose after samples without one.

use crate::scene::CURVATURE_PER_MM;
use crate::scene::DT_S;
use crate::survival::{helix, on_time};
use nalgebra::{Vector3, Vector6};
use needle_control::{
    BaselineSettings, Controller, DutyCycledGains, DutyCycledSteering, InputLimits, LawController,
    LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController, Origin,
    StopReason, Tracking,
};
use needle_model::{Needle, Pose};

#[test]
fn copy_of_a_fresh_controller_bridges_a_gap_as_the_controller_does() {
    let (needle, path) = (Needle::new(CURVATURE_PER_MM).unwrap(), helix(100));
    let nmpc = NmpcController::new(needle, path.clone(), NmpcConfiguration::default()).unwrap();
    let ltv = LtvController::new(needle, path, LinearConfiguration::default()).unwrap();
    let copies: [Box<dyn Controller>; 2] = [Box::new(nmpc.clone()), Box::new(ltv.clone())];
    for mut controller in copies {
        controller.step(&Measurement::of(Pose::identity()), 0.0);
        for age in 1..=10 {
            let origin = controller
                .step(&Measurement::default(), on_time(age))
                .origin;
            assert_eq!(origin, Origin::ShiftedPlan { age });
        }
    }
}

#[test]
fn outlier_at_the_end_of_a_gap_is_not_believed() {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let path = helix(100);
    let mut controller =
        LtvController::new(needle, path.clone(), LinearConfiguration::default()).unwrap();
    let mut pose = Pose::identity();
    for step in 0..20 {
        let far = Pose {
            position_mm: pose.position_mm + Vector3::x() * 100.0,
            ..pose
        };
        let measurement = match step {
            3..13 => Measurement::default(),
            13 => Measurement::of(far),
            _ => Measurement::of(pose),
        };
        let decided = controller.step(&measurement, on_time(step));
        let (input, origin) = (decided.input, decided.origin);
        match step {
            13 => assert_eq!(
                origin,
                Origin::Stop {
                    reason: StopReason::NoMeasurement
                }
            ),
            0..3 | 14.. => assert!(
                matches!(origin, Origin::Optimal | Origin::Degraded { .. }),
                "step {step}: {origin:?}"
            ),
            _ => {}
        }
        pose = needle.step(&pose, input, DT_S).unwrap();
    }
}

#[test]
fn reference_by_progress_waits_while_the_needle_stands_through_a_gap() {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let configuration = NmpcConfiguration {
        tracking: Tracking::Progress,
        ..NmpcConfiguration::default()
    };
    let mut controller = NmpcController::new(needle, helix(400), configuration).unwrap();
    let (mut pose, mut found_mm) = (Pose::identity(), 0.0);
    for step in 0..150 {
        let measurement = match step {
            5..105 => Measurement::default(),
            _ => Measurement::of(pose),
        };
        let input = controller.step(&measurement, on_time(step)).input;
        pose = needle.step(&pose, input, DT_S).unwrap();
        if step >= 105 {
            found_mm += input.v_mm_s * DT_S;
        }
    }
    // 45 samples at 5 mm/s are 22 mm; a reference that ran on would be 45 mm ahead, and chased at 10 mm/s.
    assert!((15.0..30.0).contains(&found_mm), "{found_mm}");
}

#[test]
fn optimal_plan_begins_with_what_the_input_applied_does() {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let configuration = NmpcConfiguration {
        limits: InputLimits {
            omega_rate_max_rad_s2: 5.0,
            ..InputLimits::default()
        },
        ..NmpcConfiguration::default()
    };
    let mut controller = NmpcController::new(needle, helix(300), configuration).unwrap();
    let rolled = Vector6::new(1.0, -1.0, 0.0, 0.0, 0.0, 1.0);
    let (mut pose, mut optimal) = (Pose::identity().perturbed(&rolled), 0);
    for step in 0..18 {
        let decided = controller.step(&Measurement::of(pose), 0.7 * step as f64);
        // The first plan is made afresh, by a line search that may end short of what can be reached.
        if step > 0 && decided.origin == Origin::Optimal {
            optimal += 1;
            let next = needle.step(&pose, decided.input, DT_S).unwrap();
            let gap = next.error_from(&decided.predicted[1]).norm();
            // What a plan leaves out is the bend's second order: 0.03 rad/s x 0.1 s x (0.6 rad)^2.
            assert!(gap < 5e-3, "step {step}: {gap}, {:?}", decided.input);
        }
        pose = needle.step(&pose, decided.input, 0.7).unwrap();
    }
    assert!(optimal > 5, "{optimal}");
}

#[test]
fn last_estimate_of_curvature_stays_for_every_controller() {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let law = || DutyCycledSteering::new(DutyCycledGains::default()).unwrap();
    let settings = BaselineSettings::default();
    let controllers = || {
        let nmpc = NmpcController::new(needle, helix(100), NmpcConfiguration::default());
        let ltv = LtvController::new(needle, helix(100), LinearConfiguration::default());
        let law = LawController::new(helix(100), needle, law(), settings);
        let all: [Box<dyn Controller>; 3] = [
            Box::new(nmpc.unwrap()),
            Box::new(ltv.unwrap()),
            Box::new(law.unwrap()),
        ];
        all
    };
    let start = Pose::identity().perturbed(&Vector6::new(0.05, -0.03, 0.0, 0.0, 0.0, 0.2));
    for (mut once, mut always) in controllers().into_iter().zip(controllers()) {
        for step in 0..30 {
            let told = Measurement {
                curvature_per_mm: Some(1.5 * CURVATURE_PER_MM),
                ..Measurement::of(start)
            };
            let silent = if step == 0 {
                told
            } else {
                Measurement::of(start)
            };
            let inputs = [(&mut once, silent), (&mut always, told)]
                .map(|(controller, measured)| controller.step(&measured, on_time(step)).input);
            assert_eq!(inputs[0], inputs[1], "step {step}");
        }
    }
}
