//! Random problems, feasible or infeasible by construction.
//!
//! A reference trajectory is drawn first and every constraint is placed around it at a positive distance, so the problem has a
//! strictly feasible point whatever the cost. (Touching constraints with a terminal equality can leave one single feasible
//! point: rounding then decides, and no solver can be blamed for either answer.) An infeasible one then gets one contradiction that can be read off the data, with its group.

pub use super::recipe::{Recipe, SetKind};

use super::draw::Draw;
use crate::error::ProblemError;
use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::stage::{Row, Stage};
use crate::terminal::{HalfSpace, Terminal, TerminalSet};
use nalgebra::{SMatrix, SVector};

/// The problem that `recipe` and `seed` make.
///
/// # Errors
/// [`ProblemError::EmptyHorizon`] for a recipe without stages, or a refused softening; the data drawn are always valid.
pub fn problem<const NX: usize, const NU: usize>(
    seed: u64,
    recipe: &Recipe,
) -> Result<OcpQp<NX, NU>, ProblemError> {
    let mut draw = Draw::new(seed);
    let mut stages = dynamics(&mut draw, recipe);
    let mut reference = Reference::draw(&mut draw, &stages);
    let whole = draw.power_of_ten(-recipe.weight_decades / 4.0, recipe.weight_decades / 4.0);
    for (k, stage) in stages.iter_mut().enumerate() {
        weights(&mut draw, recipe, whole, stage);
        constraints(&mut draw, recipe, &reference, k, stage);
    }
    let mut terminal = terminal(&mut draw, recipe, reference.x[recipe.horizon]);
    terminal.p *= whole;
    if let Some(group) = recipe.contradiction {
        contradict(&mut draw, group, &mut reference, &mut stages, &mut terminal);
    }
    let mut problem =
        OcpQp::new(reference.x[0], stages, terminal)?.with_softening(recipe.softening)?;
    problem.set_previous_input(&reference.previous_input)?;
    Ok(problem)
}

/// A feasible trajectory.
struct Reference<const NX: usize, const NU: usize> {
    x: Vec<SVector<f64, NX>>,
    u: Vec<SVector<f64, NU>>,
    previous_input: SVector<f64, NU>,
}

impl<const NX: usize, const NU: usize> Reference<NX, NU> {
    fn draw(draw: &mut Draw, stages: &[Stage<NX, NU>]) -> Self {
        let mut x: Vec<SVector<f64, NX>> = vec![draw.matrix()];
        let previous_input: SVector<f64, NU> = draw.matrix();
        let mut u = Vec::new();
        let mut input = previous_input;
        for (k, stage) in stages.iter().enumerate() {
            let fresh: SVector<f64, NU> = draw.matrix();
            input = input * 0.8 + fresh * 0.4;
            u.push(input);
            x.push(stage.successor(&x[k], &input));
        }
        Self {
            x,
            u,
            previous_input,
        }
    }
}

/// Dynamics near a common pair, spectral radius 0.5 to 1.05 up to the variation: states grow at most by some 20 in 60 stages.
fn dynamics<const NX: usize, const NU: usize>(
    draw: &mut Draw,
    recipe: &Recipe,
) -> Vec<Stage<NX, NU>> {
    let raw: SMatrix<f64, NX, NX> = draw.matrix();
    let a = raw * (draw.uniform(0.5, 1.05) / spectral_radius(&raw).max(1e-3));
    let b: SMatrix<f64, NX, NU> = draw.matrix();
    let variation = 0.02 / NX as f64;
    (0..recipe.horizon)
        .map(|_| {
            let change: SMatrix<f64, NX, NX> = draw.matrix();
            let mut stage = Stage::new(a + change * variation, b + draw.matrix::<NX, NU>() * 0.05);
            stage.c = draw.matrix::<NX, 1>() * 0.1;
            stage
        })
        .collect()
}

