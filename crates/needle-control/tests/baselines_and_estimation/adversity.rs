//! What the filter survives: late, missing, wrong and absurd observations, settings and clocks.

use crate::harness::{DT_S, plant};
use crate::watching::{filter, input_at, prior_at, watch};
use nalgebra::Vector3;
use needle_control::{
    FilterError, FilterSettings, NeedleFilter, Observation, ROLL, RollSearch, Verdict,
};
use needle_model::{Input, Pose};
use proptest::prelude::*;

#[test]
fn late_observations_in_any_order_equal_punctual_ones() {
    let (mut punctual, mut late) = (
        filter(FilterSettings::default()),
        filter(FilterSettings::default()),
    );
    let mut waiting: Vec<(usize, f64, Observation)> = Vec::new();
    watch(
        &plant(0.9),
        &Pose::identity(),
        60,
        5,
        |step, input, seen, state| {
            let time_s = step as f64 * DT_S;
            punctual.advance(input, time_s);
            late.advance(input, time_s);
            let position = Observation::Position(seen);
            punctual.observe(position, time_s);
            // Positions are 0.3 s late; tangents come in two samples of five, 0.1 s late.
            waiting.push((step + 3, time_s, position));
            if step % 5 < 2 {
                let tangent = Observation::Tangent(state.frame.tangent());
                punctual.observe(tangent, time_s);
                waiting.push((step + 1, time_s, tangent));
            }
            waiting.retain(|&(due, taken_at_s, observation)| {
                if due <= step || step == 60 {
                    let verdict = late.observe(observation, taken_at_s);
                    assert!(
                        matches!(verdict, Verdict::Accepted { .. }),
                        "{step}: {verdict:?}"
                    );
                }
                due > step && step != 60
            });
        },
    );
    let (a, b) = (punctual.belief(), late.belief());
    // The order of two sensors at one instant differs; the filter is linear up to corrections of 0.1 rad.
    let difference = a.state.pose.error_from(&b.state.pose).norm();
    assert!(difference < 1e-3, "{difference}");
    let relative = (a.covariance - b.covariance).amax() / a.covariance.amax();
    assert!(relative < 1e-2, "{relative}");
}

#[test]
fn one_late_sensor_equals_a_punctual_one_exactly() {
    let (mut punctual, mut late) = (
        filter(FilterSettings::default()),
        filter(FilterSettings::default()),
    );
    let mut seen_all = Vec::new();
    watch(
        &plant(0.9),
        &Pose::identity(),
        30,
        6,
        |step, input, seen, _| {
            let time_s = step as f64 * DT_S;
            punctual.advance(input, time_s);
            late.advance(input, time_s);
            punctual.observe(Observation::Position(seen), time_s);
            seen_all.push((time_s, seen));
        },
    );
    for (taken_at_s, seen) in seen_all.into_iter().rev() {
        late.observe(Observation::Position(seen), taken_at_s);
    }
    let (a, b) = (punctual.belief(), late.belief());
    // The same operations in the same order; only time differences are rounded otherwise.
    assert!(a.state.pose.error_from(&b.state.pose).norm() < 1e-9);
    assert!((a.covariance - b.covariance).amax() < 1e-9);
}

#[test]
fn an_outlier_of_100_mm_changes_nothing() {
    let (mut clean, mut spoiled) = (
        filter(FilterSettings::default()),
        filter(FilterSettings::default()),
    );
    watch(
        &plant(1.0),
        &Pose::identity(),
        40,
        7,
        |step, input, seen, _| {
            let time_s = step as f64 * DT_S;
            for filter in [&mut clean, &mut spoiled] {
                filter.advance(input, time_s);
            }
            if step % 6 == 0 {
                let far = seen + Vector3::new(0.0, 100.0, 0.0);
                let verdict = spoiled.observe(Observation::Position(far), time_s);
                assert!(matches!(verdict, Verdict::Outlier { .. }), "{verdict:?}");
                let back = spoiled.observe(Observation::Tangent(-Vector3::z()), time_s);
                assert!(matches!(back, Verdict::Outlier { .. }), "{back:?}");
            }
            for filter in [&mut clean, &mut spoiled] {
                filter.observe(Observation::Position(seen), time_s);
            }
        },
    );
    assert_eq!(clean.belief(), spoiled.belief());
}

#[test]
fn a_filter_that_is_lost_finds_the_needle_again() {
    let settings = FilterSettings::default();
    let mut filter = filter(settings);
    let shift = Vector3::new(20.0, -10.0, 5.0);
    let mut refused = 0;
    let truth = watch(
        &plant(1.0),
        &Pose::identity(),
        120,
        8,
        |step, input, seen, _| {
            let time_s = step as f64 * DT_S;
            filter.advance(input, time_s);
            let seen = if step > 40 { seen + shift } else { seen };
            let verdict = filter.observe(Observation::Position(seen), time_s);
            refused += u32::from(matches!(verdict, Verdict::Outlier { .. }));
        },
    );
    let found = filter.belief().state.pose.position_mm;
    // The tissue has moved by 23 mm: ten refusals, then the truth to the accuracy of the sensor.
    assert_eq!(refused, settings.outliers_until_lost);
    assert!((found - truth.frame.position_mm - shift).norm() < 0.5);
}

