//! A reference from positions alone: the trajectory optimisation that `needle-model` poses, solved over the whole path.
//!
//! Gauss-Newton by multiple shooting (`search`), one stage for each step of the path. The answer is the closest simulation of the inputs
//! found, so the needle executes it exactly; what the needle cannot follow shows as distance to the targets. The first pose is the guess's.

mod search;

use mpc_qp::{ProblemError, SolveError};
use needle_model::{
    CurvatureExcess, PositionPathProblem, ReferencePath, ReferencePathError, StepError,
};
use search::Search;

/// Linearisations at most.
const MAX_ITERATIONS: usize = 60;

/// Relative excess of curvature that is reported.
const EXCESS_MARGIN: f64 = 0.02;

/// A path that a needle executes, and how close it comes to the positions.
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructedPath {
    /// The path; its largest defect is rounding.
    pub path: ReferencePath,
    /// Root mean square distance to the targets, mm.
    pub rms_mm: f64,
    /// Largest distance to a target, mm.
    pub worst_mm: f64,
    /// Step of the largest distance.
    pub worst_step: usize,
    /// Where the positions bend more than the needle can; empty for a feasible curve.
    pub excesses: Vec<CurvatureExcess>,
    /// Linearisations made.
    pub iterations: usize,
    /// Whether the last one settled; false where iterations or damping ran out first.
    pub converged: bool,
}

/// Why there is no path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReconstructionError {
    /// An iterate is not finite.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The quadratic program refuses the data.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// The solver refuses the problem.
    #[error(transparent)]
    Solver(#[from] SolveError),
    /// The simulation of the inputs is no path.
    #[error(transparent)]
    Path(#[from] ReferencePathError),
}

/// Poses and inputs that come closest to the positions of `problem`.
///
/// # Errors
/// [`ReconstructionError`], which a problem that `needle-model` accepted should not cause.
pub fn reconstruct_path(
    problem: &PositionPathProblem,
) -> Result<ReconstructedPath, ReconstructionError> {
    let mut search = Search::new(problem)?;
    let mut iterations = 0;
    while iterations < MAX_ITERATIONS && search.goes_on() {
        iterations += 1;
        search.improve()?;
    }
    let (path, converged) = search.closest()?;
    let distances = path
        .poses()
        .iter()
        .zip(problem.targets_mm())
        .map(|(pose, y)| (pose.position_mm - y).norm());
    let (mut squares, mut worst) = (0.0, (0, 0.0));
    for (step, distance) in distances.enumerate() {
        squares += distance * distance;
        if distance > worst.1 {
            worst = (step, distance);
        }
    }
    Ok(ReconstructedPath {
        rms_mm: f64::sqrt(squares / path.poses().len() as f64),
        worst_mm: worst.1,
        worst_step: worst.0,
        excesses: problem
            .curve()
            .curvature_excesses(problem.needle(), EXCESS_MARGIN),
        path,
        iterations,
        converged,
    })
}
