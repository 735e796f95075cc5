//! Why a Riccati equation has no answer.

use crate::input::InputError;
use crate::modes::mode::{UncontrollableMode, UnobservableMode};
use crate::modes::spectrum::SpectrumError;

/// Why there is no answer. A `Dare` never returns a P that is not the stabilising solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DareError {
    /// Shapes, NaN, infinities, asymmetry.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A weight is indefinite beyond rounding.
    #[error(
        "{name} is not positive semidefinite: least eigenvalue {eigenvalue:e}, tolerance {tolerance:e}"
    )]
    IndefiniteWeight {
        /// Q, R or [Q S; S' R].
        name: &'static str,
        /// Its least eigenvalue.
        eigenvalue: f64,
        /// Distance below zero that counts as rounding.
        tolerance: f64,
    },
    /// A mode on or outside the unit circle that no input reaches: no gain stabilises the pair.
    #[error("not stabilisable: no input reaches {mode}")]
    NotStabilisable {
        /// The mode.
        mode: UncontrollableMode,
    },
    /// The data are conditioned so badly that their rounding decides whether a mode is reached.
    #[error("too ill conditioned: rounding decides whether an input reaches {mode}")]
    Undecided {
        /// The mode.
        mode: UncontrollableMode,
    },
    /// A mode on the unit circle without weight: the optimal law leaves it there.
    #[error("no stabilising solution: the weight does not see {mode} on the unit circle")]
    UnobservableOnCircle {
        /// The mode.
        mode: UnobservableMode,
    },
    /// R + B'PB is singular: the optimal input is not unique.
    #[error(
        "R + B'PB is singular to working precision: an input has neither a weight nor an effect that costs"
    )]
    SingularInputHessian,
    /// The numbers as stored have a solution, but a rounding of A and B may take it away.
    #[error(
        "too ill conditioned: rounding of A and B moves the closed loop by {sensitivity:e} of its distance to instability"
    )]
    IllConditioned {
        /// Bound on the movement over the distance, in coordinates where the closed loop is a contraction; one half is refused.
        sensitivity: f64,
    },
    /// The weights are semidefinite up to rounding only, and what they leave of P at a slow or far-off mode is negative.
    #[error(
        "the solution is not positive semidefinite: least eigenvalue {eigenvalue:e}, tolerance {tolerance:e}"
    )]
    IndefiniteSolution {
        /// Least eigenvalue of P, or x'Px at a unit x where P is small and the units hide it.
        eigenvalue: f64,
        /// Distance below zero that counts as rounding.
        tolerance: f64,
    },
    /// Entries so large or small that powers of the matrices overflow.
    #[error("the eigenvalues of A could not be computed")]
    Spectrum(#[source] SpectrumError),
    /// No route reached a stabilising solution with a small residual, though the tests find no mode to blame.
    #[error(
        "no stabilising solution reached: relative residual {relative_residual:e}, spectral radius {spectral_radius}"
    )]
    NoConvergence {
        /// Of the best candidate; infinite where there was none.
        relative_residual: f64,
        /// Of the best candidate's closed loop; infinite where there was none.
        spectral_radius: f64,
    },
}
