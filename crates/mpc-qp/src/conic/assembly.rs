//! Emits the conic program entry by entry, once to learn the pattern and afterwards to refill the values.
//!
//! One walk serves both, so indices and values cannot get out of step. A row whose bound has become infinite since the
//! pattern was made reads `0 z + s = 1`: true for every z, with a multiplier that goes to zero.

use super::inequality::{Inequality, Side};
use super::layout::Layout;
use super::target::Target;
use crate::problem::OcpQp;
use crate::softening::Penalty;
use crate::terminal::TerminalSet;

/// The power of two that brings the largest cost entry to between 1 and 2, or 1 for a zero cost.
///
/// Clarabel scales the cost as well, but at most by 1e4, and keeps the scaling of its first problem. A power of two changes
/// no mantissa.
pub(super) fn cost_scale<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> f64 {
    let terminal = problem.terminal();
    let mut largest = terminal.p.amax().max(terminal.p_linear.amax());
    for stage in problem.stages() {
        let quadratic = stage.q.amax().max(stage.r.amax());
        largest = largest
            .max(quadratic)
            .max(stage.q_linear.amax())
            .max(stage.r_linear.amax());
    }
    if largest > f64::MIN_POSITIVE {
        (-largest.log2().floor()).exp2()
    } else {
        1.0
    }
}

pub(super) fn assemble<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    target: &mut impl Target,
) {
    for k in 0..problem.horizon() {
        stage_cost(problem, layout, k, target);
        dynamics(problem, layout, k, target);
    }
    terminal_cost(problem, layout, target);
    slack_prices(problem, layout, target);
    terminal_equality(problem, layout, target);
    scalars(problem, layout, target);
    cone(problem, layout, target);
}

fn stage_cost<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    k: usize,
    target: &mut impl Target,
) {
    let (stage, masks, u) = (&problem.stages()[k], &layout.masks, layout.input(k));
    for j in 0..NU {
        for i in 0..=j {
            if masks.r[(i, j)] || masks.r[(j, i)] {
                target.cost(u + i, u + j, stage.r[(i, j)]);
            }
        }
    }
    if k == 0 {
        // x_0 is a number: its cross cost is linear in u_0.
        let linear = stage.r_linear + stage.s.tr_mul(problem.initial_state());
        (0..NU).for_each(|j| target.linear(u + j, linear[j]));
        return;
    }
    let x = layout.state(k);
    for j in 0..NX {
        for i in 0..=j {
            if masks.q[(i, j)] || masks.q[(j, i)] {
                target.cost(x + i, x + j, stage.q[(i, j)]);
            }
        }
    }
    for j in 0..NU {
        for i in (0..NX).filter(|&i| masks.s[(i, j)]) {
            target.cost(x + i, u + j, stage.s[(i, j)]);
        }
    }
    (0..NU).for_each(|j| target.linear(u + j, stage.r_linear[j]));
    (0..NX).for_each(|i| target.linear(x + i, stage.q_linear[i]));
}

/// `x_{k+1} - A x_k - B u_k = c`.
fn dynamics<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    k: usize,
    target: &mut impl Target,
) {
    let (stage, masks, row) = (&problem.stages()[k], &layout.masks, k * NX);
    let mut right = stage.c;
    if k == 0 {
        right += stage.a * problem.initial_state();
    }
    for i in 0..NX {
        target.constraint(row + i, layout.state(k + 1) + i, 1.0);
        for j in (0..NU).filter(|&j| masks.b[(i, j)]) {
            target.constraint(row + i, layout.input(k) + j, -stage.b[(i, j)]);
        }
        if k > 0 {
            for j in (0..NX).filter(|&j| masks.a[(i, j)]) {
                target.constraint(row + i, layout.state(k) + j, -stage.a[(i, j)]);
            }
        }
        target.right(row + i, right[i]);
    }
}

fn terminal_cost<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    target: &mut impl Target,
) {
    let (terminal, x) = (problem.terminal(), layout.state(problem.horizon()));
    for j in 0..NX {
        for i in 0..=j {
            if layout.masks.p[(i, j)] || layout.masks.p[(j, i)] {
                target.cost(x + i, x + j, terminal.p[(i, j)]);
            }
        }
        target.linear(x + j, terminal.p_linear[j]);
    }
}

