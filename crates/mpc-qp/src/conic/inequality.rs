//! The scalar inequalities of the conic program by name, and their right-hand sides.

use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::terminal::TerminalSet;

/// Side of a bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Lower,
    Upper,
}

/// A scalar inequality by name; `i` is the component or row, `k` the stage (N for the end).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Inequality {
    Input { k: usize, i: usize, side: Side },
    Rate { k: usize, i: usize, side: Side },
    State { k: usize, i: usize, side: Side },
    Row { k: usize, i: usize },
    Face { i: usize },
}

impl Inequality {
    pub(super) fn group(self) -> ConstraintGroup {
        match self {
            Self::Input { .. } => ConstraintGroup::InputBounds,
            Self::Rate { .. } => ConstraintGroup::RateLimits,
            Self::State { .. } => ConstraintGroup::StateBounds,
            Self::Row { .. } => ConstraintGroup::Rows,
            Self::Face { .. } => ConstraintGroup::TerminalSet,
        }
    }

    /// Right-hand side as `left <= right`; `+inf` if absent.
    pub(super) fn right<const NX: usize, const NU: usize>(self, problem: &OcpQp<NX, NU>) -> f64 {
        let stages = problem.stages();
        match self {
            Self::Input {
                k,
                i,
                side: Side::Upper,
            } => stages[k].u_max[i],
            Self::Input {
                k,
                i,
                side: Side::Lower,
            } => -stages[k].u_min[i],
            Self::Rate { k, i, side } => {
                let given = if k == 0 {
                    problem.previous_input()[i]
                } else {
                    0.0
                };
                match side {
                    Side::Upper => stages[k].du_max[i] + given,
                    Side::Lower => -stages[k].du_min[i] - given,
                }
            }
            Self::State { k, i, side } => {
                let (lower, upper) = match stages.get(k) {
                    Some(stage) => (&stage.x_min, &stage.x_max),
                    None => (&problem.terminal().x_min, &problem.terminal().x_max),
                };
                match side {
                    Side::Upper => upper[i],
                    Side::Lower => -lower[i],
                }
            }
            Self::Row { k, i } => {
                let row = &stages[k].rows[i];
                if k == 0 {
                    row.upper - row.g_x.dot(problem.initial_state())
                } else {
                    row.upper
                }
            }
            Self::Face { i } => match &problem.terminal().set {
                TerminalSet::Polytope { faces } => faces[i].upper,
                _ => f64::INFINITY,
            },
        }
    }
}

/// Every inequality that the structure of `problem` can have, in one fixed order.
pub(super) fn candidates<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
) -> impl Iterator<Item = Inequality> {
    const SIDES: [Side; 2] = [Side::Lower, Side::Upper];
    let n = problem.horizon();
    let of_inputs = (0..n).flat_map(|k| {
        (0..NU).flat_map(move |i| {
            SIDES.into_iter().flat_map(move |side| {
                [
                    Inequality::Input { k, i, side },
                    Inequality::Rate { k, i, side },
                ]
            })
        })
    });
    let of_states = (1..=n).flat_map(|k| {
        (0..NX).flat_map(move |i| {
            SIDES
                .into_iter()
                .map(move |side| Inequality::State { k, i, side })
        })
    });
    let of_rows = (0..n)
        .flat_map(|k| (0..problem.stages()[k].rows.len()).map(move |i| Inequality::Row { k, i }));
    let faces = match &problem.terminal().set {
        TerminalSet::Polytope { faces } => faces.len(),
        _ => 0,
    };
    of_inputs
        .chain(of_states)
        .chain(of_rows)
        .chain((0..faces).map(|i| Inequality::Face { i }))
}
