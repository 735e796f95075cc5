//! `cargo xtask bench-control`: every controller in closed loop on every case of `docs/controllers.md`, as a table, and the committed
//! figures to compare with. The loops are those of `needle-sim`: `--scenarios` writes them as files for `needle run`.

mod cases;
mod figures;
mod golden;

use cases::{CASES, CONTROLLERS, Case};
use figures::{Figure, Judged, Row};
use needle_sim::output::{self, OutputError};
use needle_sim::{RunError, ScenarioError};
use rayon::prelude::*;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Options of `cargo xtask bench-control`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Print nothing but what differs from the golden table in the repository; exit with 1 if anything does.
    #[arg(long)]
    check: bool,
    /// Replace the golden table by what is computed now.
    #[arg(long, conflicts_with = "check")]
    bless: bool,
    /// Run nothing; write each scenario of the table into this folder, for `needle run`.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["check", "bless"])]
    scenarios: Option<PathBuf>,
}

/// Why the table could not be made, or differs.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BenchError {
    #[error("{controller} on the case `{case}`")]
    Run {
        case: &'static str,
        controller: &'static str,
        source: Box<RunError>,
    },
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    #[error(transparent)]
    Golden(#[from] golden::GoldenError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("cannot print the table")]
    Print(#[source] std::io::Error),
}

/// Computes, then prints, checks or blesses.
pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let cells: Vec<(&Case, &'static str)> = CASES
        .iter()
        .flat_map(|case| CONTROLLERS.map(|controller| (case, controller)))
        .collect();
    if let Some(folder) = &args.scenarios {
        return write_scenarios(&cells, folder);
    }
    let compute = |&(case, controller): &(&Case, _)| Row::compute(case, controller);
    if args.check || args.bless {
        let rows = cells
            .par_iter()
            .map(compute)
            .collect::<Result<Vec<_>, _>>()?;
        let outcome = match args.check {
            true => golden::check(&rows),
            false => golden::bless(&rows),
        };
        return Ok(outcome?);
    }
    // One after the other: times are printed.
    let rows = cells.iter().map(compute).collect::<Result<Vec<_>, _>>()?;
    let mut out = std::io::stdout().lock();
    out.write_all(tables(&rows).as_bytes())
        .map_err(BenchError::Print)
}

fn write_scenarios(cells: &[(&Case, &'static str)], folder: &Path) -> Result<(), BenchError> {
    output::make_folder(folder)?;
    for (case, controller) in cells {
        if case.excludes(controller).is_none() {
            let words: Vec<_> = case
                .name
                .split(|c: char| !c.is_ascii_alphanumeric())
                .filter(|word| !word.is_empty())
                .collect();
            let file = format!("{}-{controller}.toml", words.join("-"));
            output::write_whole(&folder.join(file), case.scenario(controller).as_bytes())?;
        }
    }
    Ok(())
}

/// Two tables in Markdown: a summary, a row a case, and all figures. Those of several runs are mean and standard deviation.
fn tables(rows: &[Row]) -> String {
    let mut text = String::from(
        "Root mean square distance (of the last two rows: distance at the end), mm, and rotation, revolutions:\n\n",
    );
    let dashes = " --- |".repeat(1 + CONTROLLERS.len());
    // Writing to a string cannot fail.
    let _ = writeln!(text, "| case | {} |\n|{dashes}", CONTROLLERS.join(" | "));
    for of_case in rows.chunks(CONTROLLERS.len()) {
        let _ = write!(text, "| {} |", of_case[0].case);
        for row in of_case {
            match &row.judged {
                Some(Judged { figures, .. }) => {
                    let distance = worded(figures[row.main_column], 4, row.runs);
                    let _ = write!(text, " {distance}, {:.1} |", figures[3].mean);
                }
                None => text.push_str(" - |"),
            }
        }
        text.push('\n');
    }
    text.push_str(
        "\n| case | controller | RMS mm | max mm | final mm | rotation rev | integral of spin rad | median step us | worst step us |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for row in rows {
        let Some(judged) = &row.judged else {
            continue;
        };
        let _ = write!(text, "| {} | {} |", row.case, row.controller);
        for (figure, digits) in judged.figures.iter().zip([4, 3, 3, 1, 1]) {
            let _ = write!(text, " {} |", worded(*figure, digits, row.runs));
        }
        let [median, worst] = [judged.median_step_us, judged.worst_step_us];
        let _ = writeln!(text, " {median:.0} | {worst:.0} |");
    }
    text
}

fn worded(Figure { mean, spread }: Figure, digits: usize, runs: u64) -> String {
    match runs {
        1 => format!("{mean:.digits$}"),
        _ => format!("{mean:.digits$} ± {spread:.digits$}"),
    }
}
