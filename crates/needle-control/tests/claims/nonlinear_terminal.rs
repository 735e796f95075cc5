//! Terminal ingredients of the nonlinear controller: what they claim, where they cannot be had, and the closed loop under them.

use crate::deviates::Deviates;
use crate::linear::{HELIX, needle, path};
use crate::scene::{DT_S, Scene};
use nalgebra::Vector6;
use needle_control::{
    ConfigurationError, Controller, Convergence, Measurement, NmpcConfiguration, NmpcController,
    NmpcWeights, Origin, SpinTarget, TerminalChoice, TerminalError,
};
use needle_model::{Input, Pose, ReferencePath};

/// Weights about an executed path, the end in a terminal set, each program solved.
pub(crate) fn certified(terminal: TerminalChoice) -> NmpcConfiguration {
    NmpcConfiguration {
        weights: NmpcWeights {
            position: 1.0,
            tangent: 10.0,
            roll: 1.0,
            v: 0.1,
            omega: 0.1,
            end_position: 1.0,
            end_tangent: 10.0,
            end_roll: 1.0,
        },
        spin_target: SpinTarget::Reference,
        terminal,
        convergence: Convergence::Full {
            tolerance: 1e-7,
            max_iterations: 50,
        },
        damping: 0.0,
        start_iterations: 50,
        ..NmpcConfiguration::default()
    }
}

/// Inputs that change along the path.
fn winding() -> ReferencePath {
    let inputs = (0..80).map(|k| Input {
        omega_rad_s: 1.0 + 0.5 * (0.2 * f64::from(k)).sin(),
        ..HELIX
    });
    ReferencePath::from_inputs(needle(), Pose::identity(), inputs.collect(), DT_S).unwrap()
}

#[test]
fn nonlinear_ingredients_carry_a_certificate_about_the_needle_itself() {
    for (choice, path) in [
        (TerminalChoice::HelixDare, path(needle(), HELIX, 100)),
        (
            TerminalChoice::Periodic { period: 4 },
            path(needle(), HELIX, 100),
        ),
        (TerminalChoice::RiccatiChain, winding()),
    ] {
        let controller = NmpcController::new(needle(), path, certified(choice)).unwrap();
        let certificate = controller.certificate().unwrap();
        assert!(certificate.holds(), "{choice:?}\n{certificate}");
        let last = certificate.checks.last().unwrap();
        assert_eq!(last.name, "decrease of the needle itself", "{choice:?}");
        assert_eq!(controller.terminal(), choice);
    }
}

#[test]
fn nonlinear_auto_takes_what_the_path_and_the_cost_admit() {
    let chosen = |path, configuration| {
        let controller = NmpcController::new(needle(), path, configuration).unwrap();
        controller.terminal()
    };
    let auto = certified(TerminalChoice::Auto);
    assert_eq!(
        chosen(path(needle(), HELIX, 100), auto.clone()),
        TerminalChoice::HelixDare
    );
    assert_eq!(
        chosen(winding(), auto.clone()),
        TerminalChoice::RiccatiChain
    );
    assert_eq!(
        chosen(Scene::default().path(), auto.clone()),
        TerminalChoice::None
    );
    let at_rest = NmpcConfiguration {
        spin_target: SpinTarget::Rest,
        ..auto
    };
    assert_eq!(chosen(winding(), at_rest), TerminalChoice::None);
}

#[test]
fn nonlinear_choices_that_cannot_be_had_are_refused_with_the_reason() {
    let refusal = |path, configuration| match NmpcController::new(needle(), path, configuration) {
        Err(ConfigurationError::Terminal(reason)) => reason,
        other => panic!("{other:?}"),
    };
    let at_rest = NmpcConfiguration {
        spin_target: SpinTarget::Rest,
        ..certified(TerminalChoice::HelixDare)
    };
    assert!(matches!(
        refusal(path(needle(), HELIX, 50), at_rest),
        TerminalError::SpinAtRest
    ));
    assert!(matches!(
        refusal(
            Scene::default().path(),
            certified(TerminalChoice::RiccatiChain)
        ),
        TerminalError::NotExecutable { step: 0, .. }
    ));
    assert!(matches!(
        refusal(winding(), certified(TerminalChoice::HelixDare)),
        TerminalError::NotPeriodic { step: 1, period: 1 }
    ));
}

