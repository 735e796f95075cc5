//! Duty-cycled steering: whole turns of spin between stretches of insertion give any curvature below the needle's own.
//!
//! Source: D. Minhas, J. Engh, M. Fenske, C. Riviere, "Modeling of needle steering via duty-cycled spinning", EMBC
//! 2007. The outer loop is the PID's; its demand of curvature |k| asks for spin during d = 1 - |k| / kappa of the
//! insertion ([`needle_model::DutyCycle`]). A turn takes the length l_turn; the bevel then holds the demanded
//! direction for l_turn (1 - d) / d, feedback included, and the next turn begins.

use crate::baseline::bevel::turn_rad;
use crate::baseline::curvature_demand::{CurvatureDemand, LateralGains};
use crate::baseline::law::{PathSample, SteeringLaw};
use crate::baseline::settings::{BaselineError, all_positive};
use nalgebra::Vector3;
use needle_model::{DutyCycle, Input};
use std::f64::consts::{PI, TAU};

/// Gains of [`DutyCycledSteering`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DutyCycledGains {
    /// Outer loop: from lateral error to curvature.
    pub lateral: LateralGains,
    /// Spin per turn that is left while the direction is held, 1/s.
    pub turn_gain_per_s: f64,
    /// Speed of the whole turns as a fraction of the largest spin, at most 1.
    pub spin_fraction: f64,
}

impl Default for DutyCycledGains {
    /// The best of the study in `docs/baselines.md`.
    fn default() -> Self {
        Self {
            lateral: LateralGains {
                decay_mm: 3.0,
                integral_mm: 6.0,
                preview_mm: 5.0,
            },
            turn_gain_per_s: 5.0,
            spin_fraction: 1.0,
        }
    }
}

/// What the bevel is doing.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// Holds the direction; inserted so far, mm.
    Hold { inserted_mm: f64 },
    /// Turns once; turned so far, rad.
    Spin { turned_rad: f64 },
}

const START: Phase = Phase::Hold { inserted_mm: 0.0 };

/// The law.
#[derive(Debug, Clone, Copy)]
pub struct DutyCycledSteering {
    demand: CurvatureDemand,
    gains: DutyCycledGains,
    phase: Phase,
}

impl DutyCycledSteering {
    /// The law with these gains.
    ///
    /// # Errors
    /// [`BaselineError::NotPositive`] names the first gain that is wrong.
    pub fn new(gains: DutyCycledGains) -> Result<Self, BaselineError> {
        gains.lateral.validate()?;
        all_positive(&[
            ("turn_gain_per_s", gains.turn_gain_per_s),
            ("spin_fraction", gains.spin_fraction),
        ])?;
        Ok(Self {
            demand: CurvatureDemand::new(gains.lateral),
            gains,
            phase: START,
        })
    }

    /// Length to hold between two turns, mm; infinite where the needle must bend all it can.
    fn hold_mm(&self, demand: &Vector3<f64>, sample: &PathSample<'_>, speed_mm_s: f64) -> f64 {
        let wanted = demand.x.hypot(demand.y);
        let spinning =
            DutyCycle::for_curvature(sample.needle, wanted).map_or(0.0, |d| d.fraction());
        let turn_s = TAU / (self.gains.spin_fraction * sample.omega_max_rad_s);
        speed_mm_s.abs() * turn_s * (1.0 - spinning) / spinning
    }
}

impl SteeringLaw for DutyCycledSteering {
    fn wanted(&mut self, sample: &PathSample<'_>) -> Input {
        let demand = self.demand.at(sample);
        let reference = sample.reference_input();
        let hold_mm = self.hold_mm(&demand, sample, reference.v_mm_s);
        self.phase = match self.phase {
            Phase::Hold { inserted_mm } => {
                let inserted_mm = inserted_mm + (sample.held.v_mm_s * sample.elapsed_s).abs();
                if inserted_mm >= hold_mm {
                    Phase::Spin { turned_rad: 0.0 }
                } else {
                    Phase::Hold { inserted_mm }
                }
            }
            Phase::Spin { turned_rad } => Phase::Spin {
                turned_rad: turned_rad + sample.held.omega_rad_s * sample.elapsed_s,
            },
        };
        let turn = turn_rad(&demand, sample.held.omega_rad_s);
        let spin = self.gains.spin_fraction * sample.omega_max_rad_s;
        let omega_rad_s = match self.phase {
            Phase::Hold { .. } => self.gains.turn_gain_per_s * turn,
            // The last half of the turn ends at the demanded direction, wherever that is by now.
            Phase::Spin { turned_rad } if turned_rad > PI => {
                let left = turn.rem_euclid(TAU);
                if left > PI || left <= spin * sample.elapsed_s {
                    self.phase = START;
                    self.gains.turn_gain_per_s * turn
                } else {
                    spin
                }
            }
            Phase::Spin { .. } => spin,
        };
        Input {
            omega_rad_s,
            ..reference
        }
    }

    fn reset(&mut self) {
        self.demand.reset();
        self.phase = START;
    }
}
