//! `needle check`: what can be said of a scenario before anything moves.

use crate::answer::{CliError, Verdict, print, print_json};
use crate::scenario_arguments::ScenarioArgs;
use needle_sim::check::{CheckReport, check};
use std::fmt::Write;

/// Arguments of `needle check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let report = check(&args.scenario.read()?)?;
    match args.json {
        true => print_json(&report)?,
        false => print(&words(&report))?,
    }
    Ok(report.objections.is_empty().into())
}

fn words(report: &CheckReport) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "path: {:.2} mm in {:.2} s, {} poses; the needle {} (largest defect {:.1e})",
        report.length_mm,
        report.duration_s,
        report.poses,
        match report.executable {
            true => "executes its inputs",
            false => "does not execute its inputs, it is followed as a curve",
        },
        report.largest_defect,
    );
    if let Some(fit) = &report.fit {
        let _ = writeln!(
            text,
            "what the needle executes, and the controller has, is {:.4} mm RMS from it, {:.4} mm at worst",
            fit.rms_mm, fit.worst_mm,
        );
    }
    let curvature = &report.curvature;
    let _ = match report.executable {
        // Such a path bends as the needle does wherever it goes; what is left for corrections is in its spin.
        true => writeln!(
            text,
            "curvature: the needle's own all along, {:.3e} per mm",
            curvature.needle_per_mm,
        ),
        false => writeln!(
            text,
            "curvature: path at most {:.3e} per mm (at {:.1} mm), needle {:.3e}, margin {:.1} %",
            curvature.path_per_mm,
            curvature.at_mm,
            curvature.needle_per_mm,
            100.0 * curvature.margin,
        ),
    };
    if let Some(c) = &report.controllability {
        let _ = writeln!(
            text,
            "controllable errors: {} of 6 (first {} samples)",
            c.dimension, c.samples
        );
        for direction in &c.uncontrollable {
            let _ = writeln!(text, "  no input corrects: {direction}");
        }
        if let Some(weakest) = &c.weakest {
            let _ = writeln!(text, "  costliest to correct: {weakest}");
        }
        for warning in &c.warnings {
            let _ = writeln!(text, "  warning: {warning}");
        }
    }
    for excess in &report.limits {
        let _ = writeln!(
            text,
            "limit: the path's own inputs ask for {:.4} at sample {}, {} is {:.4}",
            excess.wanted, excess.step, excess.limit, excess.allowed,
        );
    }
    if let Some(terminal) = &report.terminal {
        let _ = writeln!(
            text,
            "terminal ingredients of {}: {terminal}",
            report.controller
        );
    }
    for refused in &report.refused_terminals {
        let _ = writeln!(text, "  refused: {refused}");
    }
    if let (Some(certificate), Some(shown)) =
        (&report.certificate, report.certificate_on_a_screen())
    {
        let (all, some) = (certificate.checks.len(), shown.checks.len());
        if some < all {
            let _ = writeln!(
                text,
                "of {all} checks those that fail and the tightest of each kind (all with --json):"
            );
        }
        let _ = write!(text, "{shown}");
    }
    match report.objections.as_slice() {
        [] => text.push_str("nothing stands against running it\n"),
        objections => {
            for objection in objections {
                let _ = writeln!(text, "objection: {objection}");
            }
        }
    }
    text
}
