//! `needle compare`: scenarios side by side, each over the same run indices, so that equal seeds mean equal disturbances.

use crate::answer::{CliError, Verdict, number, print, print_json};
use crate::scenario_arguments::read;
use needle_sim::{Experiment, RunSummary};
use serde::Serialize;

/// Arguments of `needle compare`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scenario files or names of presets, two or more.
    #[arg(value_name = "SCENARIO", num_args = 2.., required = true)]
    scenarios: Vec<String>,
    /// Set a key in all of them; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Runs of each.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    runs: u64,
    /// Print every run's summary as JSON.
    #[arg(long)]
    json: bool,
}

/// The runs of one scenario.
#[derive(Debug, Serialize)]
struct Compared {
    scenario: String,
    controller: &'static str,
    runs: Vec<RunSummary>,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let experiment = |name: &String| -> Result<Experiment, CliError> {
        Ok(Experiment::new(&read(name, &args.set)?)?)
    };
    // All of them first: a wrong file should not show after the others' runs.
    let experiments: Vec<Experiment> = args
        .scenarios
        .iter()
        .map(experiment)
        .collect::<Result<_, _>>()?;
    let mut compared = Vec::new();
    for (name, experiment) in args.scenarios.iter().zip(&experiments) {
        let runs = (0..args.runs).map(|index| experiment.summarise(index));
        compared.push(Compared {
            scenario: name.clone(),
            controller: experiment.scenario().controller.name(),
            runs: runs.collect::<Result<_, _>>()?,
        });
    }
    match args.json {
        true => print_json(&compared)?,
        false => print(&table(&compared))?,
    }
    Ok(Verdict::Yes)
}

const COLUMNS: [&str; 9] = [
    "scenario",
    "controller",
    "success",
    "rms mm",
    "95 % mm",
    "worst mm",
    "final mm",
    "revolutions",
    "us a sample",
];

/// Means over the runs; the worst distance is the worst of all.
fn table(compared: &[Compared]) -> String {
    let mut rows = vec![COLUMNS.map(String::from)];
    for Compared {
        scenario,
        controller,
        runs,
    } in compared
    {
        let mean = |of: &dyn Fn(&RunSummary) -> Option<f64>| {
            let values: Vec<f64> = runs.iter().filter_map(of).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let worst = runs.iter().filter_map(|run| run.max_mm).reduce(f64::max);
        let successes = runs.iter().filter(|run| run.success).count();
        rows.push([
            scenario.clone(),
            (*controller).into(),
            format!("{successes}/{}", runs.len()),
            number(mean(&|run| run.rms_mm), 4),
            number(mean(&|run| run.p95_mm), 4),
            number(worst, 4),
            number(mean(&|run| Some(run.final_mm)), 4),
            number(mean(&|run| Some(run.rotation_rev)), 2),
            number(mean(&|run| Some(run.step_median_us)), 0),
        ]);
    }
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max();
    let widths: Vec<usize> = (0..COLUMNS.len()).filter_map(width).collect();
    let line = |row: &[String; COLUMNS.len()]| {
        let cells = row.iter().zip(&widths).enumerate();
        let padded = cells.map(|(i, (cell, &width))| match i {
            0 | 1 => format!("{cell:width$}"),
            _ => format!("{cell:>width$}"),
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}
