//! `needle run`: one run of a scenario, summed up, and recorded where asked.

use crate::answer::{CliError, Verdict, number, print, print_json};
use crate::scenario_arguments::ScenarioArgs;
use needle_sim::output::write_whole;
use needle_sim::record::StepRecord;
use needle_sim::report::run_report;
use needle_sim::{RunRecord, RunSummary, run as simulate};
use std::path::PathBuf;

/// Arguments of `needle run`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Index of the run: another index, other random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    index: u64,
    /// Write the whole run as JSON.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Write a row a sample as CSV.
    #[arg(long, value_name = "FILE")]
    track: Option<PathBuf>,
    /// Write a page for the browser: 3D scene, errors, inputs, solve times.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let scenario = args.scenario.read()?;
    let record = simulate(&scenario, args.index)?;
    if let Some(path) = &args.record {
        write_whole(path, &serde_json::to_vec(&record)?)?;
    }
    if let Some(path) = &args.track {
        write_whole(path, &track(&record)?)?;
    }
    if let Some(path) = &args.report {
        write_whole(path, run_report(&record)?.as_bytes())?;
    }
    match args.json {
        true => print_json(&record.summary)?,
        false => print(&words(scenario.controller.name(), &record.summary))?,
    }
    Ok(record.summary.success.into())
}

fn words(controller: &str, summary: &RunSummary) -> String {
    let RunSummary {
        run_index,
        seed,
        steps,
        status,
        success,
        ..
    } = summary;
    let mm = |value| number(value, 4);
    let verdict = if *success { "success" } else { "no success" };
    format!(
        "run {run_index} of seed {seed}: {controller}, {steps} samples, {status}, {verdict}\n\
         distance to the path after its first fifth: {} mm RMS, {} mm 95 %, {} mm worst\n\
         at the end: {:.4} mm from the path's end, {:.1} mm along the path\n\
         rotation: {:.2} revolutions; controller: {:.0} us a sample, {:.0} us worst\n\
         samples degraded {}, on an earlier plan {}, without plan {}, without measurement {}\n",
        mm(summary.rms_mm),
        mm(summary.p95_mm),
        mm(summary.max_mm),
        summary.final_mm,
        summary.progress_mm,
        summary.rotation_rev,
        summary.step_median_us,
        summary.step_worst_us,
        summary.degraded_steps,
        summary.shifted_plan_steps,
        summary.no_plan_steps,
        summary.no_measurement_steps,
    )
}

const TRACK_HEADER: [&str; 21] = [
    "step",
    "time_s",
    "x_mm",
    "y_mm",
    "z_mm",
    "qw",
    "qx",
    "qy",
    "qz",
    "estimated_x_mm",
    "estimated_y_mm",
    "estimated_z_mm",
    "ref_x_mm",
    "ref_y_mm",
    "ref_z_mm",
    "v_mm_s",
    "omega_rad_s",
    "distance_mm",
    "progress_mm",
    "origin",
    "step_us",
];

/// A row a sample.
fn track(record: &RunRecord) -> Result<Vec<u8>, CliError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(TRACK_HEADER)?;
    for step in &record.steps {
        let StepRecord {
            tip,
            reference,
            input,
            ..
        } = step;
        let estimated = step.estimated.map(|pose| pose.position_mm);
        let [ex, ey, ez] = [0, 1, 2].map(|i| estimated.map(|position| position[i]));
        writer.serialize((
            (step.step, step.time_s, tip.position_mm, tip.quaternion_wxyz),
            (ex, ey, ez, reference.position_mm),
            (input.v_mm_s, input.omega_rad_s),
            (
                step.distance_mm,
                step.progress_mm,
                step.origin,
                step.step_us,
            ),
        ))?;
    }
    let finished = writer.into_inner();
    finished.map_err(|error| CliError::Csv(error.into_error().into()))
}
