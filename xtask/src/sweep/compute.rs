//! Runs the closed loops of the figures, with progress on standard error.

use super::{Experiment, SweepError};
use crate::say;
use indicatif::{ProgressBar, ProgressStyle};
use needle_sim::RunLog;
use needle_sim::published::{Figure, PublishedError, PublishedRun, figure_runs};
use std::io::IsTerminal;

/// A data file of the sweep: one figure of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FigureFile(pub(super) Figure);

impl FigureFile {
    /// File name without its ending.
    pub(super) fn stem(self) -> &'static str {
        match self.0 {
            Figure::Straight => "fig05_straight",
            Figure::Bevel => "fig07_bevel",
            Figure::QSweep => "fig08_q_sweep",
            Figure::QSweepAsText => "fig08_q_sweep_as_text",
            Figure::RSweep => "fig09_r_sweep",
            Figure::NSweep => "fig10_n_sweep",
        }
    }

    pub(super) fn experiment(self) -> Experiment {
        match self.0 {
            Figure::Straight => Experiment::Straight,
            Figure::Bevel => Experiment::Bevel,
            Figure::QSweep | Figure::QSweepAsText => Experiment::Q,
            Figure::RSweep => Experiment::R,
            Figure::NSweep => Experiment::N,
        }
    }
}

/// A figure with the logs of its runs, in the same order.
#[derive(Debug)]
pub(super) struct ComputedFigure {
    pub(super) file: FigureFile,
    pub(super) runs: Vec<PublishedRun>,
    pub(super) logs: Vec<RunLog>,
}

/// Computes every run of `files`, one after the other, each as often as `repetitions` says.
pub(super) fn figures(
    files: &[FigureFile],
    repetitions: usize,
) -> Result<Vec<ComputedFigure>, SweepError> {
    let planned: Vec<_> = files
        .iter()
        .map(|file| (*file, figure_runs(file.0)))
        .collect();
    let mut distinct: Vec<&PublishedRun> = Vec::new();
    for run in planned.iter().flat_map(|(_, runs)| runs) {
        if !distinct.contains(&run) {
            distinct.push(run);
        }
    }
    let progress = Progress::new(distinct.len());
    let mut computed: Vec<(PublishedRun, RunLog)> = Vec::new();
    for run in distinct {
        let log = repeated(run, repetitions).map_err(|source| SweepError::Run {
            run: run.name.clone(),
            source,
        })?;
        progress.computed(run);
        computed.push((run.clone(), log));
    }
    progress.ends();
    let log_of = |run: &PublishedRun| {
        computed
            .iter()
            .find(|(known, _)| known == run)
            .map(|(_, log)| log.clone())
    };
    let figure = |(file, runs): (FigureFile, Vec<PublishedRun>)| {
        let logs = runs.iter().filter_map(log_of).collect();
        ComputedFigure { file, runs, logs }
    };
    Ok(planned.into_iter().map(figure).collect())
}

/// The run whose solve time is the unit of `time_ratio_to_n8`.
const UNIT_RUN: &str = "N8";

/// Median solve time of the unit run, computed for the purpose where it is in none of the figures.
pub(super) fn unit_solve_us(figures: &[ComputedFigure]) -> Result<Option<f64>, SweepError> {
    let known = figures
        .iter()
        .flat_map(|figure| &figure.logs)
        .find(|log| log.run == UNIT_RUN);
    if let Some(log) = known {
        return Ok(log.metrics().median_solve_us);
    }
    let unit = figure_runs(Figure::NSweep)
        .into_iter()
        .find(|run| run.name == UNIT_RUN);
    let log = unit
        .map(|run| repeated(&run, super::REPETITIONS))
        .transpose();
    let log = log.map_err(|source| SweepError::Run {
        run: UNIT_RUN.into(),
        source,
    })?;
    Ok(log.and_then(|log| log.metrics().median_solve_us))
}

fn repeated(run: &PublishedRun, repetitions: usize) -> Result<RunLog, PublishedError> {
    let mut log = run.compute()?;
    for _ in 1..repetitions {
        for (row, again) in log.rows.iter_mut().zip(run.compute()?.rows) {
            row.solve_us = row
                .solve_us
                .zip(again.solve_us)
                .map(|(one, other)| one.min(other));
        }
    }
    Ok(log)
}

/// A bar on a terminal, a line a run otherwise.
struct Progress(Option<ProgressBar>);

impl Progress {
    fn new(runs: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {eta} left");
            ProgressBar::new(runs as u64)
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self(bar)
    }

    fn computed(&self, run: &PublishedRun) {
        match &self.0 {
            Some(bar) => {
                bar.set_message(run.name.clone());
                bar.inc(1);
            }
            None => say(&format!("computed {}", run.name)),
        }
    }

    fn ends(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
