//! Scenarios that nobody would write: whatever comes in, an answer comes out, and soon.

use crate::scenario_files::{SOUND, preset};
use needle_sim::scenario::Document;
use needle_sim::{Experiment, Scenario};
use proptest::prelude::*;
use toml::Value;

/// Every key that a preset writes out, as dotted paths.
fn keys_of(table: &toml::Table, prefix: &str, keys: &mut Vec<String>) {
    for (key, value) in table {
        let path = format!("{prefix}{key}");
        match value {
            Value::Table(inner) => keys_of(inner, &format!("{path}."), keys),
            Value::Array(rows) if rows.iter().all(Value::is_table) => {
                for (i, row) in rows.iter().enumerate() {
                    keys_of(row.as_table().unwrap(), &format!("{path}.{i}."), keys);
                }
            }
            _ => keys.push(path.clone()),
        }
        keys.push(path);
    }
}

/// The keys of clinical with every default written out.
fn every_key() -> Vec<String> {
    let text = preset("clinical").scenario().unwrap().to_toml();
    let mut keys = Vec::new();
    keys_of(&text.parse().unwrap(), "", &mut keys);
    keys
}

fn number() -> impl Strategy<Value = Value> {
    prop_oneof![
        prop::sample::select(vec![
            0.0,
            -0.0,
            1.0,
            -1.0,
            1e-3,
            1e-12,
            1e6,
            1e300,
            f64::MIN_POSITIVE,
            f64::MAX,
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
        ]),
        -10.0..10.0,
        any::<f64>(),
    ]
    .prop_map(Value::Float)
}

/// Any TOML value, three levels deep.
fn value() -> impl Strategy<Value = Value> {
    let names = [
        "",
        "x",
        "rigid",
        "first_order",
        "wind_up",
        "filter",
        "raw",
        "perfect",
        "pid",
        "ltv",
        "lqr",
        "straight",
        "sliding_mode",
        "duty_cycled",
        "feed_forward",
        "paper_straight",
        "full",
        "none",
        "progress",
        "reference",
    ];
    let leaf = prop_oneof![
        4 => number(),
        2 => prop::sample::select(vec![0, 1, -1, 2, 7, 1000, i64::MAX, i64::MIN]).prop_map(Value::Integer),
        2 => prop::sample::select(names.to_vec()).prop_map(Value::from),
        1 => any::<bool>().prop_map(Value::Boolean),
    ];
    leaf.prop_recursive(3, 12, 4, |inner| {
        let key = prop::sample::select(vec![
            "kind",
            "name",
            "depth_mm",
            "factor",
            "time_constant_s",
            "x",
        ]);
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..7).prop_map(Value::Array),
            prop::collection::btree_map(key.prop_map(String::from), inner, 0..4)
                .prop_map(|entries| Value::Table(entries.into_iter().collect())),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// A tree of values is a scenario that reads back from its own text, or a list of faults that each say something.
    #[test]
    fn any_tree_is_a_scenario_or_told_what_is_wrong(
        edits in prop::collection::vec((prop::sample::select(every_key()), value()), 0..6),
    ) {
        let mut document = preset("clinical");
        for (key, value) in edits {
            // An edit may have replaced the table that a later one reaches into.
            let _ = document.set(&key, value);
        }
        match document.scenario() {
            Ok(scenario) => {
                let text = scenario.to_toml();
                prop_assert_eq!(Scenario::parse(&text).unwrap(), scenario, "{}", text);
            }
            Err(error) => {
                prop_assert!(!error.faults().is_empty());
                prop_assert!(error.faults().iter().all(|fault| !fault.key.is_empty()), "{error}");
            }
        }
    }

    /// Text that is a few bytes away from a scenario.
    #[test]
    fn any_text_is_a_scenario_or_told_what_is_wrong(
        at in 0..SOUND.len(),
        dropped in 0_usize..20,
        added in "[\\[\\]=\"'.0-9a-zé\n#{},-]{0,6}",
    ) {
        let end = (at + dropped).min(SOUND.len());
        let text = format!("{}{added}{}", &SOUND[..at], &SOUND[end..]);
        if let Err(error) = Scenario::parse(&text) {
            prop_assert!(!error.faults().is_empty(), "{error}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// What a file may say can be run for a second: an error, or a summary of finite numbers.
    #[test]
    fn any_scenario_that_reads_also_runs(
        base in prop::sample::select(vec!["clinical", "phantom", "paper"]),
        name in prop::sample::select(vec!["nmpc", "ltv", "pid", "lqr", "sliding_mode", "duty_cycled", "feed_forward"]),
        edits in prop::collection::vec((prop::sample::select(every_key()), value()), 0..3),
        index in any::<u64>(),
    ) {
        let mut document: Document = preset(base);
        let controller = toml::Table::from_iter([("name".to_owned(), name.into())]);
        document.set("controller", controller).unwrap();
        for (key, value) in edits {
            // Horizons and sample times of their own would only make it slow.
            if !key.starts_with("controller") && key != "dt_s" {
                let _ = document.set(&key, value);
            }
        }
        document.set("duration_s", 1.0).unwrap();
        let Ok(scenario) = document.scenario() else {
            return Ok(());
        };
        // An error is an answer, too: a controller may refuse the path.
        if let Ok(experiment) = Experiment::new(&scenario) {
            let summary = experiment.summarise(index).unwrap();
            let figures = [Some(summary.final_mm), summary.rms_mm, summary.max_mm, Some(summary.rotation_rev)];
            let finite = figures.into_iter().flatten().all(f64::is_finite);
            prop_assert!(finite, "{summary:?}");
        }
    }
}
