//! The head of a report: what was run, how it ended, in words and figures.

use crate::record::{RunRecord, RunSummary};
use crate::scenario::Scenario;

/// A figure with its name.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fact {
    pub(super) name: &'static str,
    pub(super) value: String,
    /// Whether it should worry the reader.
    pub(super) alarming: bool,
}

fn fact(name: &'static str, value: String) -> Fact {
    Fact {
        name,
        value,
        alarming: false,
    }
}

/// The figures of a run.
pub(super) fn of_run(record: &RunRecord) -> Vec<Fact> {
    let summary = &record.summary;
    let mut facts = vec![
        Fact {
            name: "ended",
            value: summary.status.replace('_', " "),
            alarming: summary.status != "finished",
        },
        Fact {
            name: "worst and end below 1 mm",
            value: if summary.success { "yes" } else { "no" }.into(),
            alarming: !summary.success,
        },
        fact("RMS distance", millimetres(summary.rms_mm)),
        fact("95 % below", millimetres(summary.p95_mm)),
        fact("worst", millimetres(summary.max_mm)),
        fact("at the end", millimetres(Some(summary.final_mm))),
        fact("path covered", format!("{:.1} mm", summary.progress_mm)),
        fact("rotation", format!("{:.2} rev", summary.rotation_rev)),
        fact("samples", summary.steps.to_string()),
        fact("solver iterations", summary.iterations.to_string()),
        fact("step, median", microseconds(summary.step_median_us)),
        fact("step, longest", microseconds(summary.step_worst_us)),
    ];
    facts.extend(fallbacks(summary));
    facts
}

fn fallbacks(summary: &RunSummary) -> Vec<Fact> {
    let causes = [
        ("soft limit violated", summary.degraded_steps),
        ("earlier plan", summary.shifted_plan_steps),
        ("stop: no plan", summary.no_plan_steps),
        ("stop: no measurement", summary.no_measurement_steps),
    ];
    let happened = causes.iter().filter(|(_, steps)| *steps > 0);
    let facts: Vec<Fact> = happened
        .map(|&(name, steps)| Fact {
            name,
            value: format!("{steps} samples"),
            alarming: true,
        })
        .collect();
    if facts.is_empty() {
        return vec![fact("fallbacks", "none".into())];
    }
    facts
}

/// What was run, in one line.
pub(super) fn subtitle(record: &RunRecord, scenario: Option<&Scenario>) -> String {
    let RunSummary {
        run_index, seed, ..
    } = record.summary;
    let run = format!("seed {seed}, run {run_index}");
    let Some(scenario) = scenario else {
        return run;
    };
    let controller = scenario.controller.name();
    let (dt_s, curvature) = (scenario.dt_s, scenario.curvature_per_mm);
    format!("controller {controller}, curvature {curvature:.4} per mm, sample time {dt_s} s, {run}")
}

fn millimetres(value: Option<f64>) -> String {
    match value {
        Some(value) if value.is_finite() => format!("{value:.3} mm"),
        Some(_) => "not finite".into(),
        None => "–".into(),
    }
}

fn microseconds(value: f64) -> String {
    match value {
        value if value >= 1e4 => format!("{:.1} ms", value / 1e3),
        value => format!("{value:.0} µs"),
    }
}
