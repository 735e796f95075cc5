//! The figures of a run, gathered sample by sample: memory grows by two numbers a sample, whatever the horizon.

use crate::path_distance::Nearest;
use crate::record::{OriginRecord, RunSummary};
use needle_control::ControlStep;
use std::f64::consts::TAU;
use std::time::Duration;

/// Share of the path within which a start that is off may be corrected before distances count.
const SETTLING_SHARE: f64 = 0.2;

/// Distance to the path that a successful run stays below after settling, and to the path's end as it ends, mm.
pub const SUCCESS_MM: f64 = 1.0;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    Finished,
    DurationOver,
    PlantFailed,
}

impl Ending {
    fn words(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::DurationOver => "duration_over",
            Self::PlantFailed => "plant_failed",
        }
    }
}

/// Sums of a run under way.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    length_mm: f64,
    dt_s: f64,
    steps: u64,
    iterations: u64,
    omega_integral_rad: f64,
    progress_mm: f64,
    degraded: u64,
    shifted_plan: u64,
    no_plan: u64,
    no_measurement: u64,
    /// Distances after settling.
    settled_mm: Vec<f64>,
    step_us: Vec<f64>,
}

impl Tally {
    pub(crate) fn new(length_mm: f64, dt_s: f64) -> Self {
        Self {
            length_mm,
            dt_s,
            ..Self::default()
        }
    }

    pub(crate) fn add(&mut self, control: &ControlStep<'_>, nearest: &Nearest, took: Duration) {
        self.steps += 1;
        self.iterations += control.statistics.iterations as u64;
        self.omega_integral_rad += control.input.omega_rad_s.abs() * self.dt_s;
        self.progress_mm = nearest.progress_mm;
        match OriginRecord::from(&control.origin) {
            OriginRecord::Degraded => self.degraded += 1,
            OriginRecord::ShiftedPlan => self.shifted_plan += 1,
            OriginRecord::StopNoPlan => self.no_plan += 1,
            OriginRecord::StopNoMeasurement => self.no_measurement += 1,
            OriginRecord::Optimal
            | OriginRecord::Law
            | OriginRecord::StopPathEnd
            | OriginRecord::StopOutOfTime => {}
        }
        if nearest.progress_mm > SETTLING_SHARE * self.length_mm {
            self.settled_mm.push(nearest.distance_mm);
        }
        self.step_us.push(took.as_secs_f64() * 1e6);
    }

    pub(crate) fn summary(
        mut self,
        seed: u64,
        run_index: u64,
        ending: Ending,
        final_mm: f64,
    ) -> RunSummary {
        let distances = &mut self.settled_mm;
        let mean_square = distances.iter().map(|d| d * d).sum::<f64>() / distances.len() as f64;
        let rms_mm = (!distances.is_empty()).then(|| mean_square.sqrt());
        distances.sort_by(f64::total_cmp);
        let max_mm = distances.last().copied();
        self.step_us.sort_by(f64::total_cmp);
        // At rest or not: the last millimetre may be crept.
        let reached = ending != Ending::PlantFailed
            && final_mm < SUCCESS_MM
            && self.length_mm - self.progress_mm < SUCCESS_MM;
        RunSummary {
            run_index,
            seed,
            steps: self.steps,
            status: ending.words().into(),
            success: reached && max_mm.is_some_and(|worst| worst < SUCCESS_MM),
            rms_mm,
            p95_mm: quantile(distances, 0.95),
            max_mm,
            final_mm,
            progress_mm: self.progress_mm,
            rotation_rev: self.omega_integral_rad / TAU,
            omega_integral_rad: self.omega_integral_rad,
            degraded_steps: self.degraded,
            shifted_plan_steps: self.shifted_plan,
            no_plan_steps: self.no_plan,
            no_measurement_steps: self.no_measurement,
            iterations: self.iterations,
            step_median_us: quantile(&self.step_us, 0.5).unwrap_or(0.0),
            step_worst_us: self.step_us.last().copied().unwrap_or(0.0),
        }
    }
}

/// The least value that at least the share `q` of the sorted values does not exceed.
fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantile_by_hand() {
        let twenty: Vec<f64> = (1..=20).map(f64::from).collect();
        assert_eq!(quantile(&twenty, 0.95), Some(19.0));
        assert_eq!(quantile(&twenty, 0.5), Some(10.0));
        assert_eq!(quantile(&[3.0], 0.95), Some(3.0));
        assert_eq!(quantile(&[], 0.95), None);
    }
}
