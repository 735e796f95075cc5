//! The loop: a run is a function of seed and index, the plant is exact and its own, every controller can be named.

use crate::scenario_files::{SOUND, preset};
use needle_model::{Needle, ReferencePath};
use needle_sim::record::{OriginRecord, RunSummary};
use needle_sim::scenario::Document;
use needle_sim::{Experiment, Scenario, run};

/// 50 mm of a helix that the needle executes, with rates that allow a start at speed.
pub(crate) const HELIX: &str = "\
needle.curvature_per_mm = 0.0066666667
reference.kind = 'inputs'
controller.name = 'feed_forward'
[[reference.segments]]
duration_s = 10.0
v_mm_s = 5.0
omega_rad_s = 0.5
[limits]
v_rate_max_mm_s2 = 1e4
omega_rate_max_rad_s2 = 1e4
";

/// Without the two figures that depend on the machine.
pub(crate) fn untimed(summary: RunSummary) -> RunSummary {
    RunSummary {
        step_median_us: 0.0,
        step_worst_us: 0.0,
        ..summary
    }
}

fn with(text: &str, edits: &[(&str, toml::Value)]) -> Scenario {
    let mut document = Document::parse(text).unwrap();
    for (key, value) in edits {
        document.set(key, value.clone()).unwrap();
    }
    document.scenario().unwrap()
}

#[test]
fn a_run_depends_on_seed_and_index_alone_whatever_the_order_and_the_thread() {
    let experiment = Experiment::new(&preset("clinical").scenario().unwrap()).unwrap();
    let forwards: Vec<_> = (0..4)
        .map(|i| untimed(experiment.summarise(i).unwrap()))
        .collect();
    let backwards = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..4)
            .rev()
            .map(|i| {
                scope.spawn({
                    let experiment = &experiment;
                    move || experiment.summarise(i).unwrap()
                })
            })
            .collect();
        handles
            .into_iter()
            .map(|handle| untimed(handle.join().unwrap()))
            .rev()
            .collect::<Vec<_>>()
    });
    assert_eq!(forwards, backwards);
    // And they differ from each other.
    assert!(
        forwards
            .windows(2)
            .all(|pair| pair[0].rms_mm != pair[1].rms_mm)
    );
}

#[test]
fn another_seed_is_another_run() {
    let summary = |seed: i64| {
        let mut document = preset("clinical");
        document.set("seed", seed).unwrap();
        run(&document.scenario().unwrap(), 0).unwrap().summary
    };
    assert_ne!(summary(1).rms_mm, summary(2).rms_mm);
}

#[test]
fn the_record_and_the_summary_are_of_one_run() {
    let experiment = Experiment::new(&preset("phantom").scenario().unwrap()).unwrap();
    let record = experiment.record(3).unwrap();
    assert_eq!(
        untimed(record.summary.clone()),
        untimed(experiment.summarise(3).unwrap())
    );
    assert_eq!(record.steps.len() as u64, record.summary.steps);
    let length = record.steps.last().unwrap().progress_mm;
    let settled = record
        .steps
        .iter()
        .filter(|step| step.progress_mm > 0.2 * length);
    let squares: Vec<f64> = settled.map(|step| step.distance_mm.powi(2)).collect();
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    // The last progress is within 0.02 mm of the path's length: a sample more or less at the fifth.
    assert!((rms - record.summary.rms_mm.unwrap()).abs() < 1e-3);
    assert_eq!(
        record.steps.last().unwrap().origin,
        OriginRecord::StopPathEnd
    );
}

#[test]
fn a_record_survives_json() {
    let record = run(&Scenario::parse(SOUND).unwrap(), 0).unwrap();
    let text = serde_json::to_string(&record).unwrap();
    let again: needle_sim::RunRecord = serde_json::from_str(&text).unwrap();
    // The fewest digits that read back: `float_roundtrip` is not on, so a last digit may differ.
    assert_eq!(again.steps.len(), record.steps.len());
    assert_eq!(again.scenario_toml, record.scenario_toml);
    let (a, b) = (&again.steps[30].tip, &record.steps[30].tip);
    assert!((a.position_mm[2] - b.position_mm[2]).abs() < 1e-12);
}

