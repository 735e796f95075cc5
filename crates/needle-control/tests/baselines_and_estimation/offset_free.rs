//! With the filter in the loop a wrong curvature costs nothing lasting: the tracking error returns to the nominal figure.

use crate::harness::{KAPPA_PER_MM, Normal, bent_path, drive, needle, plant};
use nalgebra::{SVector, Vector6};
use needle_control::{
    BaselineSettings, Belief, Controller, DutyCycledGains, DutyCycledSteering, FilterSettings,
    LawController, NeedleFilter, Observation, PidGains, SlidingMode, SlidingModeGains, SteeringPid,
};
use needle_model::{LaggedState, Pose};

const SEEDS: u64 = 24;

fn controller(law: &str) -> Box<dyn Controller> {
    let (path, settings) = (bent_path(0.5), BaselineSettings::default());
    match law {
        "pid" => {
            let law = SteeringPid::new(PidGains::default()).unwrap();
            Box::new(LawController::new(path, needle(), law, settings).unwrap())
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

/// Means over the seeds: RMS distance over the second half of the path in mm, and the curvature found, as a share of
/// the model's. Positions with 0.2 mm and tangents with 1 degree of noise at 10 Hz; roll is not seen.
fn tracked(law: &str, factor: f64, learns: bool) -> (f64, f64) {
    let path = bent_path(0.5);
    let (mut late, mut found) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let state = LaggedState {
            pose: Pose::identity(),
            needle: needle(),
            lag_rad: 0.0,
        };
        let mut settings = FilterSettings::default();
        let curvature_std = match learns {
            true => 0.3 * KAPPA_PER_MM,
            false => {
                settings.process.curvature_per_mm = 0.0;
                1e-6 * KAPPA_PER_MM
            }
        };
        let std = [0.2, 0.2, 0.2, 0.02, 0.02, 0.1, curvature_std, 0.01];
        let belief = Belief::independent(state, &SVector::from(std));
        let mut filter = NeedleFilter::new(settings, belief, 0.0).unwrap();
        let mut normal = Normal::seeded(seed);
        let tracking = drive(
            controller(law).as_mut(),
            &plant(factor),
            &Pose::identity(),
            &path,
            |tip, held, time_s| {
                if time_s > 0.0 {
                    filter.advance(held, time_s);
                }
                let seen = tip.position_mm + normal.vector() * 0.2;
                filter.observe(Observation::Position(seen), time_s);
                let turned = Vector6::new(0.0, 0.0, 0.0, normal.next(), normal.next(), 0.0);
                let tangent = tip.perturbed(&(turned * 1_f64.to_radians())).tangent();
                filter.observe(Observation::Tangent(tangent), time_s);
                filter.measurement()
            },
        );
        let curvature = filter.belief().state.needle.curvature_per_mm();
        late += tracking.late_rms_mm / SEEDS as f64;
        found += curvature / KAPPA_PER_MM / SEEDS as f64;
    }
    (late, found)
}

#[test]
fn curvature_wrong_by_20_percent_costs_no_lasting_error() {
    for law in ["pid", "sliding", "duty"] {
        let (nominal_mm, _) = tracked(law, 1.0, true);
        // Studied: 0.08 mm, all of it noise of the sensors.
        assert!(nominal_mm < 0.1, "{law}: {nominal_mm}");
        for factor in [0.8, 1.2] {
            let (wrong_mm, found) = tracked(law, factor, true);
            println!("{law} {factor}: {wrong_mm} mm, nominal {nominal_mm}, found {found}");
            // The mean of eight runs scatters by a tenth; duty-cycled steering with a weak needle has less to steer with.
            assert!(
                wrong_mm < 1.25 * nominal_mm,
                "{law} {factor}: {wrong_mm} {nominal_mm}"
            );
            assert!((found - factor).abs() < 0.02, "{law}: {found}");
        }
    }
}

#[test]
fn a_filter_that_is_sure_of_a_wrong_curvature_keeps_an_error() {
    let (open, _) = tracked("duty", 0.8, true);
    let (stubborn, _) = tracked("duty", 0.8, false);
    println!("open {open} mm, stubborn {stubborn} mm");
    assert!(stubborn > 2.0 * open, "{stubborn} {open}");
}
