//! Sensors: rate, delay, noise, losses, and what the estimator may not see.

use crate::closed_loops::{HELIX, untimed};
use crate::scenario_files::preset;
use needle_sim::record::{RunRecord, StepRecord};
use needle_sim::scenario::Document;
use needle_sim::{Scenario, run};

fn sensed(keys: &str) -> RunRecord {
    let text = format!("{HELIX}[sensors]\n{keys}\n");
    run(&Scenario::parse(&text).unwrap(), 0).unwrap()
}

fn readings(record: &RunRecord) -> Vec<(&StepRecord, needle_sim::record::ReadingRecord)> {
    record
        .steps
        .iter()
        .filter_map(|step| Some((step, step.measured?)))
        .collect()
}

#[test]
fn exact_sensors_see_the_tip_as_it_is() {
    let record = sensed("");
    assert_eq!(readings(&record).len(), record.steps.len());
    for (step, reading) in readings(&record) {
        // Sums of sub-steps against steps.
        assert!(
            (reading.taken_at_s - step.time_s).abs() < 1e-12,
            "{reading:?}"
        );
        assert_eq!(reading.position_mm, step.tip.position_mm);
    }
}

#[test]
fn a_reading_arrives_after_its_delay_at_the_next_sample() {
    let record = sensed("delay_s = 0.25");
    for (step, reading) in readings(&record) {
        // 0.25 s late, seen at samples of 0.1 s: an age of 0.3 s.
        assert!(
            (step.time_s - reading.taken_at_s - 0.3).abs() < 1e-9,
            "{reading:?}"
        );
        let then = &record.steps[(reading.taken_at_s / 0.1).round() as usize];
        // Floating sums of sub-steps against steps.
        assert!((reading.position_mm[2] - then.tip.position_mm[2]).abs() < 1e-12);
    }
    assert_eq!(readings(&record).len(), record.steps.len() - 3);
}

#[test]
fn a_slow_sensor_reads_every_third_sample() {
    let record = sensed("period_s = 0.3");
    for step in &record.steps {
        assert_eq!(step.measured.is_some(), step.step % 3 == 0, "{}", step.step);
    }
}

#[test]
fn a_sensor_faster_than_the_loop_is_read_between_samples() {
    let record = sensed("period_s = 0.02\ndelay_s = 0.01");
    for (step, reading) in readings(&record).iter().skip(1) {
        // The newest of five: taken 0.02 s before the sample.
        assert!(
            (step.time_s - reading.taken_at_s - 0.02).abs() < 1e-9,
            "{reading:?}"
        );
    }
}

#[test]
fn noise_has_the_deviation_that_the_scenario_says() {
    let record = sensed("position_std_mm = 0.2\ntangent_std_rad = 0.01\nperiod_s = 0.1");
    let errors = readings(&record).into_iter().flat_map(|(step, reading)| {
        (0..3).map(move |i| (reading.position_mm[i] - step.tip.position_mm[i]) / 0.2)
    });
    let errors: Vec<f64> = errors.collect();
    let variance = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
    // Some 300 deviates: four relative deviations sqrt(2 / 300) are 0.33.
    assert!(
        errors.len() > 290 && (variance - 1.0).abs() < 0.33,
        "{variance}"
    );
}

#[test]
fn lost_readings_are_as_frequent_as_the_scenario_says() {
    let record = sensed("dropout_probability = 0.5");
    let share = readings(&record).len() as f64 / record.steps.len() as f64;
    // 100 draws: four deviations of 0.05.
    assert!((share - 0.5).abs() < 0.2, "{share}");
    assert!(readings(&sensed("dropout_probability = 1.0")).is_empty());
}

/// The roll reaches the filter by no way: noise on it changes nothing.
#[test]
fn an_unmeasured_roll_is_seen_by_nobody() {
    let summary = |roll_std_rad: f64| {
        let mut document = preset("clinical");
        document.set("sensors.roll_std_rad", roll_std_rad).unwrap();
        untimed(run(&document.scenario().unwrap(), 0).unwrap().summary)
    };
    assert_eq!(summary(0.0), summary(1.0));
}

