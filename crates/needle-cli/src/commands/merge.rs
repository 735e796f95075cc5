//! `needle merge`: chunks of a campaign to one file a kind, and the campaign in figures.

use crate::answer::{CliError, Verdict, print, print_json};
use needle_sim::campaign::{CampaignSummary, CellSummary, Spread, merge_from};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `needle merge`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder of a campaign's results; the merged files go there.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Folders with other chunks of the same campaign, computed on machines that share no disk.
    #[arg(value_name = "OTHER")]
    others: Vec<PathBuf>,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let summary = merge_from(&args.folder, &args.others)?;
    match args.json {
        true => print_json(&summary)?,
        false => print(&words(&summary, &args.folder))?,
    }
    Ok(Verdict::Yes)
}

/// A block of lines a cell.
pub(super) fn words(summary: &CampaignSummary, folder: &Path) -> String {
    let mut text = format!(
        "{} runs in {} cells; intervals are 95 %\n",
        summary.runs,
        summary.cells.len()
    );
    for cell in &summary.cells {
        // Writing to a string cannot fail.
        let _ = write!(text, "\n{}", of_cell(cell));
    }
    let _ = writeln!(text, "\nresults: {}", folder.display());
    text
}

fn of_cell(cell: &CellSummary) -> String {
    let spread = |name: &str, spread: &Option<Spread>, digits: usize| match spread {
        None => format!("  {name:<34} -\n"),
        Some(spread) => {
            let ends = spread.mean.low.zip(spread.mean.high);
            let ends = ends.map(|(low, high)| format!(" [{low:.digits$}, {high:.digits$}]"));
            format!(
                "  {name:<34} mean {:.digits$}{}, median {:.digits$}, 95 % {:.digits$}, worst {:.digits$}{}\n",
                spread.mean.value,
                ends.unwrap_or_default(),
                spread.median.value,
                spread.p95.value,
                spread.worst,
                match spread.count == cell.runs {
                    true => String::new(),
                    false => format!(" ({} of {} runs)", spread.count, cell.runs),
                },
            )
        }
    };
    let fallbacks = &cell.fallbacks;
    let cause = |name, cause: needle_sim::campaign::Cause| {
        format!("{name} {} in {} runs", cause.steps, cause.runs)
    };
    let causes = [
        cause("degraded", fallbacks.degraded),
        cause("earlier plan", fallbacks.shifted_plan),
        cause("no plan", fallbacks.no_plan),
        cause("no measurement", fallbacks.no_measurement),
    ];
    let success = &cell.success;
    let pareto = if cell.pareto {
        ", on the Pareto front"
    } else {
        ""
    };
    [
        format!("{} ({} runs{pareto})\n", cell.label(), cell.runs),
        format!(
            "  {:<34} {:.2} % [{:.2}, {:.2}], {} of {}; {} refused\n",
            "success (worst and end below 1 mm)",
            100.0 * success.share,
            100.0 * success.low,
            100.0 * success.high,
            success.count,
            success.of,
            cell.refused
        ),
        spread("RMS distance, mm", &cell.rms_mm, 4),
        spread("95 % distance, mm", &cell.p95_mm, 4),
        spread("worst distance, mm", &cell.max_mm, 4),
        spread("distance to the end, mm", &cell.final_mm, 4),
        spread("rotation, revolutions", &cell.rotation_rev, 3),
        spread("median step, us", &cell.step_median_us, 1),
        spread("longest step, us", &cell.step_worst_us, 1),
        format!(
            "  {:<34} {} of {} samples\n",
            "fallbacks",
            causes.join(", "),
            cell.steps
        ),
    ]
    .concat()
}
