//! The problem's scalar inequalities, one by one, each with its multiplier and slack.
//!
//! The one enumeration behind the residuals and the infeasibility certificate. Solvers keep their own, so
//! that an error in a solver's bookkeeping shows in the residuals. The terminal equality and ellipsoid are not scalar
//! inequalities and are left to the callers.

use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;
use crate::terminal::TerminalSet;

/// The inequality `left <= right + slack` at a solution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScalarConstraint {
    pub(crate) group: ConstraintGroup,
    pub(crate) left: f64,
    /// Right-hand side with the given `x_0` and `u_{-1}` moved into it; infinite where absent.
    pub(crate) right: f64,
    pub(crate) multiplier: f64,
    pub(crate) slack: f64,
}

/// Calls `visit` for every scalar inequality of the problem, absent ones (`right = +inf`) included.
pub(crate) fn for_each_scalar<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
    mut visit: impl FnMut(ScalarConstraint),
) {
    for k in 0..problem.horizon() {
        inputs_and_rates(problem, solution, k, &mut visit);
        states_and_rows(problem, solution, k, &mut visit);
    }
    at_the_end(problem, solution, &mut visit);
}

fn inputs_and_rates<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
    k: usize,
    visit: &mut impl FnMut(ScalarConstraint),
) {
    let (stage, multipliers) = (&problem.stages()[k], &solution.multipliers.stages[k]);
    for i in 0..NU {
        let u = solution.u[k][i];
        let mut emit = |group, left, right, multiplier| {
            visit(ScalarConstraint {
                group,
                left,
                right,
                multiplier,
                slack: 0.0,
            });
        };
        emit(
            ConstraintGroup::InputBounds,
            u,
            stage.u_max[i],
            multipliers.u_max[i],
        );
        emit(
            ConstraintGroup::InputBounds,
            -u,
            -stage.u_min[i],
            multipliers.u_min[i],
        );
        let (step, given) = match k {
            0 => (u, problem.previous_input()[i]),
            _ => (u - solution.u[k - 1][i], 0.0),
        };
        emit(
            ConstraintGroup::RateLimits,
            step,
            stage.du_max[i] + given,
            multipliers.du_max[i],
        );
        emit(
            ConstraintGroup::RateLimits,
            -step,
            -stage.du_min[i] - given,
            multipliers.du_min[i],
        );
    }
}

fn states_and_rows<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
    k: usize,
    visit: &mut impl FnMut(ScalarConstraint),
) {
    let (stage, multipliers, slacks) = (
        &problem.stages()[k],
        &solution.multipliers.stages[k],
        &solution.slacks.stages[k],
    );
    if k > 0 {
        for i in 0..NX {
            let x = solution.x[k][i];
            let mut emit = |left, right, multiplier, slack| {
                let group = ConstraintGroup::StateBounds;
                visit(ScalarConstraint {
                    group,
                    left,
                    right,
                    multiplier,
                    slack,
                });
            };
            emit(x, stage.x_max[i], multipliers.x_max[i], slacks.x_max[i]);
            emit(-x, -stage.x_min[i], multipliers.x_min[i], slacks.x_min[i]);
        }
    }
    for (i, row) in stage.rows.iter().enumerate() {
        let of_input = row.h_u.dot(&solution.u[k]);
        let (left, right) = match k {
            0 => (of_input, row.upper - row.g_x.dot(problem.initial_state())),
            _ => (of_input + row.g_x.dot(&solution.x[k]), row.upper),
        };
        let group = ConstraintGroup::Rows;
        let (multiplier, slack) = (multipliers.rows[i], slacks.rows[i]);
        visit(ScalarConstraint {
            group,
            left,
            right,
            multiplier,
            slack,
        });
    }
}

fn at_the_end<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
    visit: &mut impl FnMut(ScalarConstraint),
) {
    let (terminal, multipliers, slacks) = (
        problem.terminal(),
        &solution.multipliers.terminal,
        &solution.slacks.terminal,
    );
    let x = &solution.x[problem.horizon()];
    for i in 0..NX {
        let mut emit = |left, right, multiplier, slack| {
            let group = ConstraintGroup::StateBounds;
            visit(ScalarConstraint {
                group,
                left,
                right,
                multiplier,
                slack,
            });
        };
        emit(
            x[i],
            terminal.x_max[i],
            multipliers.x_max[i],
            slacks.x_max[i],
        );
        emit(
            -x[i],
            -terminal.x_min[i],
            multipliers.x_min[i],
            slacks.x_min[i],
        );
    }
    if let (
        TerminalSet::Polytope { faces },
        TerminalSetMultipliers::Polytope(multipliers),
        TerminalSetSlacks::Polytope(slacks),
    ) = (&terminal.set, &multipliers.set, &slacks.set)
    {
        for (i, face) in faces.iter().enumerate() {
            let group = ConstraintGroup::TerminalSet;
            let (left, right) = (face.normal.dot(x), face.upper);
            let (multiplier, slack) = (multipliers[i], slacks[i]);
            visit(ScalarConstraint {
                group,
                left,
                right,
                multiplier,
                slack,
            });
        }
    }
}
