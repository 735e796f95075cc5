//! Constraint groups, and which of them may be violated at a price.
//!
//! A soft constraint `a'z <= b` becomes `a'z - t <= b` with slack `t >= 0` and a price: `weight * t`
//! ([`Penalty::Exact`]) or `weight / 2 * t^2` ([`Penalty::Quadratic`]). An exact penalty leaves the hard solution
//! untouched when `weight` exceeds the largest multiplier of the group in the hard problem
//! ([`Multipliers::exact_penalty_bound`](crate::Multipliers::exact_penalty_bound)); a quadratic one always trades a little
//! violation for cost. Input bounds and rate limits are the actuator's and stay hard.

use crate::error::ProblemError;
use std::fmt;

/// The kinds of constraint, for softening and for blame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ConstraintGroup {
    /// `u_min <= u_k <= u_max`; always hard.
    InputBounds,
    /// `du_min <= u_k - u_{k-1} <= du_max`; always hard.
    RateLimits,
    /// `x_min <= x_k <= x_max`, stages 1 to N.
    StateBounds,
    /// `G_k x_k + H_k u_k <= g_k`.
    Rows,
    /// The terminal equality, polytope or ellipsoid.
    TerminalSet,
}

impl fmt::Display for ConstraintGroup {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::InputBounds => "input bounds",
            Self::RateLimits => "rate limits",
            Self::StateBounds => "state bounds",
            Self::Rows => "rows",
            Self::TerminalSet => "terminal set",
        })
    }
}

/// The price of violating one constraint of a group.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Penalty {
    /// No violation at any price.
    #[default]
    Hard,
    /// `weight * t`, the L1 penalty.
    Exact {
        /// Cost per unit of violation, positive.
        weight: f64,
    },
    /// `weight / 2 * t^2`.
    Quadratic {
        /// Cost per squared unit of violation, positive.
        weight: f64,
    },
}

impl Penalty {
    /// True unless [`Penalty::Hard`].
    #[must_use]
    pub fn is_soft(&self) -> bool {
        !matches!(self, Self::Hard)
    }

    /// The cost of a slack `t >= 0`; zero if hard.
    #[must_use]
    pub fn cost(&self, slack: f64) -> f64 {
        match *self {
            Self::Hard => 0.0,
            Self::Exact { weight } => weight * slack,
            Self::Quadratic { weight } => 0.5 * weight * slack * slack,
        }
    }

    /// Derivative of [`Self::cost`] at `slack`: the largest multiplier that the constraint can have there.
    #[must_use]
    pub fn slope(&self, slack: f64) -> f64 {
        match *self {
            Self::Hard => f64::INFINITY,
            Self::Exact { weight } => weight,
            Self::Quadratic { weight } => weight * slack,
        }
    }

    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Hard => "hard",
            Self::Exact { .. } => "exact",
            Self::Quadratic { .. } => "quadratic",
        }
    }
}

/// The penalty of each group that may be softened; all hard by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Softening {
    /// State bounds, each side of each component with a slack of its own.
    pub state_bounds: Penalty,
    /// General rows, a slack each.
    pub rows: Penalty,
    /// Terminal set: a slack for each polytope row or equality component; for the ellipsoid one slack `t` in
    /// `|L'(x_N - x_c)| <= sqrt(level) + t`.
    pub terminal_set: Penalty,
}

impl Softening {
    pub(crate) fn groups(&self) -> [(ConstraintGroup, Penalty); 3] {
        [
            (ConstraintGroup::StateBounds, self.state_bounds),
            (ConstraintGroup::Rows, self.rows),
            (ConstraintGroup::TerminalSet, self.terminal_set),
        ]
    }

    /// The penalty of a group; inputs and rates are always hard.
    #[must_use]
    pub fn of(&self, group: ConstraintGroup) -> Penalty {
        match group {
            ConstraintGroup::InputBounds | ConstraintGroup::RateLimits => Penalty::Hard,
            ConstraintGroup::StateBounds => self.state_bounds,
            ConstraintGroup::Rows => self.rows,
            ConstraintGroup::TerminalSet => self.terminal_set,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), ProblemError> {
        for (group, penalty) in self.groups() {
            if let Penalty::Exact { weight } | Penalty::Quadratic { weight } = penalty
                && !(weight > 0.0 && weight.is_finite())
            {
                return Err(ProblemError::PenaltyWeight {
                    group,
                    found: weight,
                });
            }
        }
        Ok(())
    }

    pub(crate) fn same_kinds(&self, other: &Self) -> Result<(), ProblemError> {
        for ((group, expected), (_, found)) in self.groups().into_iter().zip(other.groups()) {
            if expected.kind() != found.kind() {
                return Err(ProblemError::PenaltyKind {
                    group,
                    expected: expected.kind(),
                    found: found.kind(),
                });
            }
        }
        Ok(())
    }
}
