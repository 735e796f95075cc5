//! How well a point satisfies the optimality conditions, recomputed from the problem's own data.
//!
//! Both solvers' answers are judged by this file and neither uses it inside. With the Lagrangian of
//! [`crate::Multipliers`] it evaluates stationarity, dynamics, constraints, signs of the multipliers and complementarity.

use crate::constraints::for_each_scalar;
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::Penalty;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// A violation and the size of the terms that should have cancelled.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// Largest violation, in the unit of the condition.
    pub absolute: f64,
    /// Largest term met in these conditions.
    pub scale: f64,
}

impl Residual {
    /// `absolute / max(1, scale)`.
    #[must_use]
    pub fn relative(&self) -> f64 {
        self.absolute / self.scale.max(1.0)
    }

    /// NaN counts as an infinite violation.
    fn record(&mut self, violation: f64, scale: f64) {
        self.absolute = if violation.is_nan() {
            f64::INFINITY
        } else {
            self.absolute.max(violation)
        };
        self.scale = self.scale.max(scale);
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
                .record(of_input.sum.amax(), of_input.scale);
            let of_state = gradient.state(k + 1);
            self.stationarity
                .record(of_state.sum.amax(), of_state.scale);
        }
    }

    fn add_dynamics<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        let wrong_start = solution.x[0] - problem.initial_state();
        self.dynamics
            .record(wrong_start.amax(), problem.initial_state().amax());
        for (k, stage) in problem.stages().iter().enumerate() {
            let gap = stage.successor(&solution.x[k], &solution.u[k]) - solution.x[k + 1];
            self.dynamics
                .record(gap.amax(), solution.x[k + 1].amax().max(stage.c.amax()));
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
            self.constraints
                .record(-distance, constraint.left.abs().max(constraint.right.abs()));
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
                self.multiplier_signs.record(multiplier - weight, weight);
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
                    .record((x - target - violation).amax(), x.amax().max(target.amax()));
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
            _ => {}
        }
    }
}

/// A sum of vectors with the largest entry met in any of them.
pub(crate) struct Balance<const N: usize> {
    pub(crate) sum: SVector<f64, N>,
    pub(crate) scale: f64,
}

impl<const N: usize> Balance<N> {
    fn zero() -> Self {
        Self {
            sum: SVector::zeros(),
            scale: 0.0,
        }
    }

    fn add(&mut self, term: SVector<f64, N>) {
        self.scale = self.scale.max(term.amax());
        self.sum += term;
    }
}

/// Gradient of the Lagrangian, or without cost of the constraints alone (for certificates).
pub(crate) struct LagrangianGradient<'a, const NX: usize, const NU: usize> {
    pub(crate) problem: &'a OcpQp<NX, NU>,
    pub(crate) solution: &'a Solution<NX, NU>,
    pub(crate) with_cost: bool,
}

impl<const NX: usize, const NU: usize> LagrangianGradient<'_, NX, NU> {
    /// With respect to `u_k`, k from 0 to N - 1.
    pub(crate) fn input(&self, k: usize) -> Balance<NU> {
        let (stage, multipliers) = (
            &self.problem.stages()[k],
            &self.solution.multipliers.stages[k],
        );
        let mut balance = Balance::zero();
        if self.with_cost {
            balance.add(stage.r * self.solution.u[k]);
            balance.add(stage.s.tr_mul(&self.solution.x[k]));
            balance.add(stage.r_linear);
        }
        balance.add(stage.b.tr_mul(&self.solution.multipliers.costates[k]));
        balance.add(multipliers.u_max - multipliers.u_min);
        balance.add(multipliers.du_max - multipliers.du_min);
        if let Some(next) = self.solution.multipliers.stages.get(k + 1) {
            balance.add(next.du_min - next.du_max);
        }
        for (row, &multiplier) in stage.rows.iter().zip(&multipliers.rows) {
            balance.add(row.h_u * multiplier);
        }
        balance
    }

    /// With respect to `x_k`, k from 1 to N.
    pub(crate) fn state(&self, k: usize) -> Balance<NX> {
        let costates = &self.solution.multipliers.costates;
        let mut balance = Balance::zero();
        balance.add(-costates[k - 1]);
        let Some(stage) = self.problem.stages().get(k) else {
            self.add_terminal_state(&mut balance);
            return balance;
        };
        let multipliers = &self.solution.multipliers.stages[k];
        if self.with_cost {
            balance.add(stage.q * self.solution.x[k]);
            balance.add(stage.s * self.solution.u[k]);
            balance.add(stage.q_linear);
        }
        balance.add(stage.a.tr_mul(&costates[k]));
        balance.add(multipliers.x_max - multipliers.x_min);
        for (row, &multiplier) in stage.rows.iter().zip(&multipliers.rows) {
            balance.add(row.g_x * multiplier);
        }
        balance
    }

    fn add_terminal_state(&self, balance: &mut Balance<NX>) {
        let (terminal, multipliers) =
            (self.problem.terminal(), &self.solution.multipliers.terminal);
        if self.with_cost {
            balance.add(terminal.p * self.solution.x[self.problem.horizon()]);
            balance.add(terminal.p_linear);
        }
        balance.add(multipliers.x_max - multipliers.x_min);
        match (&terminal.set, &multipliers.set) {
            (_, TerminalSetMultipliers::Equality(multiplier)) => balance.add(*multiplier),
            (TerminalSet::Polytope { faces }, TerminalSetMultipliers::Polytope(multipliers)) => {
                for (face, &multiplier) in faces.iter().zip(multipliers) {
                    balance.add(face.normal * multiplier);
                }
            }
            (_, TerminalSetMultipliers::Ellipsoid { offset, .. }) => {
                if let Some(cone) = self.problem.terminal_cone() {
                    balance.add(-(cone.factor * offset));
                }
            }
            _ => {}
        }
    }
}
