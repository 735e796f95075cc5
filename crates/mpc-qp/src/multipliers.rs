//! Lagrange multipliers and constraint violations, shaped like the problem.
//!
//! Sign convention: every inequality multiplier is nonnegative, and the Lagrangian adds `multiplier * (left - right)` of each
//! constraint written as `left <= right`. The costates belong to the dynamics: `costates[k]` is the gradient of the optimal
//! cost with respect to `x_{k+1}`, so that
//! `Q x_k + S u_k + q + A'costates[k] - costates[k-1] + (x_max - x_min) + G'rows = 0` at the optimum.

use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// Multipliers of one stage's constraints; zero where a bound is absent.
#[derive(Debug, Clone, PartialEq)]
pub struct StageMultipliers<const NX: usize, const NU: usize> {
    /// Of `u_k >= u_min`.
    pub u_min: SVector<f64, NU>,
    /// Of `u_k <= u_max`.
    pub u_max: SVector<f64, NU>,
    /// Of `u_k - u_{k-1} >= du_min`.
    pub du_min: SVector<f64, NU>,
    /// Of `u_k - u_{k-1} <= du_max`.
    pub du_max: SVector<f64, NU>,
    /// Of `x_k >= x_min`; zero at stage 0.
    pub x_min: SVector<f64, NX>,
    /// Of `x_k <= x_max`; zero at stage 0.
    pub x_max: SVector<f64, NX>,
    /// Of the general rows.
    pub rows: Vec<f64>,
}

/// Multipliers of the terminal set.
#[derive(Debug, Clone, PartialEq)]
pub enum TerminalSetMultipliers<const NX: usize> {
    /// No terminal set.
    None,
    /// Of `x_N = target`, of either sign.
    Equality(SVector<f64, NX>),
    /// Of the faces.
    Polytope(Vec<f64>),
    /// A point of the (self-dual) second-order cone: `radius >= |offset|`, complementary to
    /// `(sqrt(level), L'(x_N - center))`; the Lagrangian subtracts the inner product.
    Ellipsoid {
        /// First component.
        radius: f64,
        /// The other NX components.
        offset: SVector<f64, NX>,
    },
}

/// Multipliers at `x_N`.
#[derive(Debug, Clone, PartialEq)]
pub struct TerminalMultipliers<const NX: usize> {
    /// Of `x_N >= x_min`.
    pub x_min: SVector<f64, NX>,
    /// Of `x_N <= x_max`.
    pub x_max: SVector<f64, NX>,
    /// Of the terminal set.
    pub set: TerminalSetMultipliers<NX>,
}

/// All multipliers of a problem.
#[derive(Debug, Clone, PartialEq)]
pub struct Multipliers<const NX: usize, const NU: usize> {
    /// Costates: entry `k` belongs to `x_{k+1} = A_k x_k + B_k u_k + c_k`; N entries.
    pub costates: Vec<SVector<f64, NX>>,
    /// Stages 0 to N - 1.
    pub stages: Vec<StageMultipliers<NX, NU>>,
    /// At `x_N`.
    pub terminal: TerminalMultipliers<NX>,
}

/// Violations of soft constraints at one stage; zero where hard or satisfied.
#[derive(Debug, Clone, PartialEq)]
pub struct StageSlacks<const NX: usize> {
    /// Violation of the lower state bounds.
    pub x_min: SVector<f64, NX>,
    /// Violation of the upper state bounds.
    pub x_max: SVector<f64, NX>,
    /// Violation of the general rows.
    pub rows: Vec<f64>,
}

/// Violation of a soft terminal set.
#[derive(Debug, Clone, PartialEq)]
pub enum TerminalSetSlacks<const NX: usize> {
    /// No terminal set.
    None,
    /// `x_N - target`, of either sign.
    Equality(SVector<f64, NX>),
    /// A slack for each face.
    Polytope(Vec<f64>),
    /// Growth of the radius `sqrt(level)`.
    Ellipsoid(f64),
}

/// Violations at `x_N`.
#[derive(Debug, Clone, PartialEq)]
pub struct TerminalSlacks<const NX: usize> {
    /// Violation of the lower state bounds.
    pub x_min: SVector<f64, NX>,
    /// Violation of the upper state bounds.
    pub x_max: SVector<f64, NX>,
    /// Violation of the terminal set.
    pub set: TerminalSetSlacks<NX>,
}

/// All violations of soft constraints.
#[derive(Debug, Clone, PartialEq)]
pub struct Slacks<const NX: usize> {
    /// Stages 0 to N - 1.
    pub stages: Vec<StageSlacks<NX>>,
    /// At `x_N`.
    pub terminal: TerminalSlacks<NX>,
}

