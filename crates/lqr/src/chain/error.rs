//! Why a Riccati chain, finite or periodic, has no answer.

use crate::input::InputError;
use crate::modes::mode::{UncontrollableMode, UnobservableMode};
use crate::modes::spectrum::SpectrumError;

/// Why a chain has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChainError {
    /// A stage or the terminal weight is malformed; `stage` is the horizon for the terminal weight.
    #[error("stage {stage}: {source}")]
    Input {
        /// Index of the stage.
        stage: usize,
        /// What is wrong with it.
        source: InputError,
    },
    /// A weight is indefinite beyond rounding.
    #[error("stage {stage}: {name} is not positive semidefinite: least eigenvalue {eigenvalue:e}")]
    IndefiniteWeight {
        /// Index of the stage.
        stage: usize,
        /// Q, R, [Q S; S' R] or P.
        name: &'static str,
        /// Its least eigenvalue.
        eigenvalue: f64,
    },
    /// R + B'PB is singular or overflows: the stage has no unique optimal input.
    #[error("stage {stage}: R + B'PB is singular to working precision")]
    SingularInputHessian {
        /// Index of the stage.
        stage: usize,
    },
    /// A multiplier of the monodromy matrix on or outside the unit circle that no input of the period reaches.
    #[error("the periodic system is not stabilisable: no input reaches {mode}")]
    NotStabilisable {
        /// The mode of the map over one period.
        mode: UncontrollableMode,
    },
    /// The product of the period is conditioned so badly that its rounding decides whether a mode is reached.
    #[error("too ill conditioned: rounding decides whether an input of the period reaches {mode}")]
    Undecided {
        /// The mode of the monodromy matrix.
        mode: UncontrollableMode,
    },
    /// A multiplier of the period on the unit circle without weight: the optimal law leaves it there.
    #[error("no stabilising periodic solution: the weights do not see {mode} on the unit circle")]
    UnobservableOnCircle {
        /// The mode of the map over one period.
        mode: UnobservableMode,
    },
    /// The product of the period overflows, or its eigenvalues could not be computed.
    #[error("the multipliers of the period could not be computed")]
    Spectrum(#[source] SpectrumError),
    /// The period map has no stabilising fixed point within reach.
    #[error(
        "no stabilising periodic solution: relative residual {relative_residual:e}, spectral radius of the monodromy matrix {spectral_radius}"
    )]
    NoConvergence {
        /// Relative residual of the fixed point.
        relative_residual: f64,
        /// Spectral radius of the closed loop over one period.
        spectral_radius: f64,
    },
}
