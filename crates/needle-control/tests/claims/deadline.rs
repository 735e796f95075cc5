//! The deadline is kept at a horizon of 100, and a step that misses it is not applied and says so.

use crate::linear::{HELIX, needle, path};
use crate::scene::{DT_S, Scene};
use mpc_qp::{OcpQp, OcpSolver, Solution, SolveError, SolverSettings, Start, StructuredSolver};
use nalgebra::Vector6;
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    Origin, Survival,
};
use needle_model::Pose;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const DEADLINE: Duration = Duration::from_millis(400);

/// A solver that sleeps through the deadline when it is told to.
#[derive(Debug, Clone)]
struct Sleepy<const NX: usize> {
    solver: StructuredSolver<NX, 2>,
    asleep: Arc<AtomicBool>,
}

impl<const NX: usize> Sleepy<NX> {
    fn new(problem: &OcpQp<NX, 2>, asleep: &Arc<AtomicBool>) -> Result<Self, SolveError> {
        Ok(Self {
            solver: StructuredSolver::new(problem, SolverSettings::default())?,
            asleep: Arc::clone(asleep),
        })
    }
}

impl<const NX: usize> OcpSolver<NX, 2> for Sleepy<NX> {
    fn solve(
        &mut self,
        problem: &OcpQp<NX, 2>,
        start: Start,
        solution: &mut Solution<NX, 2>,
    ) -> Result<(), SolveError> {
        if self.asleep.load(Ordering::Relaxed) {
            std::thread::sleep(DEADLINE + Duration::from_millis(20));
        }
        self.solver.solve(problem, start, solution)
    }
}

fn within(deadline: Duration) -> Survival {
    Survival {
        deadline: Some(deadline),
        ..Survival::default()
    }
}

/// Two good steps, two late ones, and a good one again.
fn origins(controller: &mut impl Controller, asleep: &AtomicBool) -> Vec<Origin> {
    let step = |(sample, late): (usize, bool)| {
        asleep.store(late, Ordering::Relaxed);
        let pose = Pose::exp(&Vector6::new(0.0, 0.0, 0.5 * sample as f64, 0.0, 0.0, 0.0));
        controller
            .step(&Measurement::of(pose), sample as f64 * DT_S)
            .origin
    };
    [false, false, true, true, false]
        .into_iter()
        .enumerate()
        .map(step)
        .collect()
}

fn assert_told(name: &str, origins: &[Origin]) {
    let planned = |origin: &Origin| matches!(origin, Origin::Optimal | Origin::Degraded { .. });
    assert!(
        planned(&origins[0]) && planned(&origins[1]),
        "{name}: {origins:?}"
    );
    let shifted = [1, 2].map(|age| Origin::ShiftedPlan { age });
    assert_eq!(origins[2..4], shifted, "{name}");
    assert!(planned(&origins[4]), "{name}: {origins:?}");
}

#[test]
fn late_steps_at_horizon_100_take_the_shifted_plan_and_say_so() {
    let asleep = Arc::new(AtomicBool::new(false));
    let linear = LinearConfiguration {
        horizon: 100,
        survival: within(DEADLINE),
        ..LinearConfiguration::default()
    };
    let mut ltv = LtvController::with_solver(needle(), path(needle(), HELIX, 300), linear, |p| {
        Sleepy::new(p, &asleep)
    })
    .unwrap();
    assert_told("time-varying", &origins(&mut ltv, &asleep));
    let scene = Scene::default();
    let nonlinear = NmpcConfiguration {
        horizon: 100,
        start_iterations: 1,
        survival: within(DEADLINE),
        ..NmpcConfiguration::default()
    };
    let mut nmpc = NmpcController::with_solver(scene.model, scene.path(), nonlinear, |p| {
        Sleepy::new(p, &asleep)
    })
    .unwrap();
    assert_told("nonlinear", &origins(&mut nmpc, &asleep));
}

/// Checks that steps beyond the deadline are not applied; returns the least overrun of twenty steps.
fn overrun(controller: &mut impl Controller, deadline: Duration) -> Duration {
    let mut applied_late = Vec::new();
    let least = (0..20)
        .map(|sample| {
            let depth_mm = 0.5 * f64::from(sample);
            let pose = Pose::exp(&Vector6::new(0.5, -0.5, depth_mm, 0.05, 0.02, 1.0));
            let step = controller.step(&Measurement::of(pose), f64::from(sample) * DT_S);
            let bridged = matches!(
                step.origin,
                Origin::ShiftedPlan { .. } | Origin::Stop { .. }
            );
            // The controller looks at its clock before the statistics are written: a hundred microseconds between the two.
            if !bridged && step.statistics.time > deadline + Duration::from_micros(100) {
                applied_late.push((step.origin, step.statistics.time));
            }
            step.statistics.time.saturating_sub(deadline)
        })
        .min()
        .unwrap();
    // A machine that does other things may interrupt a step between the two looks, but not step after step.
    assert!(applied_late.len() < 3, "{applied_late:?}");
    least
}

#[test]
fn steps_at_horizon_100_end_at_the_deadline() {
    // Far less than a cold start takes, so that every program is cut short.
    let deadline = Duration::from_micros(300);
    let linear = LinearConfiguration {
        horizon: 100,
        survival: within(deadline),
        ..LinearConfiguration::default()
    };
    let mut ltv = LtvController::new(needle(), path(needle(), HELIX, 300), linear).unwrap();
    let scene = Scene::default();
    let nonlinear = NmpcConfiguration {
        horizon: 100,
        survival: within(deadline),
        ..NmpcConfiguration::default()
    };
    let mut nmpc = NmpcController::new(scene.model, scene.path(), nonlinear).unwrap();
    // Linearising and one iteration of the solver cannot be interrupted: 2 ms each in this profile. The least of twenty, as a
    // machine that does other things interrupts a step for longer; without a deadline a fresh nonlinear plan takes 100 ms.
    let most = Duration::from_millis(20);
    let (linear, nonlinear) = (overrun(&mut ltv, deadline), overrun(&mut nmpc, deadline));
    assert!(
        linear < most && nonlinear < most,
        "{linear:?} {nonlinear:?}"
    );
}
