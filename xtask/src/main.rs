//! Repository commands. `cargo xtask sweep` regenerates the paper's figures; see `cargo xtask --help`.

mod bench_control;
mod sweep;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Commands of the needle-mpc repository.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Regenerate the paper's figures as data (CSV) and pictures (SVG, HTML).
    Sweep(sweep::Args),
    /// Run every controller in closed loop on every case and print the table.
    BenchControl(bench_control::Args),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Help and version are answers, not errors.
        Err(answer) if !answer.use_stderr() => answer.exit(),
        Err(error) => {
            let text = error.to_string();
            let first = text.lines().next().unwrap_or_default();
            say(&format!(
                "{first} (`cargo xtask --help` lists what there is)"
            ));
            return ExitCode::from(2);
        }
    };
    match cli.command {
        Command::Sweep(args) => ended(sweep::run(&args)),
        Command::BenchControl(args) => ended(bench_control::run(&args)),
    }
}

/// An error becomes a line and the exit code of failure.
fn ended<E: std::error::Error + 'static>(outcome: Result<(), E>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&format!("error: {}", chain(&error)));
            ExitCode::FAILURE
        }
    }
}

/// One line: the error and what caused it.
fn chain(error: &dyn std::error::Error) -> String {
    std::iter::successors(Some(error), |error| error.source())
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join(": ")
}

/// A line on standard error. That nobody reads it is no reason to stop.
fn say(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{line}");
}