#[test]
fn feed_forward_on_the_models_own_needle_stays_on_the_path() {
    let summary = run(&Scenario::parse(HELIX).unwrap(), 0).unwrap().summary;
    // Rounding of a thousand compositions.
    assert!(summary.max_mm.unwrap() < 1e-9, "{summary:?}");
    assert!(summary.success);
    // 10 s at 0.5 rad/s.
    assert!((summary.omega_integral_rad - 5.0).abs() < 1e-9);
}

#[test]
fn the_plant_has_a_curvature_of_its_own() {
    // A planar arc of 50 mm whose plant bends by half: the ends of both arcs in closed form.
    let scenario = with(
        HELIX,
        &[
            ("reference.segments.0.omega_rad_s", 0.0.into()),
            ("plant.curvature_factor", 0.5.into()),
        ],
    );
    let record = run(&scenario, 0).unwrap();
    let end = |kappa: f64| {
        [
            0.0,
            ((kappa * 50.0).cos() - 1.0) / kappa,
            (kappa * 50.0).sin() / kappa,
        ]
    };
    let [kappa, tip] = [scenario.curvature_per_mm, 0.5 * scenario.curvature_per_mm].map(end);
    let apart = (0..3)
        .map(|i| (kappa[i] - tip[i]).powi(2))
        .sum::<f64>()
        .sqrt();
    assert!(
        (record.summary.final_mm - apart).abs() < 1e-9,
        "{}",
        record.summary.final_mm
    );
    let position = record.steps.last().unwrap().tip.position_mm;
    assert!(
        (0..3).all(|i| (position[i] - tip[i]).abs() < 1e-9),
        "{position:?}"
    );
}

#[test]
fn torsional_lag_turns_the_tip_later_than_the_base() {
    let kind = toml::Table::from_iter([
        ("kind".to_owned(), "first_order".into()),
        ("time_constant_s".to_owned(), 1.0.into()),
    ]);
    let lagged = run(&with(HELIX, &[("plant.torsion", kind.into())]), 0).unwrap();
    // In the long run the tip is one time constant late: half a radian at 0.5 rad/s.
    assert!(lagged.summary.max_mm.unwrap() > 0.1, "{:?}", lagged.summary);
}

#[test]
fn a_start_that_is_off_is_off_by_what_the_scenario_says() {
    let offset: toml::Value = vec![0.3, -0.4, 0.0].into();
    let record = run(&with(HELIX, &[("plant.start.offset_mm", offset)]), 0).unwrap();
    assert!((record.steps[0].distance_mm - 0.5).abs() < 1e-3);
    assert_eq!(record.steps[0].tip.position_mm, [0.3, -0.4, 0.0]);
}

#[test]
fn disturbances_of_the_tissue_grow_with_the_root_of_the_insertion() {
    let scenario = with(
        HELIX,
        &[
            (
                "plant.disturbances.position_std_mm_per_sqrt_mm",
                0.01.into(),
            ),
            ("reference.segments.0.omega_rad_s", 0.0.into()),
            ("needle.curvature_per_mm", 0.0.into()),
        ],
    );
    let experiment = Experiment::new(&scenario).unwrap();
    let runs = 200_u32;
    let squares = (0..runs).map(|i| experiment.summarise(i.into()).unwrap().final_mm.powi(2));
    let variance = squares.sum::<f64>() / f64::from(runs) / 3.0;
    // 0.01^2 * 50 mm in each of 3 directions; 600 squares have a relative deviation of sqrt(2 / 600), four times that is 0.23.
    assert!((variance / 0.005 - 1.0).abs() < 0.23, "{variance}");
}

