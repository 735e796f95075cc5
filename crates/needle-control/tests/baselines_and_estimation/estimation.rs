//! What the filter finds out.

use crate::harness::{DT_S, KAPPA_PER_MM, plant};
use crate::watching::{filter, prior_at, watch};
use nalgebra::Vector6;
use needle_control::{FilterSettings, LAG, NeedleFilter, Observation, ROLL, RollSearch};
use needle_model::{PhysicalNeedle, Pose, Torsion, TorsionalLag};

#[test]
fn curvature_wrong_by_20_percent_is_found_from_positions_alone() {
    for factor in [0.8, 1.2] {
        let mut filter = filter(FilterSettings::default());
        let plant = plant(factor);
        watch(&plant, &Pose::identity(), 200, 3, |step, input, seen, _| {
            let time_s = step as f64 * DT_S;
            filter.advance(input, time_s);
            filter.observe(Observation::Position(seen), time_s);
        });
        let found = filter.belief().state.needle.curvature_per_mm() / KAPPA_PER_MM;
        // Seen over 100 mm with 0.2 mm of noise; the walk of 1e-4 / mm in a second leaves some percent open.
        assert!((found - factor).abs() < 0.06, "{factor}: {found}");
    }
}

#[test]
fn roll_is_found_from_positions_and_wound_up_torsion_from_the_same() {
    let torsion = TorsionalLag::new(0.5).unwrap();
    let settings = FilterSettings {
        torsion: Some(torsion),
        ..FilterSettings::default()
    };
    let shaft = PhysicalNeedle {
        torsion: Torsion::FirstOrder(torsion),
        ..plant(1.0)
    };
    let start = Pose::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.5));
    let mut filter = filter(settings);
    let truth = watch(&shaft, &start, 200, 4, |step, input, seen, _| {
        let time_s = step as f64 * DT_S;
        filter.advance(input, time_s);
        filter.observe(Observation::Position(seen), time_s);
    });
    let belief = filter.belief();
    let error = truth.frame.error_from(&belief.state.pose);
    let std = belief.covariance[(ROLL, ROLL)].sqrt();
    // Half a radian at entry; three standard deviations of what the filter says it knows, and that it knows enough.
    assert!(
        error[5].abs() < 3.0 * std && std < 0.15,
        "{} {std}",
        error[5]
    );
    let lag_std = belief.covariance[(LAG, LAG)].sqrt();
    let lag_error = truth.lag_rad - belief.state.lag_rad;
    // The plant turns within a sample, the model in its mean: second order in dt / tau, about 0.01 rad.
    assert!(
        lag_error.abs() < 3.0 * lag_std + 0.02,
        "{lag_error} {lag_std}"
    );
}

#[test]
fn a_roll_that_is_wholly_unknown_is_found() {
    for (seed, roll) in [0.2_f64, 1.9, -2.7, 3.1, -1.0].into_iter().enumerate() {
        let start = Pose::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, roll));
        let prior = prior_at(Pose::identity(), 1.0);
        let mut search = RollSearch::new(FilterSettings::default(), prior, 0.0, 8).unwrap();
        let truth = watch(
            &plant(0.9),
            &start,
            120,
            seed as u64,
            |step, input, seen, _| {
                let time_s = step as f64 * DT_S;
                search.advance(input, time_s);
                search.observe(Observation::Position(seen), time_s);
            },
        );
        let error = truth.frame.error_from(&search.best().belief().state.pose);
        // After 60 mm; the start is known to within pi. A tenth of that is enough for any law.
        assert!(error[5].abs() < 0.3, "{roll}: {}", error[5]);
    }
}

#[test]
fn moving_the_world_moves_the_estimate_and_nothing_else() {
    let world = Pose::exp(&Vector6::new(30.0, -20.0, 10.0, 1.0, -2.0, 0.5));
    let settings = FilterSettings::default();
    let mut here = NeedleFilter::new(settings, prior_at(Pose::identity(), 0.3), 0.0).unwrap();
    let mut there = NeedleFilter::new(settings, prior_at(world, 0.3), 0.0).unwrap();
    watch(
        &plant(0.9),
        &Pose::identity(),
        60,
        11,
        |step, input, seen, state| {
            let time_s = step as f64 * DT_S;
            let tangent = state.frame.tangent();
            for (filter, view) in [(&mut here, Pose::identity()), (&mut there, world)] {
                filter.advance(input, time_s);
                let position = view.position_mm + view.rotation * seen;
                filter.observe(Observation::Position(position), time_s);
                filter.observe(Observation::Tangent(view.rotation * tangent), time_s);
            }
        },
    );
    let (a, b) = (here.belief(), there.belief());
    // Rounding of 40 mm coordinates over sixty corrections.
    let difference = world
        .compose(&a.state.pose)
        .error_from(&b.state.pose)
        .norm();
    assert!(difference < 1e-9, "{difference}");
    let curvature = [a, b].map(|belief| belief.state.needle.curvature_per_mm());
    assert!((curvature[0] - curvature[1]).abs() < 1e-12, "{curvature:?}");
    assert!((a.covariance - b.covariance).amax() < 1e-9);
}
