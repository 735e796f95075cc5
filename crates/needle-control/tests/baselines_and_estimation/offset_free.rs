//! With the filter in the loop a wrong curvature costs nothing lasting: the tracking error returns to the nominal figure.

use crate::deviates::Deviates;
use crate::harness::{DT_S, KAPPA_PER_MM, bent_path, drive, needle, plant};
use nalgebra::{SVector, Vector6};
use needle_control::{
    BaselineSettings, Belief, Controller, DutyCycledGains, DutyCycledSteering, FilterSettings,
    LawController, LinearConfiguration, LtvController, Measurement, NeedleFilter,
    NmpcConfiguration, NmpcController, Observation, PidGains, SlidingMode, SlidingModeGains,
    SteeringPid, reconstruct_path,
};
use needle_model::{
    LaggedState, Needle, Pose, PositionCurve, PositionPathProblem, PositionPathSettings,
    ReferencePath,
};
use std::collections::VecDeque;

/// One loop: roll is not seen; positions have 0.2 mm and tangents 1 degree of noise at 10 Hz.
#[derive(Clone, Copy)]
struct Loop {
    law: &'static str,
    /// Plant's curvature over the model's.
    factor: f64,
    /// Whether the filter doubts the model's curvature.
    learns: bool,
    /// Age of the observations when they come in.
    delay_s: f64,
    /// Share of the observations that never come in, and those of one second of the insertion.
    lost: f64,
    blind_from_s: f64,
}

const LOOP: Loop = Loop {
    law: "pid",
    factor: 1.0,
    learns: true,
    delay_s: 0.0,
    lost: 0.0,
    blind_from_s: f64::INFINITY,
};

/// What the model's needle executes along the path, 0.03 mm away from it.
fn executed_path() -> ReferencePath {
    let path = bent_path(0.5);
    let positions_mm: Vec<_> = path.poses().iter().map(|pose| pose.position_mm).collect();
    let curve = PositionCurve::through(&positions_mm, 0.0).unwrap();
    let problem = PositionPathProblem::new(needle(), curve, PositionPathSettings::default());
    reconstruct_path(&problem.unwrap()).unwrap().path
}

fn controller(law: &str) -> Box<dyn Controller> {
    let (path, settings) = (bent_path(0.5), BaselineSettings::default());
    match law {
        "pid" => {
            let law = SteeringPid::new(PidGains::default()).unwrap();
            Box::new(LawController::new(path, needle(), law, settings).unwrap())
        }
        "nmpc" => {
            let configuration = NmpcConfiguration::default();
            Box::new(NmpcController::new(needle(), path, configuration).unwrap())
        }
        "ltv" => {
            let configuration = LinearConfiguration::default();
            Box::new(LtvController::new(needle(), executed_path(), configuration).unwrap())
        }
        "sliding" => {
            let law = SlidingMode::new(SlidingModeGains::default()).unwrap();
            Box::new(LawController::new(path, needle(), law, settings).unwrap())
        }
        _ => {
            let law = DutyCycledSteering::new(DutyCycledGains::default()).unwrap();
            Box::new(LawController::new(path, needle(), law, settings).unwrap())
        }
    }
}

/// Means over the seeds: RMS distance over the second half of the path in mm, and the curvature found over the model's.
fn tracked(case: Loop) -> (f64, f64) {
    // A run's RMS scatters by a third; the predictive controller takes a thousand times as long as a law.
    let seeds = if matches!(case.law, "nmpc" | "ltv") {
        8
    } else {
        24
    };
    let path = bent_path(0.5);
    let (mut late, mut found) = (0.0, 0.0);
    for seed in 0..seeds {
        let state = LaggedState {
            pose: Pose::identity(),
            needle: needle(),
            lag_rad: 0.0,
        };
        let mut settings = FilterSettings::default();
        let curvature_std = match case.learns {
            true => 0.3 * KAPPA_PER_MM,
            false => {
                settings.process.curvature_per_mm = 0.0;
                1e-6 * KAPPA_PER_MM
            }
        };
        let std = [0.2, 0.2, 0.2, 0.02, 0.02, 0.1, curvature_std, 0.01];
        let belief = Belief::independent(state, &SVector::from(std));
        let mut filter = NeedleFilter::new(settings, belief, 0.0).unwrap();
        let mut deviates = Deviates::seeded(seed);
        let mut losses = Deviates::seeded(1_000 + seed);
        let mut images = VecDeque::new();
        let tracking = drive(
            controller(case.law).as_mut(),
            &plant(case.factor),
            &Pose::identity(),
            &path,
            |tip, held, time_s| {
                if time_s > 0.0 {
                    filter.advance(held, time_s);
                }
                let seen = tip.position_mm + deviates.normals() * 0.2;
                let turned = Vector6::new(0.0, 0.0, 0.0, deviates.normal(), deviates.normal(), 0.0);
                let tangent = tip.perturbed(&(turned * 1_f64.to_radians())).tangent();
                let blind = (case.blind_from_s..case.blind_from_s + 1.0).contains(&time_s);
                if losses.uniform() >= case.lost && !blind {
                    images.push_back((time_s, seen, tangent));
                }
                let due = |taken_at_s: f64| taken_at_s + case.delay_s <= time_s + 1e-6;
                while let Some((taken_at_s, seen, tangent)) = images.pop_front_if(|i| due(i.0)) {
                    filter.observe(Observation::Position(seen), taken_at_s);
                    filter.observe(Observation::Tangent(tangent), taken_at_s);
                }
                filter.measurement()
            },
        );
        let curvature = filter.belief().state.needle.curvature_per_mm();
        late += tracking.late_rms_mm / seeds as f64;
        found += curvature / KAPPA_PER_MM / seeds as f64;
    }
    (late, found)
}

