//! `summary.csv`: a row a run with the figures that sum it up.

use super::compute::ComputedFigure;
use super::dataset::{self, DatasetError};
use needle_sim::RunMetrics;

/// `unit_solve_us` is the solve time that the ratios are to.
pub(super) fn encode(
    figures: &[ComputedFigure],
    unit_solve_us: Option<f64>,
) -> Result<Vec<u8>, DatasetError> {
    let metrics: Vec<_> = figures
        .iter()
        .flat_map(|figure| {
            figure
                .logs
                .iter()
                .map(|log| (figure.file.stem(), log.run.as_str(), log.metrics()))
        })
        .collect();
    let ratio = |metrics: &RunMetrics| Some(metrics.median_solve_us? / unit_solve_us?);
    let rows = metrics
        .iter()
        .map(|(file, run, metrics)| (file, run, ratio(metrics), metrics));
    dataset::table("file,run,time_ratio_to_n8", &RunMetrics::default(), rows)
}
