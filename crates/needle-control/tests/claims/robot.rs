//! What the robot and its sensors do behind a controller's back: inputs that were not applied, a glitch within the gate, nothing seen.

use crate::linear::{HELIX, needle, path};
use crate::scene::DT_S;
use crate::survival::{all, helix, inside, laws, on_time, predictive};
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, Origin, StopReason, TerminalChoice,
};
use needle_model::{Input, Pose};

#[test]
fn the_next_change_counts_from_the_input_that_the_robot_applied() {
    let path = helix(100);
    let applied = Input {
        v_mm_s: 2.0,
        omega_rad_s: -6.0,
    };
    for (name, mut controller) in all(&path) {
        for step in 0..5 {
            controller.step(&Measurement::of(path.poses()[step]), on_time(step));
        }
        // Cut by a safety layer, and in motion as the controller takes over.
        for (step, reset) in [(5, false), (0, true)] {
            if reset {
                controller.reset();
            }
            controller.applied(applied);
            // What is no number tells nothing.
            controller.applied(Input {
                v_mm_s: f64::INFINITY,
                omega_rad_s: f64::NAN,
            });
            let next = controller.step(&Measurement::of(path.poses()[step]), on_time(step));
            let what = format!("{name}, reset {reset}: {:?}, {:?}", next.input, next.origin);
            assert!(inside(next.input, applied, DT_S), "{what}");
            assert!(!matches!(next.origin, Origin::Stop { .. }), "{what}");
        }
    }
}

#[test]
fn at_zero_error_after_the_reference_s_input_the_reference_s_input_comes_back() {
    for terminal in [
        TerminalChoice::HelixDare,
        TerminalChoice::RiccatiChain,
        TerminalChoice::Periodic { period: 5 },
        TerminalChoice::None,
    ] {
        let configuration = LinearConfiguration {
            terminal,
            ..LinearConfiguration::default()
        };
        let reference = path(needle(), HELIX, 200);
        let mut controller = LtvController::new(needle(), reference, configuration).unwrap();
        controller.applied(HELIX);
        let step = controller.step(&Measurement::of(Pose::identity()), 0.0);
        // The solver's tolerance.
        let off =
            (step.input.v_mm_s - HELIX.v_mm_s).hypot(step.input.omega_rad_s - HELIX.omega_rad_s);
        assert!(off < 1e-8, "{terminal:?}: {:?}", step.input);
    }
}

#[test]
fn one_glitch_within_the_gate_costs_no_more_than_two_samples_of_the_path() {
    let path = helix(200);
    let (_, mut controller) = predictive(&path).swap_remove(1);
    for glitch in [100, 182] {
        controller.reset();
        let (mut pose, mut ended) = (Pose::identity(), None);
        for step in 0..260 {
            let mut seen = pose;
            if step == glitch {
                seen.position_mm += 9.5 * pose.tangent();
            }
            let decided = controller.step(&Measurement::of(seen), on_time(step));
            if let Origin::Stop { reason } = decided.origin {
                ended.get_or_insert(reason);
            }
            let input = decided.input;
            pose = needle().step(&pose, input, DT_S).unwrap();
        }
        let end = path.poses()[200];
        let left_mm = (end.position_mm - pose.position_mm).norm();
        assert_eq!(ended, Some(StopReason::PathEnd), "{glitch}");
        assert!(left_mm < 1.0, "{glitch}: {left_mm} mm");
    }
}

#[test]
fn a_law_that_sees_nothing_says_for_how_long() {
    let path = helix(100);
    for (name, mut controller) in laws(&path) {
        controller.step(&Measurement::of(path.poses()[0]), 0.0);
        let blind = controller.step(&Measurement::default(), DT_S).origin;
        assert_eq!(blind, Origin::ShiftedPlan { age: 1 }, "{name}");
        let blind = controller.step(&Measurement::default(), 2.0 * DT_S).origin;
        assert_eq!(blind, Origin::ShiftedPlan { age: 2 }, "{name}");
        let seen = controller.step(&Measurement::of(path.poses()[2]), 3.0 * DT_S);
        assert_eq!(seen.origin, Origin::Law, "{name}");
    }
}
