//! The deadline is kept at a horizon of 100, and a step that misses it is not applied and says so.

use crate::faulty_solver::{self, Fault, Switch};
use crate::linear::{HELIX, needle, path};
use crate::scene::{DT_S, Scene};
use nalgebra::Vector6;
use needle_control::{
    Controller, LinearConfiguration, Measurement, NmpcConfiguration, Origin, Survival,
};
use needle_model::Pose;
use std::time::Duration;

const DEADLINE: Duration = Duration::from_secs(1);

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

/// The time that each solve of three good steps was given, a list a step.
fn limits(
    controller: &mut impl Controller,
    switch: &Switch,
    told_per_mm: Option<f64>,
) -> Vec<Vec<Duration>> {
    let step = |sample: u32| {
        let depth_mm = 0.5 * f64::from(sample);
        let pose = Pose::exp(&Vector6::new(0.5, -0.5, depth_mm, 0.05, 0.02, 1.0));
        let measurement = Measurement {
            curvature_per_mm: told_per_mm,
            ..Measurement::of(pose)
        };
        controller.step(&measurement, f64::from(sample) * DT_S);
        switch.take_limits()
    };
    (0..3).map(step).collect()
}

#[test]
fn a_solver_gets_what_is_left_of_the_deadline() {
    // Far more than three steps take, on whatever machine: the claim is about what is handed on, not about speed.
    let deadline = Duration::from_secs(1000);
    let switch = Switch::default();
    let linear = LinearConfiguration {
        horizon: 100,
        survival: within(deadline),
        ..LinearConfiguration::default()
    };
    let mut ltv = faulty_solver::ltv(needle(), path(needle(), HELIX, 300), linear, &switch);
    let mut told = ltv.clone();
    let weak_per_mm = 0.9 * needle().curvature_per_mm();
    let scene = Scene::default();
    let nonlinear = NmpcConfiguration {
        horizon: 100,
        survival: within(deadline),
        ..NmpcConfiguration::default()
    };
    let mut nmpc = faulty_solver::nmpc(scene.model, scene.path(), nonlinear, &switch);
    let mut programs = 0;
    for (name, steps) in [
        ("time-varying", limits(&mut ltv, &switch, None)),
        ("told", limits(&mut told, &switch, Some(weak_per_mm))),
        ("nonlinear", limits(&mut nmpc, &switch, None)),
    ] {
        for given in steps {
            assert!(
                !given.is_empty() && given[0] < deadline,
                "{name}: {given:?}"
            );
            assert!(
                given.is_sorted_by(|before, after| before > after),
                "{name}: {given:?}"
            );
            programs = programs.max(given.len());
        }
    }
    assert!(programs > 1, "no step solved more than one program");
}
