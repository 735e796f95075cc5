//! The rows of a campaign: what each run had and how it ended, and the rows of tracks.

use super::plan::{Parameter, ParameterKind};
use super::table::{Cells, Column, Table};
use super::variation::number;
use crate::record::{RunRecord, RunSummary, StepRecord};
use toml::Value;

/// Columns that depend on the machine. They are stored with their run, and merged into a file of their own.
pub(super) const TIMES: [&str; 2] = ["step_median_us", "step_worst_us"];

/// Status of a run that could not be made: what was drawn is none that a scenario can hold, or no controller or path exists for it.
pub(super) const REFUSED: &str = "refused";

/// A run that was computed, or refused.
#[derive(Debug)]
pub(super) struct Row {
    pub(super) run: u64,
    pub(super) cell: u64,
    pub(super) trial: u64,
    pub(super) parameters: Vec<Value>,
    /// The run in figures, or why there is none.
    pub(super) outcome: Result<RunSummary, String>,
}

/// A row a run.
pub(super) fn runs(parameters: &[Parameter], rows: &[Row]) -> Table {
    let counted = |value: fn(&Row) -> u64| rows.iter().map(|row| Some(value(row) as i64)).collect();
    let mut columns = vec![
        column("run", Cells::Whole(counted(|row| row.run))),
        column("cell", Cells::Whole(counted(|row| row.cell))),
        column("trial", Cells::Whole(counted(|row| row.trial))),
    ];
    for (i, parameter) in parameters.iter().enumerate() {
        let values = rows.iter().map(|row| &row.parameters[i]);
        columns.push(column(&parameter.key, cells(parameter.kind, values)));
    }
    let status = |row: &Row| match &row.outcome {
        Ok(summary) => summary.status.clone(),
        Err(_) => REFUSED.into(),
    };
    columns.push(column(
        "status",
        Cells::Text(rows.iter().map(|row| Some(status(row))).collect()),
    ));
    columns.extend(figures(rows));
    let why = |row: &Row| row.outcome.as_ref().err().cloned();
    columns.push(column(
        "refusal",
        Cells::Text(rows.iter().map(why).collect()),
    ));
    Table { columns }
}

/// The figures of the runs; null where a run was refused.
fn figures(rows: &[Row]) -> Vec<Column> {
    let numbers = |name, value: fn(&RunSummary) -> Option<f64>| {
        let cell = |row: &Row| row.outcome.as_ref().ok().and_then(value);
        column(name, Cells::Number(rows.iter().map(cell).collect()))
    };
    let counts = |name, value: fn(&RunSummary) -> u64| {
        let cell = |row: &Row| row.outcome.as_ref().ok().map(|s| value(s) as i64);
        column(name, Cells::Whole(rows.iter().map(cell).collect()))
    };
    let success = |row: &Row| row.outcome.as_ref().ok().map(|summary| summary.success);
    vec![
        column("success", Cells::Flag(rows.iter().map(success).collect())),
        counts("steps", |s| s.steps),
        numbers("rms_mm", |s| s.rms_mm),
        numbers("p95_mm", |s| s.p95_mm),
        numbers("max_mm", |s| s.max_mm),
        numbers("final_mm", |s| Some(s.final_mm)),
        numbers("progress_mm", |s| Some(s.progress_mm)),
        numbers("rotation_rev", |s| Some(s.rotation_rev)),
        numbers("omega_integral_rad", |s| Some(s.omega_integral_rad)),
        counts("degraded_steps", |s| s.degraded_steps),
        counts("shifted_plan_steps", |s| s.shifted_plan_steps),
        counts("no_plan_steps", |s| s.no_plan_steps),
        counts("no_measurement_steps", |s| s.no_measurement_steps),
        counts("iterations", |s| s.iterations),
        numbers(TIMES[0], |s| Some(s.step_median_us)),
        numbers(TIMES[1], |s| Some(s.step_worst_us)),
    ]
}

/// Every `every`th sample of a run and the last one: what its track keeps.
pub(super) fn thinned(record: RunRecord, every: u64) -> Vec<StepRecord> {
    let last = record.steps.len().saturating_sub(1);
    let mut steps = record.steps;
    steps.retain(|step| step.step as u64 % every == 0 || step.step == last);
    for step in &mut steps {
        // By far the largest part of a sample, and no column.
        step.predicted_mm = Vec::new();
    }
    steps
}

/// A row a sample that is kept, with its run.
pub(super) fn tracks(rows: &[(u64, StepRecord)]) -> Table {
    let whole = |name, value: fn(&(u64, StepRecord)) -> u64| {
        let cells = rows.iter().map(|row| Some(value(row) as i64));
        column(name, Cells::Whole(cells.collect()))
    };
    let numbers = |name, value: fn(&StepRecord) -> f64| {
        let cells = rows.iter().map(|(_, step)| Some(value(step)));
        column(name, Cells::Number(cells.collect()))
    };
    let columns = vec![
        whole("run", |(run, _)| *run),
        whole("step", |(_, step)| step.step as u64),
        numbers("time_s", |step| step.time_s),
        numbers("x_mm", |step| step.tip.position_mm[0]),
        numbers("y_mm", |step| step.tip.position_mm[1]),
        numbers("z_mm", |step| step.tip.position_mm[2]),
        numbers("distance_mm", |step| step.distance_mm),
        numbers("progress_mm", |step| step.progress_mm),
        numbers("v_mm_s", |step| step.input.v_mm_s),
        numbers("omega_rad_s", |step| step.input.omega_rad_s),
    ];
    Table { columns }
}

fn column(name: &str, cells: Cells) -> Column {
    Column {
        name: name.into(),
        cells,
    }
}

fn cells<'a>(kind: ParameterKind, values: impl Iterator<Item = &'a Value>) -> Cells {
    match kind {
        ParameterKind::Whole => Cells::Whole(values.map(Value::as_integer).collect()),
        ParameterKind::Number => Cells::Number(values.map(number).collect()),
        ParameterKind::Flag => Cells::Flag(values.map(Value::as_bool).collect()),
        ParameterKind::Text => Cells::Text(values.map(|value| Some(words(value))).collect()),
    }
}

/// Text as it is, anything else as TOML writes it.
fn words(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(rows) => {
            let rows: Vec<_> = rows.iter().map(words).collect();
            format!("[{}]", rows.join(", "))
        }
        Value::Table(table) => {
            let entries = table.iter();
            let entries: Vec<_> = entries
                .map(|(k, v)| format!("{k} = {}", words(v)))
                .collect();
            entries.join(", ")
        }
        Value::Float(number) => format!("{number:?}"),
        Value::Integer(number) => number.to_string(),
        Value::Boolean(flag) => flag.to_string(),
        Value::Datetime(date) => date.to_string(),
    }
}