/// `|A^64|^(1/64)`, within a few per cent of the spectral radius for the sizes drawn here.
fn spectral_radius<const NX: usize>(a: &SMatrix<f64, NX, NX>) -> f64 {
    let (mut power, mut logarithm) = (*a, 0.0);
    for squarings in 0..6 {
        let norm = power.norm().max(1e-300);
        logarithm += norm.ln() / f64::from(1 << squarings);
        power /= norm;
        power *= power;
    }
    (logarithm + power.norm().max(1e-300).ln() / 64.0).exp()
}

/// Joint weight `[Lx Lu]'[Lx Lu]` plus a little on the inputs; Lx may be rank deficient.
fn weights<const NX: usize, const NU: usize>(
    draw: &mut Draw,
    recipe: &Recipe,
    whole: f64,
    stage: &mut Stage<NX, NU>,
) {
    let half_spread = recipe.weight_decades / 4.0;
    let mut scaling = || draw.power_of_ten(-half_spread, half_spread);
    let of_states = SVector::<f64, NX>::from_fn(|_, _| scaling());
    let of_inputs = SVector::<f64, NU>::from_fn(|_, _| scaling());
    let mut l_x: SMatrix<f64, NX, NX> = draw.matrix();
    if draw.chance(0.3) {
        l_x.row_mut(0).fill(0.0);
    }
    for (mut column, scale) in l_x.column_iter_mut().zip(of_states.iter()) {
        column *= *scale;
    }
    let little = draw.power_of_ten(-2.0, 0.0);
    let squares = of_inputs.component_mul(&of_inputs);
    stage.q = l_x.tr_mul(&l_x) * whole;
    stage.r = SMatrix::from_diagonal(&squares) * (little * whole);
    if recipe.cross_weights {
        let mut l_u: SMatrix<f64, NX, NU> = draw.matrix::<NX, NU>() * 0.3;
        for (mut column, scale) in l_u.column_iter_mut().zip(of_inputs.iter()) {
            column *= *scale;
        }
        stage.r += l_u.tr_mul(&l_u) * whole;
        stage.s = l_x.tr_mul(&l_u) * whole;
    }
    stage.q_linear = draw.matrix::<NX, 1>().component_mul(&of_states) * whole;
    stage.r_linear = draw.matrix::<NU, 1>().component_mul(&of_inputs) * (little.sqrt() * whole);
}

/// Bounds of one component around a feasible value.
fn interval(draw: &mut Draw, value: f64, margin: f64) -> (f64, f64) {
    let mut distance = || match draw.integer(0, 9) {
        0 => 0.05 * margin,
        1 => f64::INFINITY,
        _ => margin * draw.uniform(0.1, 1.0),
    };
    let (below, above) = (distance(), distance());
    (value - below, value + above)
}

fn constraints<const NX: usize, const NU: usize>(
    draw: &mut Draw,
    recipe: &Recipe,
    reference: &Reference<NX, NU>,
    k: usize,
    stage: &mut Stage<NX, NU>,
) {
    let (x, u) = (reference.x[k], reference.u[k]);
    let before = if k == 0 {
        reference.previous_input
    } else {
        reference.u[k - 1]
    };
    if recipe.input_bounds {
        for i in 0..NU {
            (stage.u_min[i], stage.u_max[i]) = interval(draw, u[i], recipe.margin);
        }
    }
    if recipe.rate_limits {
        for i in 0..NU {
            (stage.du_min[i], stage.du_max[i]) = interval(draw, u[i] - before[i], recipe.margin);
        }
    }
    if recipe.state_bounds {
        for i in (0..NX).step_by(2) {
            (stage.x_min[i], stage.x_max[i]) = interval(draw, x[i], 2.0 * recipe.margin);
        }
    }
    for _ in 0..recipe.rows {
        let (g_x, h_u): (SVector<f64, NX>, SVector<f64, NU>) = (draw.matrix(), draw.matrix());
        let (_, upper) = interval(draw, g_x.dot(&x) + h_u.dot(&u), 2.0 * recipe.margin);
        stage.rows.push(Row { g_x, h_u, upper });
    }
}

