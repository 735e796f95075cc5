//! The deadline is kept at a horizon of 100, and a step that misses it is not applied and says so.

use crate::faulty_solver::{self, Fault, Switch};
use crate::linear::{HELIX, needle, path};
use crate::scene::{DT_S, Scene};
use mpc_qp::SolveStatus;
use nalgebra::Vector6;
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    Origin, Survival,
};
use needle_model::Pose;
use std::time::Duration;

const DEADLINE: Duration = Duration::from_millis(400);

fn within(deadline: Duration) -> Survival {
    Survival {
        deadline: Some(deadline),
        ..Survival::default()
    }
}

/// Two good steps, two late ones, and a good one again.
fn origins(controller: &mut impl Controller, switch: &Switch) -> Vec<Origin> {
    let step = |(sample, late): (usize, bool)| {
        let fault = Fault::Late(DEADLINE + Duration::from_millis(20));
        switch.set(late.then_some(fault));
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
    let switch = Switch::default();
    let linear = LinearConfiguration {
        horizon: 100,
        survival: within(DEADLINE),
        ..LinearConfiguration::default()
    };
    let mut ltv = faulty_solver::ltv(needle(), path(needle(), HELIX, 300), linear, &switch);
    assert_told("time-varying", &origins(&mut ltv, &switch));
    let scene = Scene::default();
    let nonlinear = NmpcConfiguration {
        horizon: 100,
        start_iterations: 1,
        survival: within(DEADLINE),
        ..NmpcConfiguration::default()
    };
    let mut nmpc = faulty_solver::nmpc(scene.model, scene.path(), nonlinear, &switch);
    assert_told("nonlinear", &origins(&mut nmpc, &switch));
}

/// Checks that steps beyond the deadline are not applied and that most programs were cut short; returns the least overrun of twenty steps.
fn overrun(
    controller: &mut impl Controller,
    deadline: Duration,
    told_per_mm: Option<f64>,
) -> Duration {
    let mut applied_late = Vec::new();
    let mut cut_short = 0;
    let least = (0..20)
        .map(|sample| {
            let depth_mm = 0.5 * f64::from(sample);
            let pose = Pose::exp(&Vector6::new(0.5, -0.5, depth_mm, 0.05, 0.02, 1.0));
            let measurement = Measurement {
                curvature_per_mm: told_per_mm,
                ..Measurement::of(pose)
            };
            let step = controller.step(&measurement, f64::from(sample) * DT_S);
            let bridged = matches!(
                step.origin,
                Origin::ShiftedPlan { .. } | Origin::Stop { .. }
            );
            // The controller looks at its clock before the statistics are written: a hundred microseconds between the two.
            if !bridged && step.statistics.time > deadline + Duration::from_micros(100) {
                applied_late.push((step.origin, step.statistics.time));
            }
            cut_short += usize::from(step.statistics.status == Some(SolveStatus::TimeLimit));
            step.statistics.time.saturating_sub(deadline)
        })
        .min()
        .unwrap();
    // A machine that does other things may interrupt a step between the two looks, but not step after step.
    assert!(applied_late.len() < 3, "{applied_late:?}");
    // A program that runs to its end is no matter for the clock alone.
    assert!(cut_short >= 10, "{cut_short}");
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
    let mut told = ltv.clone();
    let weak_per_mm = 0.9 * needle().curvature_per_mm();
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
    let overruns = [
        overrun(&mut ltv, deadline, None),
        overrun(&mut told, deadline, Some(weak_per_mm)),
        overrun(&mut nmpc, deadline, None),
    ];
    assert!(
        overruns.iter().all(|overrun| *overrun < most),
        "{overruns:?}"
    );
}
