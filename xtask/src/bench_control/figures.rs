//! What a controller's runs on a case are judged by.

use super::BenchError;
use super::cases::Case;
use needle_sim::{Experiment, RunSummary, Scenario};

/// A figure over the runs: mean and standard deviation, which is zero of a single run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Figure {
    pub(super) mean: f64,
    pub(super) spread: f64,
}

impl Figure {
    fn of(values: impl ExactSizeIterator<Item = f64> + Clone) -> Self {
        let count = values.len() as f64;
        let mean = values.clone().sum::<f64>() / count;
        let squares: f64 = values.map(|value| (value - mean).powi(2)).sum();
        Self {
            mean,
            spread: (squares / (count - 1.0).max(1.0)).sqrt(),
        }
    }
}

/// Names of [`Judged::figures`].
pub(super) const COLUMNS: [&str; 5] = [
    "rms_mm",
    "max_mm",
    "final_mm",
    "rotation_rev",
    "omega_integral_rad",
];

/// Index of the distance across the path.
const RMS: usize = 0;
/// Index of the distance from the path's end, which counts what the tip lags behind.
const FINAL: usize = 2;

/// A controller on a case.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub(super) case: &'static str,
    pub(super) controller: &'static str,
    pub(super) runs: u64,
    /// Index of the column that tells the case's controllers apart.
    pub(super) main_column: usize,
    /// `None` where the case is not one for the controller.
    pub(super) judged: Option<Judged>,
}

/// What the runs were like.
#[derive(Debug, Clone)]
pub(super) struct Judged {
    pub(super) figures: [Figure; 5],
    /// Median of the steps' times, of the median run, us.
    pub(super) median_step_us: f64,
    pub(super) worst_step_us: f64,
}

impl Row {
    /// Makes the scenario and runs it.
    pub(super) fn compute(case: &Case, controller: &'static str) -> Result<Self, BenchError> {
        let judged = match case.excludes(controller) {
            Some(_) => None,
            None => {
                let failed = |source| BenchError::Run {
                    case: case.name,
                    controller,
                    source: Box::new(source),
                };
                let scenario = Scenario::parse(&case.scenario(controller))?;
                let experiment = Experiment::new(&scenario).map_err(failed)?;
                let runs: Result<Vec<_>, _> = (0..case.runs)
                    .map(|run| experiment.summarise(run))
                    .collect();
                Some(Judged::of(&runs.map_err(failed)?))
            }
        };
        Ok(Self {
            case: case.name,
            controller,
            runs: case.runs,
            main_column: if case.along { FINAL } else { RMS },
            judged,
        })
    }
}

impl Judged {
    fn of(runs: &[RunSummary]) -> Self {
        // A run that never came beyond the path's first fifth has no distance.
        let columns: [fn(&RunSummary) -> f64; 5] = [
            |run| run.rms_mm.unwrap_or(f64::INFINITY),
            |run| run.max_mm.unwrap_or(f64::INFINITY),
            |run| run.final_mm,
            |run| run.rotation_rev,
            |run| run.omega_integral_rad,
        ];
        let mut medians: Vec<f64> = runs.iter().map(|run| run.step_median_us).collect();
        medians.sort_by(f64::total_cmp);
        Self {
            figures: columns.map(|column| Figure::of(runs.iter().map(column))),
            median_step_us: medians[medians.len() / 2],
            worst_step_us: runs.iter().map(|run| run.step_worst_us).fold(0.0, f64::max),
        }
    }
}