impl<const NX: usize, const NU: usize> Multipliers<NX, NU> {
    /// Zero multipliers in the shape of `problem`.
    #[must_use]
    pub fn zeros(problem: &OcpQp<NX, NU>) -> Self {
        let stages = problem.stages().iter().map(|stage| StageMultipliers {
            u_min: SVector::zeros(),
            u_max: SVector::zeros(),
            du_min: SVector::zeros(),
            du_max: SVector::zeros(),
            x_min: SVector::zeros(),
            x_max: SVector::zeros(),
            rows: vec![0.0; stage.rows.len()],
        });
        let set = match &problem.terminal().set {
            TerminalSet::None => TerminalSetMultipliers::None,
            TerminalSet::Equality { .. } => TerminalSetMultipliers::Equality(SVector::zeros()),
            TerminalSet::Polytope { faces } => {
                TerminalSetMultipliers::Polytope(vec![0.0; faces.len()])
            }
            TerminalSet::Ellipsoid { .. } => TerminalSetMultipliers::Ellipsoid {
                radius: 0.0,
                offset: SVector::zeros(),
            },
        };
        Self {
            costates: vec![SVector::zeros(); problem.horizon()],
            stages: stages.collect(),
            terminal: TerminalMultipliers {
                x_min: SVector::zeros(),
                x_max: SVector::zeros(),
                set,
            },
        }
    }

    /// The largest multiplier of a group. At the solution of a hard problem an [exact penalty](crate::Penalty::Exact) on that
    /// group with any weight above this bound has the same solution (the dual norm of the L1 penalty; Fletcher 1987, 14.3).
    #[must_use]
    pub fn exact_penalty_bound(&self, group: ConstraintGroup) -> f64 {
        let largest = |values: &[f64]| {
            values
                .iter()
                .fold(0.0_f64, |bound, value| bound.max(value.abs()))
        };
        let over_stages = |of: &dyn Fn(&StageMultipliers<NX, NU>) -> f64| {
            self.stages.iter().map(of).fold(0.0, f64::max)
        };
        match group {
            ConstraintGroup::InputBounds => {
                over_stages(&|stage| stage.u_min.amax().max(stage.u_max.amax()))
            }
            ConstraintGroup::RateLimits => {
                over_stages(&|stage| stage.du_min.amax().max(stage.du_max.amax()))
            }
            ConstraintGroup::StateBounds => {
                over_stages(&|stage| stage.x_min.amax().max(stage.x_max.amax()))
                    .max(self.terminal.x_min.amax())
                    .max(self.terminal.x_max.amax())
            }
            ConstraintGroup::Rows => over_stages(&|stage| largest(&stage.rows)),
            ConstraintGroup::TerminalSet => match &self.terminal.set {
                TerminalSetMultipliers::None => 0.0,
                TerminalSetMultipliers::Equality(multiplier) => multiplier.amax(),
                TerminalSetMultipliers::Polytope(multipliers) => largest(multipliers),
                TerminalSetMultipliers::Ellipsoid { radius, .. } => *radius,
            },
        }
    }
}

impl<const NX: usize> Slacks<NX> {
    /// Zero slacks in the shape of `problem`.
    #[must_use]
    pub fn zeros<const NU: usize>(problem: &OcpQp<NX, NU>) -> Self {
        let stages = problem.stages().iter().map(|stage| StageSlacks {
            x_min: SVector::zeros(),
            x_max: SVector::zeros(),
            rows: vec![0.0; stage.rows.len()],
        });
        let set = match &problem.terminal().set {
            TerminalSet::None => TerminalSetSlacks::None,
            TerminalSet::Equality { .. } => TerminalSetSlacks::Equality(SVector::zeros()),
            TerminalSet::Polytope { faces } => TerminalSetSlacks::Polytope(vec![0.0; faces.len()]),
            TerminalSet::Ellipsoid { .. } => TerminalSetSlacks::Ellipsoid(0.0),
        };
        Self {
            stages: stages.collect(),
            terminal: TerminalSlacks {
                x_min: SVector::zeros(),
                x_max: SVector::zeros(),
                set,
            },
        }
    }

    /// The largest violation in a group; zero for the groups that are always hard.
    #[must_use]
    pub fn largest(&self, group: ConstraintGroup) -> f64 {
        let largest = |values: &[f64]| {
            values
                .iter()
                .fold(0.0_f64, |bound, value| bound.max(value.abs()))
        };
        match group {
            ConstraintGroup::InputBounds | ConstraintGroup::RateLimits => 0.0,
            ConstraintGroup::StateBounds => self
                .stages
                .iter()
                .map(|stage| stage.x_min.amax().max(stage.x_max.amax()))
                .fold(
                    self.terminal.x_min.amax().max(self.terminal.x_max.amax()),
                    f64::max,
                ),
            ConstraintGroup::Rows => self
                .stages
                .iter()
                .map(|stage| largest(&stage.rows))
                .fold(0.0, f64::max),
            ConstraintGroup::TerminalSet => match &self.terminal.set {
                TerminalSetSlacks::None => 0.0,
                TerminalSetSlacks::Equality(violation) => violation.amax(),
                TerminalSetSlacks::Polytope(violations) => largest(violations),
                TerminalSetSlacks::Ellipsoid(growth) => *growth,
            },
        }
    }
}