/// Each scalar row's slack has its own group's weight; the terminal set's slacks come last.
fn slack_prices<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    target: &mut impl Target,
) {
    let mut price = |column: usize, penalty: Penalty| match penalty {
        Penalty::Hard => {}
        Penalty::Exact { weight } => target.linear(column, weight),
        Penalty::Quadratic { weight } => target.cost(column, column, weight),
    };
    for scalar in &layout.scalars {
        if let Some(column) = scalar.slack {
            price(column, problem.softening().of(scalar.inequality.group()));
        }
    }
    if let Some(first) = layout.set_slack {
        (first..layout.columns())
            .for_each(|column| price(column, problem.softening().terminal_set));
    }
}

/// `x_N = target`, or with the violation as slacks on the left.
fn terminal_equality<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    target: &mut impl Target,
) {
    let TerminalSet::Equality { target: point } = &problem.terminal().set else {
        return;
    };
    let (row, x) = (layout.terminal_equality(), layout.state(problem.horizon()));
    let both_signs = matches!(problem.softening().terminal_set, Penalty::Exact { .. });
    for i in 0..NX {
        target.constraint(row + i, x + i, 1.0);
        if let Some(slack) = layout.set_slack {
            target.constraint(row + i, slack + i, -1.0);
            if both_signs {
                target.constraint(row + i, slack + NX + i, 1.0);
            }
        }
        target.right(row + i, point[i]);
    }
}

/// The nonnegative cone: `left - slack <= right`, then `-slack <= 0` for the L1 slacks.
fn scalars<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    target: &mut impl Target,
) {
    let mut row = layout.equalities();
    for scalar in &layout.scalars {
        let right = scalar.inequality.right(problem);
        let present = right < f64::INFINITY;
        coefficients(problem, layout, scalar.inequality, |column, value| {
            target.constraint(row, column, if present { value } else { 0.0 });
        });
        if let Some(column) = scalar.slack {
            target.constraint(row, column, if present { -1.0 } else { 0.0 });
        }
        target.right(row, if present { right } else { 1.0 });
        row += 1;
    }
    for &column in &layout.priced {
        target.constraint(row, column, -1.0);
        target.right(row, 0.0);
        row += 1;
    }
}

fn coefficients<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    inequality: Inequality,
    mut emit: impl FnMut(usize, f64),
) {
    let sign = |side| if side == Side::Upper { 1.0 } else { -1.0 };
    match inequality {
        Inequality::Input { k, i, side } => emit(layout.input(k) + i, sign(side)),
        Inequality::Rate { k, i, side } => {
            emit(layout.input(k) + i, sign(side));
            if k > 0 {
                emit(layout.input(k - 1) + i, -sign(side));
            }
        }
        Inequality::State { k, i, side } => emit(layout.state(k) + i, sign(side)),
        Inequality::Row { k, i } => {
            let row = &problem.stages()[k].rows[i];
            (0..NU).for_each(|j| emit(layout.input(k) + j, row.h_u[j]));
            if k > 0 {
                (0..NX).for_each(|j| emit(layout.state(k) + j, row.g_x[j]));
            }
        }
        Inequality::Face { i } => {
            if let TerminalSet::Polytope { faces } = &problem.terminal().set {
                let x = layout.state(problem.horizon());
                (0..NX).for_each(|j| emit(x + j, faces[i].normal[j]));
            }
        }
    }
}

/// `s = (radius + slack, L'(x_N - center))` in the second-order cone.
fn cone<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    target: &mut impl Target,
) {
    let Some(cone) = problem.terminal_cone() else {
        return;
    };
    let (row, x) = (layout.cone(), layout.state(problem.horizon()));
    if let Some(slack) = layout.set_slack {
        target.constraint(row, slack, -1.0);
    }
    target.right(row, cone.radius);
    let of_center = cone.factor.tr_mul(cone.center);
    for i in 0..NX {
        for j in i..NX {
            target.constraint(row + 1 + i, x + j, -cone.factor[(j, i)]);
        }
        target.right(row + 1 + i, -of_center[i]);
    }
}
