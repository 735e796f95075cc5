//! No controller allocates after its first step, whatever it is asked for and whatever happens to it.

use crate::linear::{HELIX, needle, path};
use crate::scene::{DT_S, Scene};
use nalgebra::Vector6;
use needle_control::{
    Controller, Convergence, LinearConfiguration, LtvController, Measurement, NmpcConfiguration,
    NmpcController, Origin, SpinTarget, StraightController, TerminalChoice, Tracking,
};
use needle_model::{Needle, Pose};

/// Samples in which nothing is seen: longer than plans are kept, so that the needle stops.
const OUTAGE: std::ops::Range<usize> = 40..55;

/// From here on the clock is 5 s ahead: more than the nonlinear controller's horizon, so that its next plan is a fresh one.
const SET_FORWARD: usize = 60;

/// Stages of that horizon.
const HORIZON: usize = 8;

/// What 80 steps after the first came to.
#[derive(Debug, Default)]
struct Account {
    allocations: u64,
    /// Most programs of one step.
    programs: usize,
    stopped: bool,
    planned_again: bool,
}

/// An outlier, a shove out of any terminal set, an outage, a clock that is set forward, and, if asked for, another curvature told at the end.
fn drive(controller: &mut dyn Controller, needle: Needle, told: Option<f64>) -> Account {
    let shove = Vector6::new(1.0, -1.0, 0.2, 0.02, 0.02, 0.7);
    let outlier = Vector6::new(100.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let mut account = Account::default();
    let mut pose = Pose::exp(&Vector6::new(0.1, -0.2, 0.1, 0.01, 0.01, 0.2));
    let mut input = controller.step(&Measurement::of(pose), 0.0).input;
    let counted = allocation_counter::measure(|| {
        for step in 1..=80 {
            pose = needle.step(&pose, input, DT_S).unwrap();
            if step == 20 {
                pose = pose.perturbed(&shove);
            }
            let seen = match step {
                10 => pose.perturbed(&outlier),
                _ => pose,
            };
            let measurement = Measurement {
                pose: (!OUTAGE.contains(&step)).then_some(seen),
                curvature_per_mm: told.filter(|_| step >= 65),
            };
            let ahead_s = if step < SET_FORWARD { 0.0 } else { 5.0 };
            let decided = controller.step(&measurement, step as f64 * DT_S + ahead_s);
            input = decided.input;
            account.programs = account.programs.max(decided.statistics.solves);
            match decided.origin {
                Origin::Stop { .. } => account.stopped = true,
                Origin::Optimal | Origin::Degraded { .. } => {
                    account.planned_again |= account.stopped;
                }
                _ => {}
            }
        }
    });
    account.allocations = counted.count_total;
    account
}

/// Drives with and without a curvature told; `least` programs are solved in some step of each.
fn assert_no_allocation(name: &str, controller: &mut dyn Controller, needle: Needle, least: usize) {
    for told in [None, Some(0.9 * needle.curvature_per_mm())] {
        controller.reset();
        let account = drive(controller, needle, told);
        let what = format!("{name}, told {told:?}: {account:?}");
        assert_eq!(account.allocations, 0, "{what}");
        assert!(account.stopped && account.planned_again, "{what}");
        assert!(account.programs >= least, "{what}");
    }
}

#[test]
fn nonlinear_steps_do_not_allocate() {
    let scene = Scene::default();
    let full = Convergence::Full {
        tolerance: 1e-6,
        max_iterations: 20,
    };
    let usual = || NmpcConfiguration {
        horizon: HORIZON,
        ..NmpcConfiguration::default()
    };
    for (name, least, configuration) in [
        ("real time", 3, usual()),
        (
            "converged",
            3,
            NmpcConfiguration {
                convergence: full,
                ..usual()
            },
        ),
        (
            "by progress",
            3,
            NmpcConfiguration {
                tracking: Tracking::Progress,
                ..usual()
            },
        ),
    ] {
        let mut controller = NmpcController::new(scene.model, scene.path(), configuration).unwrap();
        assert_no_allocation(name, &mut controller, scene.model, least);
    }
}

#[test]
fn nonlinear_steps_into_a_terminal_set_do_not_allocate() {
    for terminal in [TerminalChoice::HelixDare, TerminalChoice::RiccatiChain] {
        let configuration = NmpcConfiguration {
            horizon: HORIZON,
            spin_target: SpinTarget::Reference,
            terminal,
            start_iterations: 1,
            ..NmpcConfiguration::default()
        };
        let reference = path(needle(), HELIX, 100);
        let mut controller = NmpcController::new(needle(), reference, configuration).unwrap();
        assert!(controller.certificate().is_some(), "{terminal:?}");
        // Three candidates of a fresh plan would be three programs: more are of the set.
        assert_no_allocation(&format!("{terminal:?}"), &mut controller, needle(), 4);
    }
}

#[test]
fn linear_steps_do_not_allocate() {
    let configuration = |terminal, tracking| LinearConfiguration {
        terminal,
        tracking,
        ..LinearConfiguration::default()
    };
    for (terminal, tracking, least) in [
        (TerminalChoice::HelixDare, Tracking::Time, 2),
        (TerminalChoice::RiccatiChain, Tracking::Time, 2),
        (
            TerminalChoice::Periodic { period: 5 },
            Tracking::Progress,
            2,
        ),
        (TerminalChoice::None, Tracking::Time, 1),
    ] {
        let configuration = configuration(terminal, tracking);
        let reference = path(needle(), HELIX, 300);
        let mut controller = LtvController::new(needle(), reference, configuration).unwrap();
        assert_no_allocation(&format!("{terminal:?}"), &mut controller, needle(), least);
    }
    let straight = Needle::new(0.0).unwrap();
    let configuration = configuration(TerminalChoice::HelixDare, Tracking::Time);
    let reference = path(straight, HELIX, 300);
    let mut controller = StraightController::new(straight, reference, configuration).unwrap();
    assert_no_allocation("straight", &mut controller, straight, 1);
}

#[test]
fn steps_in_a_corridor_that_the_start_is_outside_of_do_not_allocate() {
    let corridor_mm = Some(0.1);
    let scene = Scene::default();
    let nonlinear = NmpcConfiguration {
        horizon: HORIZON,
        corridor_mm,
        ..NmpcConfiguration::default()
    };
    let mut controller = NmpcController::new(scene.model, scene.path(), nonlinear).unwrap();
    assert_no_allocation("nonlinear", &mut controller, scene.model, 3);
    let linear = LinearConfiguration {
        corridor_mm,
        ..LinearConfiguration::default()
    };
    let mut controller = LtvController::new(needle(), path(needle(), HELIX, 300), linear).unwrap();
    assert_no_allocation("time-varying", &mut controller, needle(), 1);
}
