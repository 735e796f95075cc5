//! Settings that every baseline shares, and what can be wrong with a baseline's configuration.

use crate::limits::{InputLimits, LimitsError};
use lqr::ChainError;
use needle_model::StepError;

/// Limits, sample time and what to do without a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaselineSettings {
    /// Limits of the actuators.
    pub limits: InputLimits,
    /// Sample time that the loop aims at, s. The true time between samples is taken from the clock.
    pub dt_s: f64,
    /// Longest time without a usable measurement, s. Until then the model carries the last pose on; then the needle stops.
    pub patience_s: f64,
    /// Largest credible distance between a measured and the expected position, mm; beyond it a measurement is an outlier.
    pub jump_mm: f64,
}

impl Default for BaselineSettings {
    /// 0.1 s as in the paper; half a second of patience is 2.5 mm at 5 mm/s; a jump of 10 mm is no needle's motion.
    fn default() -> Self {
        Self {
            limits: InputLimits::default(),
            dt_s: 0.1,
            patience_s: 0.5,
            jump_mm: 10.0,
        }
    }
}

/// Why a baseline cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BaselineError {
    /// The limits of the actuators.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// A time, a length, a gain or a weight that must be positive.
    #[error("{field} must be positive and finite, found {found}")]
    NotPositive {
        /// Name of the field.
        field: &'static str,
        /// As given.
        found: f64,
    },
    /// The reference cannot be linearised.
    #[error("reference step {step}: {source}")]
    Linearisation {
        /// Step of the reference.
        step: usize,
        /// What is wrong with it.
        source: StepError,
    },
    /// The law was made for a path of another number of steps.
    #[error("the law is for a path of {expected} steps, found {found}")]
    OtherPath {
        /// Steps of the law's path.
        expected: usize,
        /// Steps of the path to follow.
        found: usize,
    },
    /// The law was made for another sample time.
    #[error("the law is for samples of {expected} s, found {found} s")]
    OtherSampleTime {
        /// The law's, s.
        expected: f64,
        /// The path's or the loop's, s.
        found: f64,
    },
    /// The backward Riccati chain has no answer.
    #[error(transparent)]
    Chain(#[from] ChainError),
}

/// The first of the named values that is not positive and finite is an error.
pub(crate) fn all_positive(values: &[(&'static str, f64)]) -> Result<(), BaselineError> {
    match values
        .iter()
        .find(|(_, value)| !(value.is_finite() && *value > 0.0))
    {
        Some(&(field, found)) => Err(BaselineError::NotPositive { field, found }),
        None => Ok(()),
    }
}

impl BaselineSettings {
    /// Checks limits, times and lengths.
    ///
    /// # Errors
    /// [`BaselineError`] names the first field that is wrong.
    pub fn validate(&self) -> Result<(), BaselineError> {
        self.limits.validate()?;
        all_positive(&[
            ("dt_s", self.dt_s),
            ("patience_s", self.patience_s),
            ("jump_mm", self.jump_mm),
        ])
    }
}
