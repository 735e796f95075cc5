//! How well a point satisfies the optimality conditions, recomputed from the problem's own data.
//!
//! Both solvers' answers are judged by this file and neither uses it inside. With the Lagrangian of
//! [`crate::Multipliers`] it evaluates stationarity, dynamics, constraints, signs of the multipliers and complementarity.

use crate::constraints::for_each_scalar;
use crate::lagrangian::LagrangianGradient;
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::Penalty;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// Largest magnitude; NaN if some entry is, which `amax` would pass over.
fn largest<const M: usize>(vector: &SVector<f64, M>) -> f64 {
    let larger = |most: f64, value: f64| {
        if value <= most || most.is_nan() {
            most
        } else {
            value
        }
    };
    vector.iter().map(|value| value.abs()).fold(0.0, larger)
}

/// A violation and the size of the terms that should have cancelled.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// Largest violation, in the unit of the condition.
    pub absolute: f64,
    /// Largest term met in these conditions.
    pub scale: f64,
}

impl Residual {
    /// `absolute / max(1, scale)`, infinite unless both are finite.
    #[must_use]
    pub fn relative(&self) -> f64 {
        if self.absolute.is_finite() && self.scale.is_finite() {
            self.absolute / self.scale.max(1.0)
        } else {
            f64::INFINITY
        }
    }

    /// NaN and infinite scales count as infinite violations; a condition without a limit comes as minus infinity and holds.
    fn record(&mut self, violation: f64, scale: f64) {
        if violation < f64::INFINITY && scale.is_finite() {
            self.absolute = self.absolute.max(violation);
            self.scale = self.scale.max(scale);
        } else {
            self.absolute = f64::INFINITY;
        }
    }
}

/// The optimality conditions at a solution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residuals {
    /// Gradient of the Lagrangian with respect to `x_1..x_N`, `u_0..u_{N-1}` and quadratic slacks.
    pub stationarity: Residual,
    /// `A x_k + B u_k + c - x_{k+1}`, and the terminal equality.
    pub dynamics: Residual,
    /// Violation of the inequalities beyond their slacks, and negative slacks.
    pub constraints: Residual,
    /// Multipliers below zero, outside the cone, or above the price of an exact penalty.
    pub multiplier_signs: Residual,
    /// Sum of multiplier times distance to the constraint: the duality gap; its scale is the objective.
    pub complementarity: Residual,
}

impl Residuals {
    /// The residuals of `solution` as an answer to `problem`. Shapes must agree.
    #[must_use]
    pub fn evaluate<const NX: usize, const NU: usize>(
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) -> Self {
        let mut residuals = Self::default();
        residuals.add_stationarity(&LagrangianGradient {
            problem,
            solution,
            with_cost: true,
        });
        residuals.add_dynamics(problem, solution);
        residuals.add_scalar_constraints(problem, solution);
        residuals.add_terminal_set(problem, solution);
        residuals.complementarity.scale = problem
            .objective(&solution.x, &solution.u, &solution.slacks)
            .abs();
        residuals
    }

    /// The largest of the relative residuals.
    #[must_use]
    pub fn worst(&self) -> f64 {
        [
            self.stationarity,
            self.dynamics,
            self.constraints,
            self.multiplier_signs,
            self.complementarity,
        ]
        .iter()
        .map(Residual::relative)
        .fold(0.0, f64::max)
    }

    fn add_stationarity<const NX: usize, const NU: usize>(
        &mut self,
        gradient: &LagrangianGradient<'_, NX, NU>,
    ) {
        for k in 0..gradient.problem.horizon() {
            let of_input = gradient.input(k);
            self.stationarity
                .record(largest(&of_input.sum), of_input.scale);
            let of_state = gradient.state(k + 1);
            self.stationarity
                .record(largest(&of_state.sum), of_state.scale);
        }
    }

    fn add_dynamics<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        let wrong_start = solution.x[0] - problem.initial_state();
        self.dynamics
            .record(largest(&wrong_start), problem.initial_state().amax());
        for (k, stage) in problem.stages().iter().enumerate() {
            let gap = stage.successor(&solution.x[k], &solution.u[k]) - solution.x[k + 1];
            self.dynamics
                .record(largest(&gap), solution.x[k + 1].amax().max(stage.c.amax()));
        }
    }

    fn add_scalar_constraints<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        for_each_scalar(problem, solution, |constraint| {
            let (multiplier, slack) = (constraint.multiplier, constraint.slack);
            self.multiplier_signs.record(-multiplier, multiplier.abs());
            if constraint.right == f64::INFINITY {
                self.multiplier_signs.record(multiplier.abs(), 0.0);
                self.constraints.record(slack.abs(), 0.0);
                return;
            }
            let distance = constraint.right + slack - constraint.left;
            // A bound far away is no term that cancels: 1e20 for "absent" must not hide the violation of another.
            let terms = if distance < 0.0 {
                constraint.left.abs().max(constraint.right.abs())
            } else {
                constraint.left.abs()
            };
            self.constraints.record(-distance, terms);
            self.complementarity.absolute += (multiplier * distance).abs();
            self.add_slack(problem.softening().of(constraint.group), slack, multiplier);
        });
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
                self.dynamics.record(
                    largest(&(x - target - violation)),
                    x.amax().max(target.amax()),
                );
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