#[test]
fn every_controller_can_be_named_and_follows_a_helix() {
    for (name, most_mm) in [
        ("nmpc", 0.1),
        ("ltv", 0.1),
        ("pid", 0.3),
        ("lqr", 0.1),
        ("sliding_mode", 0.3),
        ("duty_cycled", 1.0),
        ("feed_forward", 1.0),
    ] {
        // The default limits take two samples to reach the speed: feed-forward is late, and stays it.
        let text = HELIX.replace("feed_forward", name).replace("1e4", "50.0");
        let record = run(&Scenario::parse(&text).unwrap(), 0).unwrap();
        let summary = &record.summary;
        assert!(summary.max_mm.unwrap() < most_mm, "{name}: {summary:?}");
        assert_eq!(summary.status, "finished", "{name}: {summary:?}");
        assert_eq!(
            !record.steps[0].predicted_mm.is_empty(),
            ["nmpc", "ltv"].contains(&name)
        );
    }
}

#[test]
fn the_straight_controller_follows_a_straight_path() {
    let scenario = with(
        &HELIX.replace("feed_forward", "straight"),
        &[("needle.curvature_per_mm", 0.0.into())],
    );
    let record = run(&scenario, 0).unwrap();
    assert!(record.summary.success, "{:?}", record.summary);
    assert!(record.certificate.unwrap().holds());
}

#[test]
fn a_run_that_the_duration_ends_is_no_success() {
    let summary = run(&with(HELIX, &[("duration_s", 5.0.into())]), 0)
        .unwrap()
        .summary;
    assert_eq!(
        (summary.status.as_str(), summary.success, summary.steps),
        ("duration_over", false, 50)
    );
}

#[test]
fn a_needle_that_stops_short_on_the_path_is_no_success() {
    let scenario = with(
        "needle.curvature_per_mm = 0.0\nreference.kind = 'inputs'\ncontroller.name = 'feed_forward'\n[[reference.segments]]\n\
         duration_s = 10.0\nv_mm_s = 5.0\nomega_rad_s = 0.0\n[limits]\nv_rate_max_mm_s2 = 1e4\n",
        &[("plant.start.offset_mm", vec![0.0, 0.0, -10.0].into())],
    );
    let summary = run(&scenario, 0).unwrap().summary;
    // It is on the line all along and ends 10 mm behind the end.
    assert!(summary.max_mm.unwrap() < 1e-6, "{summary:?}");
    assert!((summary.final_mm - 10.0).abs() < 1e-6, "{summary:?}");
    assert!(!summary.success, "{summary:?}");
}

#[test]
fn the_published_program_refuses_another_needle_and_another_sample_time() {
    for (key, value) in [("dt_s", 0.2), ("needle.curvature_per_mm", 0.01)] {
        let name = ("controller.name", toml::Value::from("published"));
        let scenario = with(
            needle_sim::scenario::Preset::named("clinical")
                .unwrap()
                .toml,
            &[name, (key, value.into())],
        );
        let error = Experiment::new(&scenario).unwrap_err();
        let cause = std::error::Error::source(&error).unwrap().to_string();
        assert!(cause.starts_with(key), "{cause}");
    }
}

#[test]
fn a_reconstructed_curve_is_executed_by_the_needle_and_judged_by_the_curve() {
    let scenario = with(
        HELIX,
        &[
            ("reference.curvature_factor", 0.5.into()),
            ("reference.segments.0.omega_rad_s", 0.05.into()),
            ("reference.reconstructed", true.into()),
        ],
    );
    let experiment = Experiment::new(&scenario).unwrap();
    let needle = Needle::new(scenario.curvature_per_mm).unwrap();
    let defect = |path: &ReferencePath| path.largest_defect(needle).unwrap().unwrap().1.norm();
    // Executed by construction; the curve itself bends by 0.0017 rad a sample less than the needle.
    assert!(defect(experiment.steered_path()) < 1e-9);
    assert!(defect(experiment.path()) > 1e-3);
    // The spinning needle winds about the curve by some hundredths of a millimetre.
    let rms_mm = experiment.summarise(0).unwrap().rms_mm.unwrap();
    assert!(rms_mm > 1e-3 && rms_mm < 0.06, "{rms_mm}");
}
