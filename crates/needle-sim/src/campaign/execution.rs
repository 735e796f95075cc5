//! Runs the chunks of a campaign that are not there yet, on all cores.

use super::fault::CampaignError;
use super::plan::Campaign;
use super::rows::{self, Row};
use super::store::Store;
use crate::experiment::Experiment;
use crate::output::write_whole;
use crate::record::StepRecord;
use crate::scenario::{Fault, ScenarioError};
use rayon::prelude::*;
use std::path::Path;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// One of several shares of a campaign: chunks go round, so that shards take alike long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: u64,
    count: u64,
}

/// What is no shard.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a shard is I/N with I from 1 to N, such as 1/4 to 4/4, not {found}")]
pub struct ShardError {
    /// What was given.
    pub found: String,
}

impl Shard {
    /// All of it.
    pub const WHOLE: Self = Self { index: 1, count: 1 };

    fn takes(self, chunk: u64) -> bool {
        chunk % self.count == self.index - 1
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let parts = text.split_once('/');
        let numbers =
            parts.and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        match numbers {
            Some((index, count)) if 1 <= index && index <= count => Ok(Self { index, count }),
            _ => Err(ShardError { found: text.into() }),
        }
    }
}

/// How a campaign is run.
pub struct Execution<'a> {
    /// Folder of the results.
    pub folder: &'a Path,
    /// Share of the chunks.
    pub shard: Shard,
    /// Threads; 0 for one a core.
    pub threads: usize,
    /// Once set, runs under way are finished and their chunks given up.
    pub stop: &'a AtomicBool,
    /// Told after each run: runs done, runs of this shard. Runs of chunks that were there count as done.
    pub progress: &'a (dyn Fn(u64, u64) + Sync),
}

/// What an execution left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Executed {
    /// Runs computed and stored now.
    pub computed: u64,
    /// Runs of this shard that were there before.
    pub found: u64,
    /// Whether every chunk of this shard is there: false after a stop.
    pub complete: bool,
}

impl std::fmt::Debug for Execution<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Execution")
            .field("folder", &self.folder)
            .field("shard", &self.shard)
            .field("threads", &self.threads)
            .finish_non_exhaustive()
    }
}

impl Campaign {
    /// Computes the chunks of a shard that are not in the folder yet.
    ///
    /// # Errors
    /// [`CampaignError`] when the folder is another campaign's or a file cannot be written; chunks that were finished stay.
    pub fn execute(&self, execution: &Execution<'_>) -> Result<Executed, CampaignError> {
        let store = Store::of(self, execution.folder)?;
        let chunks = (0..store.manifest.chunks()).filter(|chunk| execution.shard.takes(*chunk));
        let (there, pending): (Vec<_>, Vec<_>) = chunks.partition(|chunk| store.has(*chunk));
        let runs = |chunks: &[u64]| -> u64 {
            let runs = chunks.iter().map(|chunk| store.manifest.runs_of(*chunk));
            runs.map(|runs| runs.end - runs.start).sum()
        };
        let found = runs(&there);
        let total = found + runs(&pending);
        let (done, computed) = (AtomicU64::new(found), AtomicU64::new(0));
        (execution.progress)(found, total);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(execution.threads)
            .build()
            .map_err(|source| CampaignError::Threads {
                threads: execution.threads,
                source,
            })?;
        let after_run = || {
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            (execution.progress)(done, total);
            !execution.stop.load(Ordering::Relaxed)
        };
        pool.install(|| {
            // One chunk a task: the last ones are shared out as evenly as can be.
            pending.par_iter().with_max_len(1).try_for_each(|&chunk| {
                if !execution.stop.load(Ordering::Relaxed)
                    && self.compute(&store, chunk, &after_run)?
                {
                    let runs = store.manifest.runs_of(chunk);
                    computed.fetch_add(runs.end - runs.start, Ordering::Relaxed);
                }
                Ok::<_, CampaignError>(())
            })
        })?;
        let computed = computed.into_inner();
        Ok(Executed {
            computed,
            found,
            complete: found + computed == total,
        })
    }

    /// Computes and stores a chunk; false when `after_run` had enough first.
    fn compute(
        &self,
        store: &Store,
        chunk: u64,
        after_run: &dyn Fn() -> bool,
    ) -> Result<bool, CampaignError> {
        let runs = store.manifest.runs_of(chunk);
        let mut rows = Vec::new();
        let mut samples = Vec::new();
        let mut ready = None;
        for run in runs {
            let (row, track) = self.run(run, &mut ready);
            rows.push(row);
            samples.extend(track.into_iter().map(|sample| (run, sample)));
            if !after_run() {
                return Ok(false);
            }
        }
        if self.track_every().is_some() {
            let path = store.tracks_part(chunk);
            let bytes = rows::tracks(&samples).to_parquet();
            write_whole(&path, &bytes.map_err(|source| damaged(&path, source))?)?;
        }
        let path = store.part(chunk);
        let bytes = rows::runs(&self.columns(), &rows).to_parquet();
        write_whole(&path, &bytes.map_err(|source| damaged(&path, source))?)?;
        Ok(true)
    }

    /// One run and its track, empty without tracks. `ready` keeps the experiment of a cell whose runs share it.
    fn run(&self, run: u64, ready: &mut Option<(u64, Experiment)>) -> (Row, Vec<StepRecord>) {
        let (cell, trial) = self.place(run);
        let mut track = Vec::new();
        let outcome =
            self.experiment(run, cell, ready)
                .and_then(|experiment| match self.track_every() {
                    None => experiment.summarise(trial).map_err(chain),
                    Some(every) => {
                        let record = experiment.record(trial).map_err(chain)?;
                        let summary = record.summary.clone();
                        track = rows::thinned(record, every);
                        Ok(summary)
                    }
                });
        let row = Row {
            run,
            cell,
            trial,
            parameters: self.parameters(run),
            outcome,
        };
        (row, track)
    }

    fn experiment<'a>(
        &self,
        run: u64,
        cell: u64,
        ready: &'a mut Option<(u64, Experiment)>,
    ) -> Result<&'a Experiment, String> {
        let usable = |(made_for, _): &(u64, _)| *made_for == cell && !self.draws_parameters();
        let made = match ready.take().filter(usable) {
            Some(made) => made,
            None => {
                let scenario = self.scenario(run).map_err(|error| refusal(&error))?;
                (cell, Experiment::new(&scenario).map_err(chain)?)
            }
        };
        Ok(&ready.insert(made).1)
    }
}

fn damaged(path: &Path, source: parquet::errors::ParquetError) -> CampaignError {
    CampaignError::Damaged {
        path: path.into(),
        source,
    }
}

/// What a scenario cannot hold, without the file's name: a row is the same wherever the campaign is called from.
fn refusal(error: &ScenarioError) -> String {
    let words = |fault: &Fault| format!("{}: {}", fault.key, fault.problem);
    error
        .faults()
        .iter()
        .map(words)
        .collect::<Vec<_>>()
        .join("; ")
}

/// An error and what caused it, for a row.
fn chain(error: impl std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}
