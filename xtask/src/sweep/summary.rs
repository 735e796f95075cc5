//! `summary.csv`: a row a run with the figures that sum it up.

use super::compute::ComputedFigure;
use super::dataset::{self, DatasetError};
use needle_sim::RunMetrics;
use needle_sim::published::Figure;

/// The run whose solve time is the unit of `time_ratio_to_n8`.
const UNIT_RUN: &str = "N8";

pub(super) fn encode(figures: &[ComputedFigure]) -> Result<Vec<u8>, DatasetError> {
    let metrics: Vec<_> = figures
        .iter()
        .flat_map(|figure| {
            figure
                .logs
                .iter()
                .map(|log| (figure.file.stem(), log.run.as_str(), log.metrics()))
        })
        .collect();
    let unit = figures
        .iter()
        .filter(|figure| figure.file.0 == Figure::NSweep)
        .flat_map(|figure| &figure.logs)
        .find(|log| log.run == UNIT_RUN)
        .and_then(|log| log.metrics().median_solve_us);
    let ratio = |metrics: &RunMetrics| Some(metrics.median_solve_us? / unit?);
    let rows = metrics
        .iter()
        .map(|(file, run, metrics)| (file, run, ratio(metrics), metrics));
    dataset::table("file,run,time_ratio_to_n8", &RunMetrics::default(), rows)
}