#[test]
fn a_gap_of_two_seconds_is_reported_and_bridged() {
    let mut filter = filter(FilterSettings::default());
    let mut blind = 0;
    let truth = watch(
        &plant(1.0),
        &Pose::identity(),
        100,
        9,
        |step, input, seen, _| {
            let time_s = step as f64 * DT_S;
            filter.advance(input, time_s);
            if !(50..70).contains(&step) {
                let verdict = filter.observe(Observation::Position(seen), time_s);
                assert!(
                    matches!(verdict, Verdict::Accepted { .. }),
                    "{step}: {verdict:?}"
                );
            }
            blind += u32::from(filter.measurement().pose.is_none());
        },
    );
    // One second of limit leaves ten of twenty samples without a pose, give or take the rounding of the limit.
    assert!((9..=10).contains(&blind), "{blind}");
    let error = truth.frame.position_mm - filter.belief().state.pose.position_mm;
    // Three standard deviations of the sensor.
    assert!(error.norm() < 0.6, "{error}");
}

#[test]
fn observations_out_of_time_are_named() {
    let mut filter = filter(FilterSettings {
        history: 8,
        ..FilterSettings::default()
    });
    for step in 1..=20 {
        filter.advance(input_at(step), step as f64 * DT_S);
    }
    let somewhere = Observation::Position(Vector3::zeros());
    assert!(matches!(
        filter.observe(somewhere, 0.5),
        Verdict::TooOld { .. }
    ));
    assert!(matches!(
        filter.observe(somewhere, 2.5),
        Verdict::FromTheFuture { .. }
    ));
    assert_eq!(filter.observe(somewhere, f64::NAN), Verdict::Unusable);
    let nowhere = Vector3::new(0.0, f64::NAN, 0.0);
    assert_eq!(
        filter.observe(Observation::Position(nowhere), 2.0),
        Verdict::Unusable
    );
    assert_eq!(
        filter.observe(Observation::Tangent(nowhere), 2.0),
        Verdict::Unusable
    );
    assert_eq!(
        filter.observe(Observation::Tangent(Vector3::zeros()), 2.0),
        Verdict::Unusable
    );
}

#[test]
fn settings_and_beliefs_that_make_no_sense_are_refused() {
    let good = FilterSettings::default();
    let prior = prior_at(Pose::identity(), 0.3);
    let refusal = |settings, belief| NeedleFilter::new(settings, belief, 0.0).err().unwrap();
    let no_noise = FilterSettings {
        position_std_mm: 0.0,
        ..good
    };
    assert!(matches!(
        refusal(no_noise, prior),
        FilterError::NotPositive {
            field: "position_std_mm",
            ..
        }
    ));
    let certain = FilterSettings {
        gate_probability: 0.0,
        ..good
    };
    assert!(matches!(
        refusal(certain, prior),
        FilterError::Probability { .. }
    ));
    let forgetful = FilterSettings { history: 1, ..good };
    assert_eq!(refusal(forgetful, prior), FilterError::History { found: 1 });
    let mut indefinite = prior;
    indefinite.covariance[(ROLL, ROLL)] = -1.0;
    assert_eq!(refusal(good, indefinite), FilterError::Covariance);
    let mut nowhere = prior;
    nowhere.state.pose.position_mm.x = f64::INFINITY;
    assert_eq!(refusal(good, nowhere), FilterError::NonFiniteBelief);
    assert!(RollSearch::new(good, prior, 0.0, 0).is_err());
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        10 => -50.0..50.0_f64,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
        1 => Just(1e12),
        1 => Just(0.0),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_input_no_reading_and_no_clock_spoils_the_belief(
        samples in prop::collection::vec(prop::array::uniform8(anything()), 1..60),
    ) {
        let mut filter = filter(FilterSettings { history: 16, ..FilterSettings::default() });
        for s in samples {
            filter.advance(Input { v_mm_s: s[0], omega_rad_s: s[1] }, s[2]);
            let reading = Vector3::new(s[3], s[4], s[5]);
            filter.observe(Observation::Position(reading), s[2] - 0.01 * s[6]);
            filter.observe(Observation::Tangent(reading), s[7]);
            let belief = filter.belief();
            prop_assert!(belief.state.pose.is_finite());
            prop_assert!(belief.state.lag_rad.is_finite());
            prop_assert!(belief.state.needle.curvature_per_mm() >= 0.0);
            prop_assert!(belief.covariance.sum().is_finite());
            prop_assert!(belief.covariance.diagonal().min() >= 0.0);
        }
    }
}
