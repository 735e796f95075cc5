//! PID on the steering angle, the "common approach" of the paper's introduction: the bevel is turned into the
//! direction of the curvature that a PID law on the lateral error asks for. The size of the curvature is the needle's
//! own, so the tip zigzags around any path that bends less.

use crate::baseline::bevel::turn_rad;
use crate::baseline::curvature_demand::{CurvatureDemand, LateralGains};
use crate::baseline::law::{PathSample, SteeringLaw};
use crate::baseline::settings::{BaselineError, all_positive};
use needle_model::Input;

/// Gains of [`SteeringPid`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PidGains {
    /// Outer loop: from lateral error to curvature.
    pub lateral: LateralGains,
    /// Inner loop: spin per turn that is left, 1/s.
    pub turn_gain_per_s: f64,
    /// Demand, as a fraction of the needle's curvature, below which the inner loop slackens: there the direction is noise.
    pub slack: f64,
}

impl Default for PidGains {
    /// The best of the study in `docs/baselines.md`.
    fn default() -> Self {
        Self {
            lateral: LateralGains {
                decay_mm: 6.0,
                integral_mm: 6.0,
                preview_mm: 2.0,
            },
            turn_gain_per_s: 10.0,
            slack: 1.0,
        }
    }
}

/// The law.
#[derive(Debug, Clone, Copy)]
pub struct SteeringPid {
    demand: CurvatureDemand,
    gains: PidGains,
}

impl SteeringPid {
    /// The law with these gains.
    ///
    /// # Errors
    /// [`BaselineError::NotPositive`] names the first gain that is wrong.
    pub fn new(gains: PidGains) -> Result<Self, BaselineError> {
        gains.lateral.validate()?;
        all_positive(&[
            ("turn_gain_per_s", gains.turn_gain_per_s),
            ("slack", gains.slack),
        ])?;
        Ok(Self {
            demand: CurvatureDemand::new(gains.lateral),
            gains,
        })
    }
}

impl SteeringLaw for SteeringPid {
    fn wanted(&mut self, sample: &PathSample<'_>) -> Input {
        let demand = self.demand.at(sample);
        let turn = turn_rad(&demand, sample.held.omega_rad_s);
        let full = self.gains.slack * sample.needle.curvature_per_mm();
        let lateral = demand.x.hypot(demand.y);
        let weight = if lateral < full { lateral / full } else { 1.0 };
        Input {
            omega_rad_s: self.gains.turn_gain_per_s * weight * turn,
            ..sample.reference_input()
        }
    }

    fn reset(&mut self) {
        self.demand.reset();
    }
}
