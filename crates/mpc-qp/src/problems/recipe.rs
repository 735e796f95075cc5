//! What a random problem consists of, and random choices of it.

use super::draw::Draw;
use crate::softening::{ConstraintGroup, Penalty, Softening};

/// The kind of terminal set to draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetKind {
    /// No terminal set.
    None,
    /// The reference's end point.
    Equality,
    /// Faces around the reference's end.
    Polytope,
    /// An ellipsoid around a point near the reference's end.
    Ellipsoid,
}

/// What a random problem consists of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    /// Number of stages.
    pub horizon: usize,
    /// Boxes on the inputs, some one-sided.
    pub input_bounds: bool,
    /// Rate limits, at stage 0 too.
    pub rate_limits: bool,
    /// Boxes on some of the states, some one-sided.
    pub state_bounds: bool,
    /// General rows at each stage.
    pub rows: usize,
    /// Cross weights S.
    pub cross_weights: bool,
    /// Terminal set.
    pub set: SetKind,
    /// Softened groups.
    pub softening: Softening,
    /// Weights within one matrix differ by up to 10 to this power; the whole cost is scaled by 10 to plus or minus its quarter.
    pub weight_decades: f64,
    /// Distance of constraints from the reference trajectory; a tenth of them are twenty times closer.
    pub margin: f64,
    /// The contradiction to plant, if any: rate limits, rows or the terminal set. Without this group the problem is
    /// feasible, so every proof of infeasibility involves it.
    pub contradiction: Option<ConstraintGroup>,
}

impl Recipe {
    /// A random recipe: every kind of constraint, horizon 1 to `longest`, feasible.
    #[must_use]
    pub fn feasible(seed: u64, longest: usize) -> Self {
        let draw = &mut Draw::new(seed ^ 0x5eed_0000_0000_0001);
        let set = match draw.integer(0, 4) {
            0 => SetKind::Equality,
            1 => SetKind::Polytope,
            2 | 3 => SetKind::Ellipsoid,
            _ => SetKind::None,
        };
        Self {
            horizon: draw.integer(1, longest.max(1)),
            input_bounds: draw.chance(0.7),
            rate_limits: draw.chance(0.5),
            state_bounds: draw.chance(0.5),
            rows: if draw.chance(0.4) {
                draw.integer(1, 4)
            } else {
                0
            },
            cross_weights: draw.chance(0.3),
            set,
            softening: Softening::default(),
            weight_decades: 0.0,
            margin: draw.power_of_ten(-1.0, 0.5),
            contradiction: None,
        }
    }

    /// As [`Self::feasible`], with one to three groups softened.
    #[must_use]
    pub fn softened(seed: u64, longest: usize) -> Self {
        let draw = &mut Draw::new(seed ^ 0x5eed_0000_0000_0002);
        let mut penalty = || {
            let weight = draw.power_of_ten(0.0, 3.0);
            match draw.integer(0, 2) {
                0 => Penalty::Hard,
                1 => Penalty::Exact { weight },
                _ => Penalty::Quadratic { weight },
            }
        };
        let softening = Softening {
            state_bounds: penalty(),
            rows: penalty(),
            terminal_set: penalty(),
        };
        Self {
            softening,
            state_bounds: true,
            ..Self::feasible(seed, longest)
        }
    }

    /// As [`Self::feasible`], with weights spread over 1e-6 to 1e6 and the whole cost scaled by 1e-3 to 1e3 on top.
    #[must_use]
    pub fn badly_scaled(seed: u64, longest: usize) -> Self {
        Self {
            weight_decades: 12.0,
            ..Self::feasible(seed, longest)
        }
    }

    /// As [`Self::feasible`], with one contradiction among its hard constraints.
    #[must_use]
    pub fn infeasible(seed: u64, longest: usize) -> Self {
        let contradiction = match seed % 4 {
            0 | 1 => ConstraintGroup::RateLimits,
            2 => ConstraintGroup::Rows,
            _ => ConstraintGroup::TerminalSet,
        };
        let mut recipe = Self {
            contradiction: Some(contradiction),
            ..Self::feasible(seed, longest)
        };
        match contradiction {
            ConstraintGroup::Rows => recipe.rows = recipe.rows.max(2),
            ConstraintGroup::TerminalSet => {
                recipe.input_bounds = true;
                recipe.set = if seed % 8 < 4 {
                    SetKind::Ellipsoid
                } else {
                    SetKind::Equality
                };
            }
            _ => {
                recipe.input_bounds = true;
                recipe.rate_limits = true;
            }
        }
        recipe
    }

    /// One of the four kinds above in turn.
    #[must_use]
    pub fn any(seed: u64, longest: usize) -> Self {
        match seed % 5 {
            0 | 1 => Self::feasible(seed / 5, longest),
            2 => Self::softened(seed / 5, longest),
            3 => Self::badly_scaled(seed / 5, longest),
            _ => Self::infeasible(seed / 5, longest),
        }
    }

    /// True if the problem has a feasible point by construction.
    #[must_use]
    pub fn is_feasible(&self) -> bool {
        self.contradiction.is_none()
    }
}
