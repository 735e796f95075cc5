//! What a closed loop leaves behind: one row a step, and the figures that sum a run up.

use crate::record::{OriginRecord, PoseRecord, ReferenceRecord, RunRecord, StepRecord};
use needle_model::EulerState;
use serde::Serialize;

/// One row of a run: the state at a step, and the input of the step that ended in it.
///
/// What has no meaning for a run, or for its first row, is `None`. Field names are the column names of the data files.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct LogRow {
    /// Steps since the start; row 0 is the initial state.
    pub step: usize,
    /// Time since the start.
    pub time_s: f64,
    /// Tip position.
    pub x_mm: Option<f64>,
    /// Tip position.
    pub y_mm: Option<f64>,
    /// Tip position.
    pub z_mm: Option<f64>,
    /// First angle of the chart R = Rx(alpha) Ry(beta) Rz(gamma).
    pub alpha_rad: Option<f64>,
    /// Second angle of the chart.
    pub beta_rad: Option<f64>,
    /// Third angle of the chart, the tip's roll.
    pub gamma_rad: Option<f64>,
    /// Insertion speed applied in the step that ends in this row.
    pub v_mm_s: Option<f64>,
    /// Spin applied in the step that ends in this row.
    pub omega_rad_s: Option<f64>,
    /// The reference point nearest to this row's tip.
    pub ref_x_mm: Option<f64>,
    /// The reference point nearest to this row's tip.
    pub ref_y_mm: Option<f64>,
    /// The reference point nearest to this row's tip.
    pub ref_z_mm: Option<f64>,
    /// Step of the reference run at which that point stands.
    pub nearest: Option<usize>,
    /// How the solve for this row's input ended.
    pub status: Option<&'static str>,
    /// Solver iterations for this row's input.
    pub iterations: Option<usize>,
    /// Time to assemble and solve the program of this row's input; the terminal weight is not in it.
    pub solve_us: Option<f64>,
}

/// The closed loop of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunLog {
    /// Name of the run, unique in its figure.
    pub run: String,
    /// Step of the loop.
    pub dt_s: f64,
    /// Rows in order of time, the initial state first.
    pub rows: Vec<LogRow>,
}

/// Figures that sum a run up. `None` where a run has no such thing.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunMetrics {
    /// Closed-loop steps.
    pub steps: usize,
    /// Steps whose solve did not end solved to tolerance.
    pub failed_solves: usize,
    /// Last tip position.
    pub final_x_mm: Option<f64>,
    /// Last tip position.
    pub final_y_mm: Option<f64>,
    /// Last tip position.
    pub final_z_mm: Option<f64>,
    /// Root mean square over the rows of the distance to the nearest reference point.
    pub rms_distance_mm: Option<f64>,
    /// Largest of those distances.
    pub max_distance_mm: Option<f64>,
    /// Integral of |omega|: what the tissue feels.
    pub total_rotation_rad: Option<f64>,
    /// Largest |v|.
    pub largest_speed_mm_s: Option<f64>,
    /// Median solver time.
    pub median_solve_us: Option<f64>,
}

/// Status written for a solve that ended in an answer.
pub(crate) const SOLVED: &str = "solved";

impl LogRow {
    /// Distance from the tip to the nearest reference point, over the coordinates that the run has.
    #[must_use]
    pub fn distance_mm(&self) -> Option<f64> {
        let pairs = [
            (self.x_mm, self.ref_x_mm),
            (self.y_mm, self.ref_y_mm),
            (self.z_mm, self.ref_z_mm),
        ];
        let squares = pairs
            .into_iter()
            .filter_map(|(tip, reference)| Some((tip? - reference?).powi(2)));
        squares.reduce(|sum, square| sum + square).map(f64::sqrt)
    }
}

impl RunLog {
    /// Sums the run up.
    #[must_use]
    pub fn metrics(&self) -> RunMetrics {
        let last = self.rows.last();
        let distances: Vec<f64> = self.rows.iter().filter_map(LogRow::distance_mm).collect();
        let spins: Vec<f64> = self.rows.iter().filter_map(|row| row.omega_rad_s).collect();
        let speeds = self.rows.iter().filter_map(|row| row.v_mm_s);
        let mut times: Vec<f64> = self.rows.iter().filter_map(|row| row.solve_us).collect();
        times.sort_by(f64::total_cmp);
        let statuses = self.rows.iter().filter_map(|row| row.status);
        let mean_square = distances.iter().map(|d| d * d).sum::<f64>() / distances.len() as f64;
        RunMetrics {
            steps: self.rows.len().saturating_sub(1),
            failed_solves: statuses.filter(|status| *status != SOLVED).count(),
            final_x_mm: last.and_then(|row| row.x_mm),
            final_y_mm: last.and_then(|row| row.y_mm),
            final_z_mm: last.and_then(|row| row.z_mm),
            rms_distance_mm: (!distances.is_empty()).then(|| mean_square.sqrt()),
            max_distance_mm: distances.iter().copied().reduce(f64::max),
            total_rotation_rad: (!spins.is_empty())
                .then(|| spins.iter().map(|w| w.abs() * self.dt_s).sum()),
            largest_speed_mm_s: speeds.map(f64::abs).reduce(f64::max),
            median_solve_us: median(&times),
        }
    }
}