/// Purposes have streams of their own: another sensor leaves the drawn needle and its start alone.
#[test]
fn another_sensor_does_not_change_the_plant() {
    let first = |position_std_mm: f64| {
        let mut document = preset("clinical");
        document
            .set("sensors.position_std_mm", position_std_mm)
            .unwrap();
        document
            .set(
                "controller",
                toml::Table::from_iter([("name".to_owned(), "feed_forward".into())]),
            )
            .unwrap();
        run(&document.scenario().unwrap(), 0).unwrap().steps
    };
    let (quiet, noisy) = (first(0.01), first(0.5));
    assert!(quiet.iter().zip(&noisy).all(|(a, b)| a.tip == b.tip));
    assert!(quiet[5].measured != noisy[5].measured);
}

#[test]
fn an_outage_loses_as_many_readings_in_a_row_as_asked_for_from_where_single_ones_are_lost() {
    let lost = |keys: &str| -> Vec<bool> {
        let record = sensed(keys);
        let seen = |step: &StepRecord| step.measured.is_none();
        record.steps.iter().map(seen).collect()
    };
    let single = lost("dropout_probability = 0.1");
    let outages = lost("dropout_probability = 0.1\ndropout_readings = 4");
    // The same draws: an outage begins wherever one is lost, and goes on from the last of them.
    let expected: Vec<_> = (0..single.len())
        .map(|k| single[k.saturating_sub(3)..=k].contains(&true))
        .collect();
    assert_eq!(outages, expected);
    assert!(single.contains(&true) && expected.contains(&false));
}

/// Half of the readings lost, and all for about a second here and there: the filter predicts, the predictive controllers go on.
#[test]
fn with_half_of_the_readings_lost_the_needle_stays_near_the_path_and_the_limits_hold() {
    for controller in ["nmpc", "ltv"] {
        let text = format!(
            "needle.curvature_per_mm = 0.0066666667\ncontroller.name = '{controller}'\nestimator.kind = 'filter'\n\
             reference.kind = 'inputs'\nreference.curvature_factor = 0.5\nreference.reconstructed = {}\n\
             reference.segments = [{{ duration_s = 20.0, v_mm_s = 5.0, omega_rad_s = 0.05 }}]\n\
             sensors.roll_measured = false\nsensors.position_std_mm = 0.2\nsensors.tangent_std_rad = 0.01745\n\
             sensors.dropout_probability = 0.5\nplant.curvature_factor = 0.9\n",
            controller == "ltv"
        );
        let scenario = Scenario::parse(&text).unwrap();
        let mut worst_gap = 0;
        for index in 0..3 {
            let record = run(&scenario, index).unwrap();
            let (mut gap, mut held) = (0, [0.0; 2]);
            for step in &record.steps {
                gap = if step.measured.is_some() { 0 } else { gap + 1 };
                worst_gap = worst_gap.max(gap);
                let input = [step.input.v_mm_s, step.input.omega_rad_s];
                let limits = &scenario.limits;
                let rates = [limits.v_rate_max_mm_s2, limits.omega_rate_max_rad_s2];
                for i in 0..2 {
                    // Rounding of a sum.
                    assert!(
                        (input[i] - held[i]).abs() <= rates[i] * 0.1 + 1e-9,
                        "{step:?}"
                    );
                }
                assert!(
                    (limits.v_min_mm_s..=limits.v_max_mm_s).contains(&input[0]),
                    "{step:?}"
                );
                assert!(input[1].abs() <= limits.omega_max_rad_s, "{step:?}");
                held = input;
            }
            let (rms, max) = (
                record.summary.rms_mm.unwrap(),
                record.summary.max_mm.unwrap(),
            );
            // Of eight runs: 0.075 to 0.194 mm and 0.13 to 0.42 mm; with every reading 0.050 to 0.132 and 0.09 to 0.23.
            assert!(rms < 0.25 && max < 0.5, "{controller} {index}: {rms} {max}");
        }
        // Gaps of up to 0.8 s.
        assert!(worst_gap >= 5, "{worst_gap}");
    }
}

#[test]
fn without_readings_the_filter_reports_nothing_and_the_needle_stops() {
    let mut document: Document = preset("clinical");
    document.set("sensors.dropout_probability", 1.0).unwrap();
    let record = run(&document.scenario().unwrap(), 0).unwrap();
    let last = record.steps.last().unwrap();
    assert_eq!((last.input.v_mm_s, last.input.omega_rad_s), (0.0, 0.0));
    assert!(
        record.summary.no_measurement_steps > 0,
        "{:?}",
        record.summary
    );
    assert!(!record.summary.success);
}