/// The closed loop of the needle itself: V falls by the stage cost while the plan ends in the set. Returns whether the start was
/// feasible.
fn descends(controller: &mut NmpcController, reference: &ReferencePath, xi: Vector6<f64>) -> bool {
    controller.reset();
    let weights = controller.configuration().weights;
    let mut pose = reference.poses()[0].perturbed(&xi);
    let mut before: Option<(f64, f64)> = None;
    for step in 0..20 {
        let decided = controller.step(&Measurement::of(pose), step as f64 * DT_S);
        let (input, origin) = (decided.input, decided.origin);
        if step == 0 && origin != Origin::Optimal {
            return false;
        }
        assert_eq!(origin, Origin::Optimal, "step {step} from {xi:?}");
        let value = controller.value();
        if let Some((last, cost)) = before {
            // The programs are solved to steps of 1e-7, which leaves V loose by less than 1e-4 of itself.
            assert!(
                value <= last - cost + 1e-4 * last + 1e-9,
                "V fell too little at step {step} from {xi:?}: {value} after {last}, stage cost {cost}"
            );
        }
        let (here, wanted) = (&reference.poses()[step], reference.inputs()[step]);
        let error = pose.error_from(here);
        // The stage cost in the errors that it is made of.
        let cost = weights.position * (pose.position_mm - here.position_mm).norm_squared()
            + weights.tangent * (pose.tangent() - here.tangent()).norm_squared()
            + weights.v * (input.v_mm_s - wanted.v_mm_s).powi(2)
            + weights.omega * (input.omega_rad_s - wanted.omega_rad_s).powi(2)
            // Roll is the twist of the relative rotation; for small tilt the last error.
            + 0.9 * weights.roll * error[5] * error[5];
        before = Some((value, cost));
        pose = needle().step(&pose, input, DT_S).unwrap();
    }
    true
}

#[test]
fn cost_of_the_needle_itself_falls_by_the_stage_cost() {
    let reference = path(needle(), HELIX, 100);
    let mut controller = NmpcController::new(
        needle(),
        reference.clone(),
        certified(TerminalChoice::HelixDare),
    )
    .unwrap();
    let mut noise = Deviates::seeded(29);
    let size = Vector6::new(0.15, 0.15, 0.25, 0.015, 0.015, 0.2);
    let feasible = (0..16)
        .filter(|_| {
            let xi = size.map(|s| s * noise.either_way());
            descends(&mut controller, &reference, xi)
        })
        .count();
    assert!(feasible > 5, "{feasible}");
}

#[test]
fn an_estimated_curvature_voids_the_nonlinear_set() {
    let path = path(needle(), HELIX, 100);
    let configuration = certified(TerminalChoice::HelixDare);
    let mut controller = NmpcController::new(needle(), path, configuration).unwrap();
    // Too far off for the set to be reached within the horizon.
    let far = Pose::exp(&Vector6::new(4.0, -4.0, 0.0, 0.0, 0.0, 0.0));
    let untold = controller.step(&Measurement::of(far), 0.0).origin;
    assert!(matches!(untold, Origin::Degraded { .. }), "{untold:?}");
    assert!(controller.terminal_region().is_some());
    controller.reset();
    let told = Measurement {
        curvature_per_mm: Some(0.9 * needle().curvature_per_mm()),
        ..Measurement::of(far)
    };
    let told = controller.step(&told, 0.0).origin;
    assert_eq!(told, Origin::Optimal);
    assert!(controller.terminal_region().is_none());
}