impl RunRecord {
    /// The run in the columns of the published runs: a row holds the input of the step that ended in it. Angles are absent where
    /// the chart is singular.
    #[must_use]
    pub fn log(&self, run: &str) -> RunLog {
        let dt_s = self.steps.get(1).map_or(0.0, |step| step.time_s);
        let before = std::iter::once(None).chain(self.steps.iter().map(Some));
        let rows = self.steps.iter().zip(before);
        RunLog {
            run: run.into(),
            dt_s,
            rows: rows
                .map(|(step, before)| row(step, before, &self.reference))
                .collect(),
        }
    }
}

impl ReferenceRecord {
    /// The path itself in the same columns.
    #[must_use]
    pub fn log(&self) -> RunLog {
        let inputs = std::iter::once(None).chain(self.inputs.iter().map(Some));
        let rows = self.poses.iter().zip(inputs).enumerate();
        let rows = rows.map(|(step, (pose, input))| LogRow {
            step,
            time_s: step as f64 * self.dt_s,
            v_mm_s: input.map(|input| input.v_mm_s),
            omega_rad_s: input.map(|input| input.omega_rad_s),
            ..placed(pose)
        });
        RunLog {
            run: "reference".into(),
            dt_s: self.dt_s,
            rows: rows.collect(),
        }
    }
}

fn row(step: &StepRecord, before: Option<&StepRecord>, reference: &ReferenceRecord) -> LogRow {
    let [x, y, z] = step.reference.position_mm.map(Some);
    let squared = |pose: &PoseRecord| -> f64 {
        let (a, b) = (pose.position_mm, step.tip.position_mm);
        (0..3).map(|i| (a[i] - b[i]).powi(2)).sum()
    };
    let distances = reference.poses.iter().map(squared).enumerate();
    LogRow {
        step: step.step,
        time_s: step.time_s,
        v_mm_s: before.map(|before| before.input.v_mm_s),
        omega_rad_s: before.map(|before| before.input.omega_rad_s),
        ref_x_mm: x,
        ref_y_mm: y,
        ref_z_mm: z,
        nearest: distances
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(index, _)| index),
        // An explicit law solves nothing.
        status: before.and_then(|before| match before.origin {
            OriginRecord::Law => None,
            OriginRecord::Optimal => Some(SOLVED),
            origin => Some(origin.word()),
        }),
        iterations: before.map(|before| before.iterations),
        solve_us: before.map(|before| before.step_us),
        ..placed(&step.tip)
    }
}

fn placed(pose: &PoseRecord) -> LogRow {
    let [x_mm, y_mm, z_mm] = pose.position_mm.map(Some);
    let chart = EulerState::from_pose(&pose.pose()).ok();
    LogRow {
        x_mm,
        y_mm,
        z_mm,
        alpha_rad: chart.map(|state| state.alpha_rad),
        beta_rad: chart.map(|state| state.beta_rad),
        gamma_rad: chart.map(|state| state.gamma_rad),
        ..LogRow::default()
    }
}

fn median(sorted: &[f64]) -> Option<f64> {
    let middle = sorted.len() / 2;
    match sorted.len() % 2 {
        0 => Some((sorted.get(middle.checked_sub(1)?)? + sorted.get(middle)?) / 2.0),
        _ => sorted.get(middle).copied(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: usize, z_mm: f64, ref_z_mm: f64, omega_rad_s: Option<f64>) -> LogRow {
        LogRow {
            step,
            z_mm: Some(z_mm),
            ref_z_mm: Some(ref_z_mm),
            omega_rad_s,
            ..LogRow::default()
        }
    }

    #[test]
    fn metrics_of_a_run_computed_by_hand() {
        let rows = vec![
            row(0, 0.0, 3.0, None),
            row(1, 1.0, 1.0, Some(-2.0)),
            row(2, 2.0, 6.0, Some(1.0)),
        ];
        let metrics = RunLog {
            run: "hand".into(),
            dt_s: 0.5,
            rows,
        }
        .metrics();
        assert_eq!(metrics.steps, 2);
        assert_eq!(metrics.rms_distance_mm, Some((25.0_f64 / 3.0).sqrt()));
        assert_eq!(metrics.max_distance_mm, Some(4.0));
        assert_eq!(metrics.total_rotation_rad, Some(1.5));
        assert_eq!((metrics.final_z_mm, metrics.final_x_mm), (Some(2.0), None));
    }

    #[test]
    fn failed_solves_are_counted_and_an_empty_log_has_no_figures() {
        let failed = LogRow {
            status: Some("primal_infeasible"),
            ..row(1, 0.0, 0.0, None)
        };
        let solved = LogRow {
            status: Some(SOLVED),
            ..row(2, 0.0, 0.0, None)
        };
        let log = RunLog {
            run: "x".into(),
            dt_s: 0.1,
            rows: vec![row(0, 0.0, 0.0, None), failed, solved],
        };
        assert_eq!(log.metrics().failed_solves, 1);
        assert_eq!(
            RunLog {
                run: "x".into(),
                dt_s: 0.1,
                rows: vec![]
            }
            .metrics(),
            RunMetrics::default()
        );
    }

    #[test]
    fn median_of_even_and_odd_counts() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[1.0, 2.0, 9.0]), Some(2.0));
        assert_eq!(median(&[1.0, 2.0, 4.0, 9.0]), Some(3.0));
    }
}