fn terminal<const NX: usize>(
    draw: &mut Draw,
    recipe: &Recipe,
    end: SVector<f64, NX>,
) -> Terminal<NX> {
    let decades = if recipe.weight_decades > 0.0 {
        4.0
    } else {
        0.5
    };
    let eigenvalues = SVector::from_fn(|_, _| draw.power_of_ten(-decades, decades));
    let mut terminal = Terminal::new(draw.with_spectrum(&eigenvalues));
    terminal.p_linear = draw.matrix::<NX, 1>() * 0.1;
    if recipe.state_bounds {
        for i in (0..NX).step_by(2) {
            (terminal.x_min[i], terminal.x_max[i]) = interval(draw, end[i], 2.0 * recipe.margin);
        }
    }
    terminal.set = match recipe.set {
        SetKind::None => TerminalSet::None,
        SetKind::Equality => TerminalSet::Equality { target: end },
        SetKind::Polytope => {
            let faces = (0..2 * NX).map(|_| {
                let normal: SVector<f64, NX> = draw.matrix();
                HalfSpace {
                    normal,
                    upper: normal.dot(&end) + recipe.margin * draw.uniform(0.05, 1.0),
                }
            });
            TerminalSet::Polytope {
                faces: faces.collect(),
            }
        }
        SetKind::Ellipsoid => {
            let shape = terminal.p;
            let offset = draw.matrix::<NX, 1>() * (0.3 * recipe.margin);
            let value = offset.dot(&(shape * offset));
            let level = value * draw.uniform(1.0, 4.0) + 1e-4 * recipe.margin * recipe.margin;
            TerminalSet::Ellipsoid {
                shape,
                center: end - offset,
                level,
            }
        }
    };
    terminal
}

/// Plants one contradiction whose gap is at least 1.
fn contradict<const NX: usize, const NU: usize>(
    draw: &mut Draw,
    group: ConstraintGroup,
    reference: &mut Reference<NX, NU>,
    stages: &mut [Stage<NX, NU>],
    terminal: &mut Terminal<NX>,
) {
    let k = draw.integer(0, stages.len() - 1);
    match group {
        // The input must fall by more than its rate allows.
        ConstraintGroup::RateLimits | ConstraintGroup::InputBounds => {
            let before = &mut reference.previous_input[0];
            let first = &mut stages[0];
            (first.u_min[0], first.u_max[0]) = (reference.u[0][0] - 1.0, reference.u[0][0] + 1.0);
            (first.du_min[0], first.du_max[0]) = (-0.5, 0.5);
            *before = first.u_max[0] + 1.5 + draw.uniform(0.0, 1.0);
        }
        ConstraintGroup::Rows | ConstraintGroup::StateBounds => {
            let row = stages[k].rows[0];
            let upper = -row.upper.clamp(-1e3, 1e3) - 1.0;
            stages[k].rows[0].upper = row.upper.clamp(-1e3, 1e3);
            stages[k].rows[1] = Row {
                g_x: -row.g_x,
                h_u: -row.h_u,
                upper,
            };
        }
        // Farther than bounded inputs can reach.
        ConstraintGroup::TerminalSet => {
            // Sum of |A_{N-1} ... A_{k+1} B_k| for inputs within 1 of the reference.
            let mut reach = 1.0;
            let mut onward = SMatrix::<f64, NX, NX>::identity();
            for (stage, u) in stages.iter_mut().zip(&reference.u).rev() {
                for i in 0..NU {
                    stage.u_min[i] = stage.u_min[i].max(u[i] - 1.0);
                    stage.u_max[i] = stage.u_max[i].min(u[i] + 1.0);
                }
                reach += (onward * stage.b).norm() * (NU as f64).sqrt();
                onward *= stage.a;
            }
            match &mut terminal.set {
                TerminalSet::Equality { target } => target[0] += 2.0 * reach,
                TerminalSet::Ellipsoid {
                    shape,
                    center,
                    level,
                } => {
                    *shape = SMatrix::identity();
                    *level = 1.0;
                    center[0] += 2.0 * reach + 2.0;
                }
                _ => {}
            }
        }
    }
}
