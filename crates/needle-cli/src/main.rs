//! The program `needle`: arguments in, results out, exit codes. Everything that is computed is computed by `needle-sim`.

mod answer;
mod commands;
mod scenario_arguments;

use answer::{CliError, Verdict, say};
use clap::{Parser, Subcommand};
use commands::{campaign, check, compare, merge, reference, report, run, schema};
use std::process::ExitCode;

/// Simulate, check and compare controllers of bevel-tip needles.
#[derive(Debug, Parser)]
#[command(
    name = "needle",
    version,
    after_help = "A first look:\n  needle run clinical          simulate a preset\n  needle schema --preset \
                  clinical > my.toml\n  needle check my.toml         what can be said before anything moves\n  needle \
                  run my.toml --report run.html   look at it in a browser\n\nExit codes: 0 done, 1 failed, 2 wrong call or scenario, 3 done and \
                  the answer is no."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulate one run of a scenario.
    Run(run::Args),
    /// Check a scenario before anything moves: path, limits, controllability, certificate.
    Check(check::Args),
    /// Run many runs of a scenario over a grid and random draws, on all cores; goes on where it stopped.
    Campaign(campaign::Args),
    /// Merge the chunks of a campaign into one file and sum them up.
    Merge(merge::Args),
    /// Run several scenarios under the same disturbances, side by side.
    Compare(compare::Args),
    /// Find the needle's states and inputs along positions from a CSV file.
    Reference(reference::Args),
    /// Show recorded runs or a campaign as HTML pages that open from disk.
    Report(report::Args),
    /// Print every key of a scenario with default, range and meaning, or a preset.
    Schema(schema::Args),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Prints help to standard output with code 0, errors to standard error with code 2.
        Err(answer) => answer.exit(),
    };
    let outcome = match cli.command {
        Command::Run(args) => run::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Campaign(args) => campaign::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Reference(args) => reference::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Schema(args) => schema::run(&args),
    };
    match outcome {
        Ok(Verdict::Yes) => ExitCode::SUCCESS,
        Ok(Verdict::No) => ExitCode::from(3),
        // Whoever read the output has seen enough.
        Err(CliError::Stdout(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => {
            ExitCode::SUCCESS
        }
        Err(error) => {
            say(&format!("error: {}", answer::chain(&error)));
            ExitCode::from(error.exit_code())
        }
    }
}
