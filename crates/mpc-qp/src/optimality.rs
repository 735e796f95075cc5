//! The optimality conditions at a point, recomputed from the problem's own data.
//!
//! Both solvers' answers are judged by this file and neither uses it inside. With the Lagrangian of
//! [`crate::Multipliers`] it evaluates stationarity, dynamics, constraints, signs of the multipliers and complementarity.

use crate::constraints::{ScalarConstraint, for_each_scalar};
use crate::lagrangian::{Balance, LagrangianGradient, Terms};
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::residuals::{Residual, Residuals};
use crate::softening::Penalty;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

fn sum<const N: usize, const COUNT: usize>(
    terms: Terms,
    vectors: [SVector<f64, N>; COUNT],
) -> Balance<N> {
    let mut balance = Balance::new(terms);
    vectors.into_iter().for_each(|vector| balance.add(vector));
    balance
}

/// Relative violation below which it does not matter how large the terms are within a matrix-vector product.
const NEGLIGIBLE: f64 = 1e-10;

impl Residual {
    /// A condition for each component. The cheap terms serve where they already show what is negligible.
    fn record_each<const M: usize>(&mut self, balance: impl Fn(Terms) -> Balance<M>) {
        let mut found = balance(Terms::Products);
        let negligible = |(rest, terms): (&f64, &f64)| rest.abs() <= NEGLIGIBLE * terms.max(1.0);
        if !found.sum.iter().zip(&found.scale).all(negligible) {
            found = balance(Terms::Summands);
        }
        for (violation, &terms) in found.sum.iter().zip(&found.scale) {
            self.record(violation.abs(), terms);
        }
    }
}

impl<const NX: usize, const NU: usize> Solution<NX, NU> {
    /// Recomputes objective and residuals from the problem's data; the residuals are infinite if this is laid out for another problem.
    pub fn evaluate(&mut self, problem: &OcpQp<NX, NU>) {
        self.objective = problem.objective(&self.x, &self.u, &self.slacks);
        self.residuals = Residuals::beside(self.objective, problem, self);
    }
}

impl Residuals {
    /// The residuals of `solution` as an answer to `problem`; infinite if it is laid out for another one.
    #[must_use]
    pub fn evaluate<const NX: usize, const NU: usize>(
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) -> Self {
        let objective = problem.objective(&solution.x, &solution.u, &solution.slacks);
        Self::beside(objective, problem, solution)
    }

    /// The residuals of `solution`, whose cost is `objective`.
    pub(crate) fn beside<const NX: usize, const NU: usize>(
        objective: f64,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) -> Self {
        let mut residuals = Self::default();
        if solution.check_shape(problem).is_err() {
            for of_another in [
                &mut residuals.stationarity,
                &mut residuals.dynamics,
                &mut residuals.constraints,
                &mut residuals.multiplier_signs,
                &mut residuals.complementarity,
            ] {
                of_another.record(f64::INFINITY, 0.0);
            }
            return residuals;
        }
        residuals.add_stationarity(problem, solution);
        residuals.add_dynamics(problem, solution);
        residuals.add_scalar_constraints(problem, solution);
        residuals.add_terminal_set(problem, solution);
        let gap = std::mem::take(&mut residuals.complementarity).absolute;
        residuals.complementarity.record(gap, objective.abs());
        residuals
    }

