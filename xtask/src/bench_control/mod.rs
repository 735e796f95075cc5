//! `cargo xtask bench-control`: every controller in closed loop on every case of `docs/controllers.md`, as a table, and the committed
//! figures to compare with.

mod cases;
mod closed_loop;
mod controllers;
mod golden;

use cases::{CaseError, Sensing};
use closed_loop::Score;
use needle_sim::output::OutputError;
use std::io::Write;

/// Options of `cargo xtask bench-control`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Print nothing but what differs from the golden table in the repository; exit with 1 if anything does.
    #[arg(long)]
    check: bool,
    /// Replace the golden table by what is computed now.
    #[arg(long, conflicts_with = "check")]
    bless: bool,
}

/// Why the table could not be made, or differs.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BenchError {
    #[error("{controller} on the case `{case}`")]
    Run {
        case: &'static str,
        controller: &'static str,
        source: CaseError,
    },
    #[error("the cases cannot be set up")]
    Setup(#[source] CaseError),
    #[error(transparent)]
    Golden(#[from] golden::GoldenError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("cannot print the table")]
    Print(#[source] std::io::Error),
}

/// One controller on one case.
#[derive(Debug, Clone)]
struct Row {
    case: &'static str,
    /// Whether the controller sees noise or an estimate.
    noisy: bool,
    controller: &'static str,
    score: Score,
}

/// Computes, then prints, checks or blesses.
pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let mut rows = Vec::new();
    let mut executed_paths = controllers::ExecutedPaths::default();
    for case in cases::all().map_err(BenchError::Setup)? {
        let of = |controller| {
            move |source| BenchError::Run {
                case: case.name,
                controller,
                source,
            }
        };
        let executed = executed_paths.of(&case).map_err(of("reconstruction"))?;
        for controller in controllers::NAMES {
            let score = controllers::make(controller, &case, &executed)
                .and_then(|mut made| closed_loop::run(&case, made.as_mut()))
                .map_err(of(controller))?;
            rows.push(Row {
                case: case.name,
                noisy: case.sensing != (Sensing::Pose { noise_mm: 0.0 }),
                controller,
                score,
            });
        }
    }
    if args.check {
        return Ok(golden::check(&rows)?);
    }
    if args.bless {
        return Ok(golden::bless(&rows)?);
    }
    print(&rows).map_err(BenchError::Print)
}

/// The table in Markdown.
fn print(rows: &[Row]) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "| case | controller | RMS mm | max mm | final mm | rotation rev | integral of spin rad | median step us | worst step us |"
    )?;
    writeln!(
        out,
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    )?;
    for Row {
        case,
        controller,
        score,
        ..
    } in rows
    {
        writeln!(
            out,
            "| {case} | {controller} | {:.4} | {:.3} | {:.3} | {:.1} | {:.1} | {:.0} | {:.0} |",
            score.rms_mm,
            score.max_mm,
            score.final_mm,
            score.rotation_rev,
            score.turned_rad,
            1e6 * score.median_step.as_secs_f64(),
            1e6 * score.worst_step.as_secs_f64(),
        )?;
    }
    Ok(())
}
