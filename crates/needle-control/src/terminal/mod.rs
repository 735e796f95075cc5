//! Terminal cost and set of the predictive controllers: the choice, and why it may not be had.
//!
//! The ingredients come from `lqr`: one Riccati solution for a reference of constant inputs, a periodic one, or a backward chain
//! to the end of the path; each with the largest level set inside the limits, and a certificate. They are about the needle
//! linearised along a reference that it executes; what no needle can follow has none.

mod deviation_box;
mod ingredients;
mod pair;
mod problem;
mod region;
#[cfg(test)]
mod rollouts;

pub(crate) use ingredients::{End, Ingredients};
pub(crate) use problem::{ALL_COORDINATES, Chosen, DEPTH_AND_ROLL, TerminalProblem};
pub use region::TerminalRegion;

use lqr::{ChainClaimError, ChainError, ConstraintError, DareError, InputError, TerminalSetError};
use needle_model::{ControllabilityError, ControllabilityReport, StepError};

/// Which terminal cost and set a controller uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TerminalChoice {
    /// The strongest that the reference admits: one Riccati solution, else a chain, else none.
    #[default]
    Auto,
    /// One Riccati solution; the reference's inputs must be constant and the error stabilisable.
    HelixDare,
    /// A chain back from the end of the path.
    RiccatiChain,
    /// The periodic Riccati solution; the reference's inputs must repeat.
    Periodic {
        /// Samples after which they repeat.
        period: usize,
    },
    /// The weights at the end, and no set.
    None,
}

/// A terminal choice that [`TerminalChoice::Auto`] passed over.
#[derive(Debug, Clone)]
pub struct RefusedChoice {
    /// The choice.
    pub choice: TerminalChoice,
    /// Why it, or its set, cannot be had for the reference.
    pub reason: TerminalError,
}

/// Why a terminal choice cannot be had for a reference.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum TerminalError {
    /// The reference's inputs differ where they should not.
    #[error("the reference's input at step {step} differs from the one {period} steps before")]
    NotPeriodic {
        /// First step that differs.
        step: usize,
        /// Steps after which inputs should repeat.
        period: usize,
    },
    /// The needle does not follow the reference even when it starts on it.
    #[error(
        "the needle cannot execute the reference: it misses pose {} by {defect} (mm and rad)", step + 1
    )]
    NotExecutable {
        /// First step that misses.
        step: usize,
        /// Norm of the miss, mm and rad alike.
        defect: f64,
    },
    /// The cost pulls the spin to rest, away from the reference's.
    #[error(
        "terminal ingredients need `SpinTarget::Reference`: the cost is not least on the reference"
    )]
    SpinAtRest,
    /// The Riccati equation has no stabilising solution.
    #[error("no stabilising terminal cost for this reference: its error has {} of 6 controllable directions", report.dimension)]
    Dare {
        /// Which errors no input corrects.
        report: Box<ControllabilityReport>,
        /// The mode to blame.
        source: DareError,
    },
    /// The straight needle's Riccati equation has no stabilising solution.
    #[error(transparent)]
    Straight(#[from] DareError),
    /// The chain or periodic equation has no solution.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// The sets of a chain could not be sized.
    #[error(transparent)]
    Levels(#[from] ChainClaimError),
    /// The reference breaks a limit.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// The set has no interior: there is a law and a cost, but nowhere from which the law is known to keep the limits.
    #[error("the terminal set has no interior: nothing is left of {constraint}")]
    NoInterior {
        /// What shrinks it to a point.
        constraint: &'static str,
    },
    /// The set could not be sized.
    #[error(transparent)]
    Set(#[from] TerminalSetError),
    /// Malformed matrices.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The path is too long for a chain.
    #[error("a Riccati chain over {steps} steps is beyond the limit of {most}")]
    TooLong {
        /// Steps of the path.
        steps: usize,
        /// The limit.
        most: usize,
    },
    /// The path's time step is not the controller's.
    #[error(
        "terminal ingredients need the path's time step {path_dt_s} s to be the controller's, {dt_s} s"
    )]
    TimeStep {
        /// Of the path.
        path_dt_s: f64,
        /// Of the controller.
        dt_s: f64,
    },
    /// The needle bends where a straight one is expected.
    #[error("a straight needle is expected, found a curvature of {curvature_per_mm} per mm")]
    Bent {
        /// Curvature found, 1/mm.
        curvature_per_mm: f64,
    },
    /// The report of controllability could not be made.
    #[error(transparent)]
    Controllability(#[from] ControllabilityError),
    /// A step of the path cannot be linearised.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The path has no step.
    #[error("the path has no step to make a terminal cost from")]
    NoStep,
}