    fn add_stationarity<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        let gradient = |terms| LagrangianGradient {
            problem,
            solution,
            with_cost: true,
            terms,
        };
        for k in 0..problem.horizon() {
            self.stationarity
                .record_each(|terms| gradient(terms).input(k));
            self.stationarity
                .record_each(|terms| gradient(terms).state(k + 1));
        }
    }

    fn add_dynamics<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        self.dynamics
            .record_each(|terms| sum(terms, [-solution.x[0], *problem.initial_state()]));
        for (k, stage) in problem.stages().iter().enumerate() {
            self.dynamics.record_each(|terms| {
                let mut balance = sum(terms, [-solution.x[k + 1], stage.c]);
                balance.add_product(&stage.a, &solution.x[k]);
                balance.add_product(&stage.b, &solution.u[k]);
                balance
            });
        }
    }

    fn add_scalar_constraints<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        for_each_scalar(problem, solution, |constraint| {
            let ScalarConstraint {
                multiplier, slack, ..
            } = constraint;
            let distance = constraint.right + slack - constraint.left;
            // Most constraints are absent or not active, and satisfy all their conditions.
            if !(multiplier == 0.0 && slack == 0.0 && distance >= 0.0) {
                self.add_scalar(problem.softening().of(constraint.group), &constraint);
            }
        });
    }

    fn add_scalar(&mut self, penalty: Penalty, constraint: &ScalarConstraint) {
        let &ScalarConstraint {
            left,
            right,
            multiplier,
            slack,
            ..
        } = constraint;
        self.multiplier_signs.record(-multiplier, multiplier.abs());
        if right == f64::INFINITY {
            self.multiplier_signs.record(multiplier.abs(), 0.0);
            self.constraints.record(slack.abs(), 0.0);
            return;
        }
        let distance = right + slack - left;
        self.constraints
            .record(-distance, left.abs().max(right.abs()));
        self.complementarity.absolute += (multiplier * distance).abs();
        self.add_slack(penalty, slack, multiplier);
    }

    /// Conditions on one slack: stationary or complementary against its price.
    fn add_slack(&mut self, penalty: Penalty, slack: f64, multiplier: f64) {
        match penalty {
            Penalty::Hard => self.constraints.record(slack.abs(), 0.0),
            Penalty::Exact { weight } => {
                self.constraints.record(-slack, slack.abs());
                // The multiplier as scale: a weight of 1e20 must not hide a wrong sign.
                self.multiplier_signs
                    .record(multiplier - weight, multiplier.abs());
                self.complementarity.absolute += (slack * (weight - multiplier)).abs();
            }
            Penalty::Quadratic { weight } => {
                self.constraints.record(-slack, slack.abs());
                self.stationarity
                    .record((multiplier - weight * slack).abs(), multiplier.abs());
            }
        }
    }

    fn add_terminal_set<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        let penalty = problem.softening().terminal_set;
        let x = &solution.x[problem.horizon()];
        match (
            &problem.terminal().set,
            &solution.multipliers.terminal.set,
            &solution.slacks.terminal.set,
        ) {
            (
                TerminalSet::Equality { target },
                TerminalSetMultipliers::Equality(multiplier),
                TerminalSetSlacks::Equality(violation),
            ) => {
                self.dynamics
                    .record_each(|terms| sum(terms, [*x, -target, -violation]));
                for i in 0..NX {
                    // The penalty is on |violation|: its multiplier has the violation's sign.
                    let along = if violation[i] == 0.0 {
                        multiplier[i].abs()
                    } else {
                        multiplier[i] * violation[i].signum()
                    };
                    self.add_slack(penalty, violation[i].abs(), along);
                    self.multiplier_signs.record(
                        multiplier[i].abs() - penalty.slope(violation[i].abs()),
                        multiplier[i].abs(),
                    );
                }
            }
            (
                TerminalSet::Ellipsoid { .. },
                TerminalSetMultipliers::Ellipsoid { radius, offset },
                TerminalSetSlacks::Ellipsoid(growth),
            ) => {
                let Some(cone) = problem.terminal_cone() else {
                    return;
                };
                let inside = cone.offset(x);
                self.constraints.record(
                    inside.norm() - cone.radius - growth,
                    inside.norm().max(cone.radius),
                );
                self.multiplier_signs
                    .record(offset.norm() - radius, radius.abs());
                self.complementarity.absolute +=
                    ((cone.radius + growth) * radius + inside.dot(offset)).abs();
                self.add_slack(penalty, *growth, *radius);
            }
            // Of the polytope the faces are among the scalar constraints.
            (TerminalSet::None, TerminalSetMultipliers::None, TerminalSetSlacks::None)
            | (
                TerminalSet::Polytope { .. },
                TerminalSetMultipliers::Polytope(_),
                TerminalSetSlacks::Polytope(_),
            ) => {}
            // An answer to another kind of problem.
            _ => self.constraints.record(f64::INFINITY, 0.0),
        }
    }
}
