//! `needle campaign`: many runs of one scenario on all cores, taken up where they stopped.

use crate::answer::{CliError, Verdict, print, print_json, say};
use crate::commands::merge::words;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use needle_sim::campaign::{Campaign, Execution, Shard, merge};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Arguments of `needle campaign`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A campaign file:\n  scenario = \"clinical\"        # a preset or a scenario file\n  seed = 1\n  \
                  runs_per_cell = 500\n  [grid]\n  controller.horizon = [10, 20, 40]\n  plant.curvature_factor = { from = 0.8, to \
                  = 1.2, steps = 5 }\n  [random]\n  sensors.position_std_mm = { distribution = \"log_uniform\", from = 0.05, to = \
                  0.5 }\n\nInterrupted or killed, the same command goes on where it stopped. docs/campaigns.md has all keys, \
                  docs/cluster.md shows job arrays."
)]
pub(crate) struct Args {
    /// Campaign file (TOML).
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Folder of the results; by default the campaign file's name without its ending.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Compute only share I of N (from 1/N to N/N) and do not merge; see `needle merge`.
    #[arg(long, value_name = "I/N", conflicts_with = "slurm")]
    shard: Option<Shard>,
    /// Threads; 0 for one a core.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Compute nothing: write scripts that run the campaign as a Slurm job array.
    #[arg(long)]
    slurm: bool,
    /// Tasks of the Slurm job array.
    #[arg(long, value_name = "N", default_value_t = 16, requires = "slurm",
          value_parser = clap::value_parser!(u64).range(1..=100_000))]
    tasks: u64,
    /// Compute nothing: print the scenario of one run, to be run alone.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["slurm", "shard", "json"])]
    print_run: Option<u64>,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let campaign = Campaign::load(&args.file)?;
    let folder = args
        .out
        .clone()
        .unwrap_or_else(|| args.file.with_extension(""));
    if folder == args.file {
        return Err(CliError::CampaignFolder { folder });
    }
    if let Some(run) = args.print_run {
        return print_run(&campaign, run);
    }
    if args.slurm {
        return super::slurm::write(&campaign, args, &folder, args.tasks);
    }
    let stop = stop_on_interrupt();
    let bar = bar();
    let counted = AtomicBool::new(false);
    let execution = Execution {
        folder: &folder,
        shard: args.shard.unwrap_or(Shard::WHOLE),
        threads: args.threads,
        stop: &stop,
        progress: &|done, total| {
            bar.set_length(total);
            bar.set_position(done);
            // The first call tells what was there already: no rate is to be taken from it.
            if !counted.swap(true, Ordering::Relaxed) {
                bar.reset_eta();
            }
        },
    };
    let executed = campaign.execute(&execution);
    bar.finish_and_clear();
    let executed = executed?;
    if !executed.complete {
        return Err(CliError::Interrupted {
            done: executed.found + executed.computed,
            folder,
        });
    }
    if args.shard.is_some() {
        say(&format!(
            "{} runs computed, {} were there; when all shards are done: needle merge {}",
            executed.computed,
            executed.found,
            folder.display()
        ));
        return Ok(Verdict::Yes);
    }
    let summary = merge(&folder)?;
    match args.json {
        true => print_json(&summary)?,
        false => print(&words(&summary, &folder))?,
    }
    Ok(Verdict::Yes)
}

/// Where the results of a campaign are and how it is called, for scripts.
impl Args {
    pub(super) fn file(&self) -> &Path {
        &self.file
    }

    pub(super) fn threads(&self) -> usize {
        self.threads
    }
}

fn print_run(campaign: &Campaign, run: u64) -> Result<Verdict, CliError> {
    let runs = campaign.runs();
    if run >= runs {
        return Err(CliError::NoSuchRun { run, runs });
    }
    let (cell, trial) = campaign.place(run);
    let scenario = campaign.scenario(run)?.to_toml();
    print(&format!(
        "# Run {run}: trial {trial} of cell {cell}. Save this as run.toml, then: needle run run.toml --index {trial}\n{scenario}"
    ))?;
    Ok(Verdict::Yes)
}

/// A flag that an interrupt sets. A second interrupt ends the program at once; complete chunks stay either way.
fn stop_on_interrupt() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&stop);
    let installed = ctrlc::set_handler(move || {
        if set.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
    if installed.is_err() {
        // Without the handler an interrupt kills at once, which no chunk is harmed by.
        say("interrupts end the program at once: no handler could be set");
    }
    stop
}

/// A bar on standard error where that is a terminal, nothing elsewhere.
fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    let style = "{bar:40} {human_pos}/{human_len} runs, {per_sec}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(style) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_secs(1));
    bar
}
