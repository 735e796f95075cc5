//! What the two solvers have in common: settings and one trait.

use crate::error::SolveError;
use crate::problem::OcpQp;
use crate::residuals::Residuals;
use crate::solution::{Solution, SolveStatus};
use std::time::Duration;

/// Where a solve starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// From the solver's own starting point; what the solution holds is ignored.
    #[default]
    Cold,
    /// From what the solution holds, usually the last answer after [`Solution::shift`]. A hint: a solver that cannot use it
    /// starts cold.
    Warm,
}

/// Limits of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// Tolerance of feasibility and duality gap, absolute and relative.
    pub tolerance: f64,
    /// Iterations of all passes together after which a solve stops, with
    /// [`SolveStatus::IterationLimit`](crate::SolveStatus::IterationLimit) unless the residuals show the point to be an answer.
    pub max_iterations: usize,
    /// Wall time after which [`SolveStatus::TimeLimit`](crate::SolveStatus::TimeLimit) is returned, checked each iteration.
    pub time_limit: Option<Duration>,
}

impl Default for SolverSettings {
    /// 1e-8, 1000 iterations, no time limit.
    fn default() -> Self {
        Self {
            tolerance: 1e-8,
            max_iterations: 1000,
            time_limit: None,
        }
    }
}

impl SolverSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`SolveError::Setting`] unless the tolerance is in (0, 1) and there is at least one iteration.
    pub fn validate(&self) -> Result<(), SolveError> {
        if !(self.tolerance > 0.0 && self.tolerance < 1.0) {
            let expected = "a number between 0 and 1";
            return Err(SolveError::Setting {
                field: "tolerance",
                expected,
                found: self.tolerance,
            });
        }
        if self.max_iterations == 0 {
            return Err(SolveError::Setting {
                field: "max_iterations",
                expected: "at least 1",
                found: 0.0,
            });
        }
        Ok(())
    }
}

/// Worst relative residual that a `Solved` may have: the solvers apply the tolerance in their own scaling, which differs from the
/// shared measure by up to two decades. Below 1e-12 nothing but rounding would be asked for; above 1e-4 only what was asked for is granted.
pub(crate) fn accurate_residual(tolerance: f64) -> f64 {
    (100.0 * tolerance).clamp(1e-12, 1e-4).max(tolerance)
}

/// Worst relative residual with which an answer is of use at all, whatever stopped the solver.
pub(crate) fn usable_residual(tolerance: f64) -> f64 {
    (1000.0 * tolerance).clamp(1e-5, 1e-3).max(tolerance)
}

/// What an answer is worth with these residuals.
pub(crate) fn downgraded(status: SolveStatus, residual: f64, tolerance: f64) -> SolveStatus {
    if residual <= accurate_residual(tolerance) {
        status
    } else if residual <= usable_residual(tolerance) {
        SolveStatus::SolvedInaccurate
    } else {
        SolveStatus::NumericalTrouble
    }
}

/// The status that recomputed residuals support, for all that claim an answer or stopped short of one: they may confirm, downgrade or,
/// after a stop, upgrade it. Residuals are absolute where the numbers are below one, so that a stop is an answer only where the gap is
/// small beside the objective itself. The time limit stands.
pub(crate) fn graded(
    status: SolveStatus,
    residuals: &Residuals,
    objective: f64,
    tolerance: f64,
) -> SolveStatus {
    let worst = residuals.worst();
    match status {
        SolveStatus::Solved => downgraded(status, worst, tolerance),
        SolveStatus::SolvedInaccurate
        | SolveStatus::IterationLimit
        | SolveStatus::NumericalTrouble => {
            let gap = residuals.complementarity.absolute;
            if worst <= tolerance && gap <= tolerance * objective.abs() {
                SolveStatus::Solved
            } else if worst <= usable_residual(tolerance) {
                SolveStatus::SolvedInaccurate
            } else if status.has_solution() {
                SolveStatus::NumericalTrouble
            } else {
                status
            }
        }
        SolveStatus::PrimalInfeasible { .. } | SolveStatus::TimeLimit => status,
    }
}

/// A solver for problems of one structure.
pub trait OcpSolver<const NX: usize, const NU: usize> {
    /// Solves `problem` with its present values into `solution`, which holds the guess if `start` is [`Start::Warm`].
    ///
    /// Every numerical outcome is a status in the solution. After any status the solution holds finite numbers.
    ///
    /// # Errors
    /// [`SolveError`] if the shapes do not fit.
    fn solve(
        &mut self,
        problem: &OcpQp<NX, NU>,
        start: Start,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError>;

    /// Replaces the wall time for one solve from now on, `None` for no limit. A solver that cannot stop early ignores it.
    fn set_time_limit(&mut self, _limit: Option<Duration>) {}
}
