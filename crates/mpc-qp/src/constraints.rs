//! The problem's scalar inequalities, one by one, each with its multiplier and slack.
//!
//! The one enumeration behind the residuals, the infeasibility certificate and the blame. Solvers keep their own, so
//! that an error in a solver's bookkeeping shows in the residuals. The terminal equality and ellipsoid are not scalar
//! inequalities and are left to the callers.

use crate::error::Place;
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;
use crate::terminal::TerminalSet;

/// The inequality `left <= right + slack` at a solution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScalarConstraint {
    pub(crate) group: ConstraintGroup,
    pub(crate) place: Place,
    pub(crate) left: f64,
    /// Right-hand side with the given `x_0` and `u_{-1}` moved into it; infinite where absent.
    pub(crate) right: f64,
    /// Euclidean norm of the coefficients of the unknowns.
    pub(crate) norm: f64,
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
    let (stage, multipliers, place) = (
        &problem.stages()[k],
        &solution.multipliers.stages[k],
        Place::Stage(k),
    );
    for i in 0..NU {
        let u = solution.u[k][i];
        let mut emit = |group, left, right, norm, multiplier| {
            visit(ScalarConstraint {
                group,
                place,
                left,
                right,
                norm,
                multiplier,
                slack: 0.0,
            });
        };
        emit(
            ConstraintGroup::InputBounds,
            u,
            stage.u_max[i],
            1.0,
            multipliers.u_max[i],
        );
        emit(
            ConstraintGroup::InputBounds,
            -u,
            -stage.u_min[i],
            1.0,
            multipliers.u_min[i],
        );
        let (step, given, norm) = match k {
            0 => (u, problem.previous_input()[i], 1.0),
            _ => (u - solution.u[k - 1][i], 0.0, std::f64::consts::SQRT_2),
        };
        emit(
            ConstraintGroup::RateLimits,
            step,
            stage.du_max[i] + given,
            norm,
            multipliers.du_max[i],
        );
        emit(
            ConstraintGroup::RateLimits,
            -step,
            -stage.du_min[i] - given,
            norm,
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
    let place = Place::Stage(k);
    if k > 0 {
        for i in 0..NX {
            let x = solution.x[k][i];
            let mut emit = |left, right, multiplier, slack| {
                let group = ConstraintGroup::StateBounds;
                visit(ScalarConstraint {
                    group,
                    place,
                    left,
                    right,
                    norm: 1.0,
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
        let (left, right, squared) = match k {
            0 => (
                of_input,
                row.upper - row.g_x.dot(problem.initial_state()),
                row.h_u.norm_squared(),
            ),
            _ => (
                of_input + row.g_x.dot(&solution.x[k]),
                row.upper,
                row.h_u.norm_squared() + row.g_x.norm_squared(),
            ),
        };
        let (group, norm) = (ConstraintGroup::Rows, squared.sqrt());
        let (multiplier, slack) = (multipliers.rows[i], slacks.rows[i]);
        visit(ScalarConstraint {
            group,
            place,
            left,
            right,
            norm,
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
    let (place, x) = (Place::Terminal, &solution.x[problem.horizon()]);
    for i in 0..NX {
        let mut emit = |left, right, multiplier, slack| {
            let group = ConstraintGroup::StateBounds;
            visit(ScalarConstraint {
                group,
                place,
                left,
                right,
                norm: 1.0,
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
            let (group, norm) = (ConstraintGroup::TerminalSet, face.normal.norm());
            let (left, right) = (face.normal.dot(x), face.upper);
            let (multiplier, slack) = (multipliers[i], slacks[i]);
            visit(ScalarConstraint {
                group,
                place,
                left,
                right,
                norm,
                multiplier,
                slack,
            });
        }
    }
}
