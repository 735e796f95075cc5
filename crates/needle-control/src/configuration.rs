//! What can be wrong with the configuration of a predictive controller, and the checks.

use crate::limits::LimitsError;
use crate::terminal::TerminalError;
use mpc_qp::{ProblemError, SolveError};

/// A configuration that makes no controller.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigurationError {
    /// A number outside its range.
    #[error("setting `{field}`: expected {expected}, found {found}")]
    Setting {
        /// Name of the field.
        field: &'static str,
        /// Its range.
        expected: &'static str,
        /// As given.
        found: f64,
    },
    /// The model has no offset across the path: the straight needle's is depth and roll.
    #[error("a corridor of {corridor_mm} mm means nothing to a model of depth and roll")]
    CorridorOfStraightNeedle {
        /// Half-width as given, mm.
        corridor_mm: f64,
    },
    /// The limits of the actuators.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// The terminal ingredients cannot be had for the reference.
    #[error(transparent)]
    Terminal(#[from] TerminalError),
    /// The quadratic program refuses the data that follow from the configuration.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// The solver refuses its settings.
    #[error(transparent)]
    Solver(#[from] SolveError),
}

/// Accepts finite positive numbers.
pub(crate) fn positive(field: &'static str, found: f64) -> Result<(), ConfigurationError> {
    match found > 0.0 && found.is_finite() {
        true => Ok(()),
        false => Err(ConfigurationError::Setting {
            field,
            expected: "a positive finite number",
            found,
        }),
    }
}

/// Accepts finite numbers from zero on.
pub(crate) fn not_negative(field: &'static str, found: f64) -> Result<(), ConfigurationError> {
    match found >= 0.0 && found.is_finite() {
        true => Ok(()),
        false => Err(ConfigurationError::Setting {
            field,
            expected: "a finite number of at least 0",
            found,
        }),
    }
}

/// Accepts counts from one to a bound that keeps memory and time in reason.
pub(crate) fn count(
    field: &'static str,
    found: usize,
    most: usize,
) -> Result<(), ConfigurationError> {
    match (1..=most).contains(&found) {
        true => Ok(()),
        false => Err(ConfigurationError::Setting {
            field,
            expected: "a count of at least 1 and at most some thousands",
            found: found as f64,
        }),
    }
}