#[test]
fn curvature_wrong_by_20_percent_costs_no_lasting_error() {
    for law in ["pid", "sliding", "duty", "nmpc", "ltv"] {
        let (nominal_mm, _) = tracked(Loop { law, ..LOOP });
        // Studied: 0.06 to 0.085 mm, all of it noise of the sensors.
        assert!(nominal_mm < 0.1, "{law}: {nominal_mm}");
        for factor in [0.8, 1.2] {
            let (wrong_mm, found) = tracked(Loop {
                law,
                factor,
                ..LOOP
            });
            println!("{law} {factor}: {wrong_mm} mm, nominal {nominal_mm}, found {found}");
            // The means of 24 and of 8 runs scatter by 7 and 12 %, and a weak needle has less to steer with: 1.30 measured for LTV.
            assert!(
                wrong_mm < 1.4 * nominal_mm,
                "{law} {factor}: {wrong_mm} {nominal_mm}"
            );
            assert!((found - factor).abs() < 0.02, "{law}: {found}");
        }
    }
}

#[test]
fn linear_mpc_told_the_curvature_returns_to_its_nominal_error() {
    let rms_mm = |factor: f64, told: bool| {
        let (mut controller, path) = (controller("ltv"), bent_path(0.5));
        let plant = plant(factor);
        let tracking = drive(
            controller.as_mut(),
            &plant,
            &Pose::identity(),
            &path,
            |tip, _, _| Measurement {
                pose: Some(*tip),
                curvature_per_mm: told.then_some(factor * KAPPA_PER_MM),
            },
        );
        tracking.rms_mm
    };
    let nominal_mm = rms_mm(1.0, true);
    for factor in [0.8, 1.2] {
        let (told_mm, untold_mm) = (rms_mm(factor, true), rms_mm(factor, false));
        println!("{factor}: {told_mm} mm, untold {untold_mm}, nominal {nominal_mm}");
        // Measured: 0.033 mm; told 0.028 and 0.038, whose waves have another length; untold 0.53 and 0.22.
        assert!(
            told_mm < 1.3 * nominal_mm,
            "{factor}: {told_mm} {nominal_mm}"
        );
        assert!(
            untold_mm > 4.0 * nominal_mm,
            "{factor}: {untold_mm} {nominal_mm}"
        );
    }
}

#[test]
fn linear_mpc_told_late_or_after_a_gap_keeps_to_the_path_s_time() {
    // Steps at which nothing is seen, and from which on the curvature is told.
    for (blind, told) in [(0..0, 30), (0..0, 0), (80..101, 0), (80..101, 50)] {
        let (mut controller, path) = (controller("ltv"), bent_path(0.5));
        let (weak, mut tip) = (Needle::new(0.85 * KAPPA_PER_MM).unwrap(), Pose::identity());
        for step in 0..180 {
            let seen = Measurement {
                pose: (!blind.contains(&step)).then_some(tip),
                curvature_per_mm: (step >= told).then_some(weak.curvature_per_mm()),
            };
            let input = controller.step(&seen, f64::from(step) * DT_S).input;
            tip = weak.step(&tip, input, DT_S).unwrap();
        }
        let wanted = &path.poses()[180];
        let behind_mm = (wanted.position_mm - tip.position_mm).dot(&wanted.tangent());
        // Two seconds without an image leave 0.1 mm; a plan that counted its own time was 5 mm behind after them.
        assert!(behind_mm.abs() < 0.2, "{blind:?} {told}: {behind_mm}");
    }
}

#[test]
fn a_filter_that_is_sure_of_a_wrong_curvature_keeps_an_error() {
    let weak = Loop {
        law: "duty",
        factor: 0.8,
        ..LOOP
    };
    let (open, _) = tracked(weak);
    let (stubborn, _) = tracked(Loop {
        learns: false,
        ..weak
    });
    // Studied: 0.09 and 0.52 mm.
    assert!(stubborn > 2.0 * open, "{stubborn} {open}");
}

#[test]
fn images_100_ms_late_cost_nothing() {
    let (punctual, _) = tracked(LOOP);
    let (late, _) = tracked(Loop {
        delay_s: 0.1,
        ..LOOP
    });
    println!("{punctual} mm, 100 ms late {late}");
    // The scatter of two means of 24 runs.
    assert!(late < 1.15 * punctual, "{late} {punctual}");
}

#[test]
fn lost_images_and_a_second_without_any_cost_little() {
    for law in ["nmpc", "ltv"] {
        let (whole_mm, _) = tracked(Loop { law, ..LOOP });
        let (lossy_mm, found) = tracked(Loop {
            law,
            lost: 0.3,
            blind_from_s: 12.0,
            ..LOOP
        });
        println!("{law}: {lossy_mm} mm, {whole_mm} with every image, found {found}");
        // Of 200 images 133 are left: an error larger by a fifth, and the scatter of the means of eight runs.
        assert!(lossy_mm < 1.5 * whole_mm, "{law}: {lossy_mm} {whole_mm}");
        assert!((found - 1.0).abs() < 0.02, "{law}: {found}");
    }
}

#[test]
fn nonlinear_mpc_with_the_filter_tracks_noise_of_0_2_mm_to_0_08_mm() {
    let (tracking, _) = tracked(Loop {
        law: "nmpc",
        ..LOOP
    });
    assert!(tracking <= 0.08, "{tracking}");
}
