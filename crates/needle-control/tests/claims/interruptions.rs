//! What interrupts an insertion: solvers that fail in any way, clocks set forward, ends of the path, and a first measurement from elsewhere.

use crate::faulty_solver::{self, Fault, Switch};
use crate::linear::needle;
use crate::scene::DT_S;
use crate::survival::{helix, inside, on_time, predictive};
use mpc_qp::SolveStatus;
use nalgebra::Vector3;
use needle_control::{
    Controller, Convergence, LinearConfiguration, Measurement, NmpcConfiguration, Origin,
    StopReason,
};
use needle_model::{Input, Pose};

/// Drives through a fault in the samples 3 to 6, and one of 12 samples from 20 on, longer than plans are kept.
fn assert_survives(name: &str, controller: &mut impl Controller, fault: Fault, switch: &Switch) {
    let path = helix(100);
    let mut previous = Input::ZERO;
    let stopped = Origin::Stop {
        reason: StopReason::NoPlan,
    };
    for step in 0..40 {
        let age = match step {
            3..7 => step - 2,
            20..32 => step - 19,
            _ => 0,
        };
        switch.set((age > 0).then_some(fault));
        let decided = controller.step(&Measurement::of(path.poses()[step]), on_time(step));
        let (input, origin) = (decided.input, decided.origin);
        let what = format!("{name}, {fault:?}, step {step}: {input:?}, {origin:?}");
        assert!(inside(input, previous, DT_S), "{what}");
        match age {
            0 => assert!(
                matches!(origin, Origin::Optimal | Origin::Degraded { .. }),
                "{what}"
            ),
            1..=10 => {
                assert_eq!(origin, Origin::ShiftedPlan { age }, "{what}");
                // The plan began at sample 2 or 19; it has one pose more than stages.
                assert_eq!(decided.predicted.len(), 21 - age, "{what}");
            }
            _ => assert_eq!(origin, stopped, "{what}"),
        }
        previous = input;
    }
}

#[test]
fn every_end_of_a_solve_without_an_answer_is_bridged_and_recovered_from() {
    let faults = [
        faulty_solver::infeasible(),
        Fault::Status(SolveStatus::IterationLimit),
        Fault::Status(SolveStatus::TimeLimit),
        Fault::Status(SolveStatus::NumericalTrouble),
        Fault::Error,
    ];
    let switch = Switch::default();
    for fault in faults {
        switch.set(None);
        let (linear, nonlinear) = (LinearConfiguration::default(), NmpcConfiguration::default());
        let mut ltv = faulty_solver::ltv(needle(), helix(100), linear, &switch);
        assert_survives("time-varying", &mut ltv, fault, &switch);
        let mut nmpc = faulty_solver::nmpc(needle(), helix(100), nonlinear, &switch);
        assert_survives("nonlinear", &mut nmpc, fault, &switch);
    }
}

#[test]
fn shifted_plan_has_the_poses_and_the_inputs_of_the_plan_it_is_from() {
    let switch = Switch::default();
    let solved = NmpcConfiguration {
        convergence: Convergence::Full {
            tolerance: 1e-9,
            max_iterations: 50,
        },
        start_iterations: 50,
        damping: 0.0,
        ..NmpcConfiguration::default()
    };
    let mut nmpc = faulty_solver::nmpc(needle(), helix(100), solved, &switch);
    let start = Measurement::of(Pose::identity());
    let decided = nmpc.step(&start, 0.0);
    let planned = decided.predicted.to_vec();
    let mut pose = needle()
        .step(&Pose::identity(), decided.input, DT_S)
        .unwrap();
    switch.set(Some(Fault::Status(SolveStatus::NumericalTrouble)));
    for age in 1..4 {
        let decided = nmpc.step(&start, on_time(age));
        assert_eq!(decided.origin, Origin::ShiftedPlan { age });
        assert_eq!(decided.predicted, &planned[age..]);
        pose = needle().step(&pose, decided.input, DT_S).unwrap();
        // The plan is solved to steps of 1e-9.
        let gap = pose.error_from(&planned[age + 1]).norm();
        assert!(gap < 1e-6, "age {age}: {gap}");
    }
}

#[test]
fn end_once_reached_stays_reached() {
    let path = helix(30);
    let end = *path.poses().last().unwrap();
    let behind = Pose {
        position_mm: end.position_mm - end.tangent() * 3.0,
        ..end
    };
    for (name, mut controller) in predictive(&path) {
        for step in 0..30 {
            controller.step(&Measurement::of(path.poses()[step]), on_time(step));
        }
        for (step, pose) in [(30, end), (31, behind), (32, behind)] {
            let origin = controller
                .step(&Measurement::of(pose), on_time(step))
                .origin;
            let reason = StopReason::PathEnd;
            assert_eq!(origin, Origin::Stop { reason }, "{name}, step {step}");
        }
    }
}

#[test]
fn time_that_is_over_short_of_the_end_is_no_end_of_the_path() {
    for (name, mut controller) in predictive(&helix(30)) {
        let mut origin = Origin::Optimal;
        for step in 0..60 {
            let stuck = Measurement::of(Pose::identity());
            origin = controller.step(&stuck, on_time(step)).origin;
        }
        // A path by progress has no time: a needle that is stuck is driven on.
        let reason = StopReason::OutOfTime;
        let stopped = origin == Origin::Stop { reason };
        assert_eq!(stopped, name != "nonlinear, progress", "{name}: {origin:?}");
    }
}

#[test]
fn clock_set_forward_by_a_minute_does_not_end_the_insertion() {
    let path = helix(100);
    for (name, mut controller) in predictive(&path) {
        for step in 0..40 {
            let late_s = if step < 20 { 0.0 } else { 60.0 };
            let pose = path.poses()[step];
            let origin = controller
                .step(&Measurement::of(pose), on_time(step) + late_s)
                .origin;
            assert!(
                !matches!(origin, Origin::Stop { .. }),
                "{name}, step {step}: {origin:?}"
            );
        }
    }
}

#[test]
fn first_measurement_far_from_the_start_of_the_path_is_an_outlier() {
    let far = Pose {
        position_mm: Vector3::new(100.0, 0.0, 0.0),
        ..Pose::identity()
    };
    for (name, mut controller) in predictive(&helix(100)) {
        let first = controller.step(&Measurement::of(far), 0.0);
        let reason = StopReason::NoMeasurement;
        assert_eq!(first.origin, Origin::Stop { reason }, "{name}");
        let second = controller.step(&Measurement::of(Pose::identity()), DT_S);
        assert!(
            matches!(second.origin, Origin::Optimal | Origin::Degraded { .. }),
            "{name}: {:?}",
            second.origin
        );
    }
}
