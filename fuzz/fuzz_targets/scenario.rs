//! Any text is a scenario that reads back from its own TOML, or a list of faults; what reads can be run for half a second.
//!
//! `cargo +nightly fuzz run scenario fuzz/corpus/scenario crates/needle-sim/presets`

#![no_main]

use libfuzzer_sys::fuzz_target;
use needle_sim::scenario::Document;
use needle_sim::{Experiment, Scenario};

/// Samples that are run: short enough for thousands of inputs a second.
const SAMPLES: f64 = 5.0;

fuzz_target!(|text: &str| {
    let Ok(mut document) = Document::parse(text) else {
        return;
    };
    let scenario = match document.scenario() {
        Ok(scenario) => scenario,
        Err(error) => {
            assert!(!error.faults().is_empty());
            return;
        }
    };
    let again = Scenario::parse(&scenario.to_toml());
    // The folder is no part of the text.
    assert_eq!(again.ok(), Some(scenario.clone()));
    // No files of this machine, and nothing that is only long.
    if scenario.reference.file().is_some() || text.len() > 10_000 {
        return;
    }
    if document.set("duration_s", SAMPLES * scenario.dt_s).is_err() {
        return;
    }
    if let Ok(short) = document.scenario()
        && let Ok(experiment) = Experiment::new(&short)
        && let Ok(summary) = experiment.summarise(0)
    {
        assert!(summary.final_mm.is_finite());
    }
});
