//! The paper's own program, errors included: **a replication, not a controller to use**.
//!
//! The figures of "A Bevel-Tip Needle Path Tracking: A Model Predictive Approach" were made by a program that differs
//! from the paper's text and from the needle's mechanics. This module repeats that program on purpose, so that its figures
//! can be regenerated and its claims measured. Among what is wrong and kept (`docs/paper-audit.md` has the whole list):
//!
//! - the prediction matrix A lacks the identity and the factor dt, and its first row has the beta column's entry under alpha;
//! - rows are scaled to x in mm, y and z in cm, and the weights act on those;
//! - the plant is forward Euler and updates beta before gamma reads it; the reference is made with the same plant;
//! - the first input's rate is free, v has no lower bound, and the input u_N costs although it moves nothing;
//! - the level c = 10 of the terminal set has no relation to the limits.
//!
//! Units in here are the program's own (metres, the scaled rows, radians, seconds); the [`RunLog`](crate::RunLog)s that
//! come out are in mm.

mod bevel;
mod closed_loop;
mod constants;
mod controller;
mod horizon;
mod sets;
mod straight;

pub use bevel::{BevelSettings, bevel_reference, run_bevel};
pub use constants::{CONSTANTS, Constants, NeedleConstants};
pub use controller::{PublishedController, PublishedPathError};
pub use sets::{Figure, PublishedRun, RunSettings, figure_runs};
pub use straight::{StraightSettings, run_straight, straight_reference};

use nalgebra::SVector;

/// Step of every run.
pub const DT_S: f64 = 0.1;

/// First index of least Euclidean distance.
fn nearest<const D: usize>(path: &[SVector<f64, D>], point: &SVector<f64, D>) -> usize {
    let distances = path
        .iter()
        .map(|candidate| (candidate - point).norm_squared());
    let closer = |best: (usize, f64), next: (usize, f64)| if next.1 < best.1 { next } else { best };
    distances
        .enumerate()
        .reduce(closer)
        .map_or(0, |(index, _)| index)
}

/// A window of N + 1 columns needs N from 1 to the number of steps of the reference.
fn check_horizon(found: usize, longest: usize) -> Result<(), PublishedError> {
    match (1..=longest).contains(&found) {
        true => Ok(()),
        false => Err(PublishedError::Horizon { longest, found }),
    }
}

/// Why a published run cannot be computed at all. A solve that fails is a status in the log instead.
#[derive(Debug, thiserror::Error)]
pub enum PublishedError {
    /// The terminal weight of some step does not exist.
    #[error("the terminal weight of step {step} does not exist")]
    TerminalWeight {
        /// Closed-loop step.
        step: usize,
        /// Why.
        source: lqr::DareError,
    },
    /// The settings do not make a valid program.
    #[error("the program of step {step} is not valid")]
    Program {
        /// Closed-loop step.
        step: usize,
        /// Why.
        source: mpc_qp::ProblemError,
    },
    /// The horizon does not fit the reference.
    #[error("the horizon is {found}, expected 1 to {longest}")]
    Horizon {
        /// Longest horizon.
        longest: usize,
        /// As given.
        found: usize,
    },
    /// The solver's settings or memory do not fit the program.
    #[error("the program of step {step} cannot be handed to the solver")]
    Solver {
        /// Closed-loop step.
        step: usize,
        /// Why.
        source: mpc_qp::SolveError,
    },
}
