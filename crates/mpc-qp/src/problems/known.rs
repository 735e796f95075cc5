//! Problems whose solution is known in closed form.

mod softened;

pub use softened::{soft_bound_out_of_reach, soft_disc_out_of_reach};

use crate::error::ProblemError;
use crate::problem::OcpQp;
use crate::stage::{Row, Stage};
use crate::terminal::{Terminal, TerminalSet};
use nalgebra::{Matrix1, Matrix2, SVector, Vector1, Vector2};

/// A problem with its exact inputs and cost.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownProblem<const NX: usize, const NU: usize> {
    /// The problem.
    pub problem: OcpQp<NX, NU>,
    /// The optimal inputs.
    pub u: Vec<SVector<f64, NU>>,
    /// The optimal cost.
    pub objective: f64,
}

impl<const NX: usize, const NU: usize> KnownProblem<NX, NU> {
    /// The cost follows from the inputs unless slacks are active.
    fn from_inputs(problem: OcpQp<NX, NU>, u: Vec<SVector<f64, NU>>) -> Self {
        let mut x = Vec::new();
        problem.rollout(&u, &mut x);
        let objective = problem.objective(&x, &u, &crate::multipliers::Slacks::zeros(&problem));
        Self {
            problem,
            u,
            objective,
        }
    }
}

/// One scalar step `x_1 = x_0 + u`, cost `q/2 x_1^2 + r/2 u^2`, `|u| <= limit`: `u = clamp(-q x_0 / (q + r))`.
///
/// # Errors
/// [`ProblemError`] for weights or a limit out of range.
pub fn one_scalar_step(
    x_0: f64,
    q: f64,
    r: f64,
    limit: f64,
) -> Result<KnownProblem<1, 1>, ProblemError> {
    let mut stage = Stage::new(Matrix1::new(1.0), Matrix1::new(1.0));
    stage.r[0] = r;
    (stage.u_min[0], stage.u_max[0]) = (-limit, limit);
    let problem = OcpQp::new(
        Vector1::new(x_0),
        vec![stage],
        Terminal::new(Matrix1::new(q)),
    )?;
    Ok(KnownProblem::from_inputs(
        problem,
        vec![Vector1::new((-q * x_0 / (q + r)).clamp(-limit, limit))],
    ))
}

/// A double integrator (dt = 0.1, |u| <= 1) so far away that full thrust is optimal at every stage: with terminal cost
/// `position^2 / 2` the gradient with respect to u_k, `p_N dt^2 (N - k - 1/2) + r u_k`, stays positive as long as
/// `p_N > 2 r / dt^2 = 0.2`, which the start at 100 guarantees up to 140 stages.
///
/// # Errors
/// [`ProblemError::EmptyHorizon`].
pub fn saturated_double_integrator(horizon: usize) -> Result<KnownProblem<2, 1>, ProblemError> {
    let mut stage = double_integrator();
    stage.r[0] = 1e-3;
    (stage.u_min[0], stage.u_max[0]) = (-1.0, 1.0);
    let terminal = Terminal::new(Matrix2::new(1.0, 0.0, 0.0, 0.0));
    let problem = OcpQp::new(Vector2::new(100.0, 0.0), vec![stage; horizon], terminal)?;
    Ok(KnownProblem::from_inputs(
        problem,
        vec![Vector1::new(-1.0); horizon],
    ))
}

/// A double integrator from rest at 0 to rest at 1 with least `sum u^2 / 2`: the inputs are linear in time,
/// `u_k = 6 (N - 1 - 2k) / (dt^2 N (N^2 - 1))`, from the two moment conditions `sum u_k = 0` and
/// `dt^2 sum (N - k - 1/2) u_k = 1`. Needs N >= 2.
///
/// # Errors
/// [`ProblemError::EmptyHorizon`].
pub fn least_effort_double_integrator(horizon: usize) -> Result<KnownProblem<2, 1>, ProblemError> {
    let mut stage = double_integrator();
    stage.r[0] = 1.0;
    let mut terminal = Terminal::new(Matrix2::zeros());
    terminal.set = TerminalSet::Equality {
        target: Vector2::new(1.0, 0.0),
    };
    let problem = OcpQp::new(Vector2::zeros(), vec![stage; horizon], terminal)?;
    let n = horizon as f64;
    let u = (0..horizon)
        .map(|k| Vector1::new(6.0 * (n - 1.0 - 2.0 * k as f64) / (0.01 * n * (n * n - 1.0))));
    Ok(KnownProblem::from_inputs(problem, u.collect()))
}

fn double_integrator() -> Stage<2, 1> {
    Stage::new(Matrix2::new(1.0, 0.1, 0.0, 1.0), Vector2::new(0.005, 0.1))
}

/// Two integrators `x_{k+1} = x_k + dt u_k`, dt = 0.1 s (depth and roll of a straight needle) with Q = 10 I, R = I and P from the
/// Riccati equation, unconstrained. The equation is scalar, `dt^2 P^2 - q dt^2 P - q r = 0` with root P = 37.0156, and
/// `u = -K x`, K = P dt / (r + P dt^2) = 2.70156, at every stage.
///
/// # Errors
/// [`ProblemError`] for an empty horizon or a start that is not finite.
pub fn integrators_at_their_gain(
    x_0: Vector2<f64>,
    horizon: usize,
) -> Result<KnownProblem<2, 2>, ProblemError> {
    let (dt, q, r) = (0.1_f64, 10.0, 1.0);
    let p = (q * dt + (q * q * dt * dt + 4.0 * q * r).sqrt()) / (2.0 * dt);
    let gain = p * dt / (r + p * dt * dt);
    let mut stage = Stage::new(Matrix2::identity(), Matrix2::identity() * dt);
    (stage.q, stage.r) = (Matrix2::identity() * q, Matrix2::identity() * r);
    let problem = OcpQp::new(
        x_0,
        vec![stage; horizon],
        Terminal::new(Matrix2::identity() * p),
    )?;
    let mut x = x_0;
    let mut u = Vec::new();
    for _ in 0..horizon {
        u.push(x * -gain);
        x *= 1.0 - gain * dt;
    }
    Ok(KnownProblem {
        problem,
        u,
        objective: 0.5 * p * x_0.norm_squared(),
    })
}

/// Projection onto a disc: `x_1 = u`, cost `|u - wish|^2 / 2` (its constant dropped), `|x_1 - center| <= radius`.
/// The solution is the wish itself or the nearest boundary point; a wish on the boundary has a zero multiplier.
///
/// # Errors
/// [`ProblemError::EllipsoidLevel`] for a radius that is not positive and finite.
pub fn projection_onto_disc(
    wish: Vector2<f64>,
    center: Vector2<f64>,
    radius: f64,
) -> Result<KnownProblem<2, 2>, ProblemError> {
    let mut stage = Stage::new(Matrix2::zeros(), Matrix2::identity());
    (stage.r, stage.r_linear) = (Matrix2::identity(), -wish);
    let mut terminal = Terminal::new(Matrix2::zeros());
    terminal.set = TerminalSet::Ellipsoid {
        shape: Matrix2::identity(),
        center,
        level: radius * radius,
    };
    let problem = OcpQp::new(Vector2::zeros(), vec![stage], terminal)?;
    let offset = wish - center;
    let shrink = (radius / offset.norm()).min(1.0);
    Ok(KnownProblem::from_inputs(
        problem,
        vec![center + offset * shrink],
    ))
}

/// Projection onto an ellipse with half-axes `radius` and `radius / sqrt(condition)`, of a wish at distance 4 on one of its
/// axes: `x_1 = u`, cost `|u - wish|^2 / 2` (constant dropped). It is projected to the end of that axis, from which the ellipse
/// recedes on both sides.
///
/// # Errors
/// [`ProblemError::EllipsoidLevel`] for a radius that is not positive and finite.
pub fn projection_along_an_axis(
    axis: usize,
    condition: f64,
    radius: f64,
) -> Result<KnownProblem<2, 2>, ProblemError> {
    let mut wish = Vector2::zeros();
    wish[axis] = 4.0;
    let mut stage = Stage::new(Matrix2::zeros(), Matrix2::identity());
    (stage.r, stage.r_linear) = (Matrix2::identity(), -wish);
    let mut terminal = Terminal::new(Matrix2::zeros());
    terminal.set = TerminalSet::Ellipsoid {
        shape: Matrix2::new(1.0, 0.0, 0.0, condition),
        center: Vector2::zeros(),
        level: radius * radius,
    };
    let problem = OcpQp::new(Vector2::zeros(), vec![stage], terminal)?;
    let reach = if axis == 0 {
        radius
    } else {
        radius / condition.sqrt()
    };
    Ok(KnownProblem::from_inputs(
        problem,
        vec![wish * (reach / 4.0)],
    ))
}

/// `x_{k+1} = x_k + u_k` pulled outward with force 1000: every input grows by the allowed 0.1, `u_k = 0.1 (k + 1)`, as long as
/// `1e-3 u_k` stays below the force.
///
/// # Errors
/// [`ProblemError::EmptyHorizon`].
pub fn rate_limited_ramp(horizon: usize) -> Result<KnownProblem<1, 1>, ProblemError> {
    let mut stage = Stage::new(Matrix1::new(1.0), Matrix1::new(1.0));
    (stage.r[0], stage.du_max[0]) = (1e-3, 0.1);
    let mut terminal = Terminal::new(Matrix1::zeros());
    terminal.p_linear[0] = -1000.0;
    let problem = OcpQp::new(Vector1::zeros(), vec![stage; horizon], terminal)?;
    let u = (1..=horizon).map(|k| Vector1::new(0.1 * k as f64));
    Ok(KnownProblem::from_inputs(problem, u.collect()))
}

/// `x_0` on the boundary of the unit disc that is also the terminal set, and a cost that pulls outward: staying is optimal.
///
/// # Errors
/// [`ProblemError::EmptyHorizon`].
pub fn start_on_terminal_boundary(horizon: usize) -> Result<KnownProblem<2, 2>, ProblemError> {
    let mut stage = Stage::new(Matrix2::identity(), Matrix2::identity() * 0.1);
    stage.r = Matrix2::identity();
    let mut terminal = Terminal::new(Matrix2::zeros());
    terminal.p_linear = Vector2::new(-1.0, 0.0);
    terminal.set = TerminalSet::Ellipsoid {
        shape: Matrix2::identity(),
        center: Vector2::zeros(),
        level: 1.0,
    };
    let problem = OcpQp::new(Vector2::new(1.0, 0.0), vec![stage; horizon], terminal)?;
    Ok(KnownProblem::from_inputs(
        problem,
        vec![Vector2::zeros(); horizon],
    ))
}

/// `x_1 = u`, cost `(u - 2)^2 / 2` (constant dropped), the row `u <= 1` given three times and once scaled by 10: u = 1.
///
/// # Errors
/// None for these data.
pub fn redundant_rows() -> Result<KnownProblem<1, 1>, ProblemError> {
    let mut stage = Stage::new(Matrix1::zeros(), Matrix1::new(1.0));
    (stage.r[0], stage.r_linear[0]) = (1.0, -2.0);
    let row = Row {
        g_x: Vector1::zeros(),
        h_u: Vector1::new(1.0),
        upper: 1.0,
    };
    let scaled = Row {
        h_u: row.h_u * 10.0,
        upper: 10.0,
        ..row
    };
    stage.rows = vec![row, row, row, scaled];
    let problem = OcpQp::new(
        Vector1::zeros(),
        vec![stage],
        Terminal::new(Matrix1::zeros()),
    )?;
    Ok(KnownProblem::from_inputs(problem, vec![Vector1::new(1.0)]))
}

/// `u <= 2` where the unconstrained optimum is u = 2: active with multiplier zero.
///
/// # Errors
/// None for these data.
pub fn weakly_active_bound() -> Result<KnownProblem<1, 1>, ProblemError> {
    let mut stage = Stage::new(Matrix1::zeros(), Matrix1::new(1.0));
    (stage.r[0], stage.r_linear[0], stage.u_max[0]) = (1.0, -2.0, 2.0);
    let problem = OcpQp::new(
        Vector1::zeros(),
        vec![stage],
        Terminal::new(Matrix1::zeros()),
    )?;
    Ok(KnownProblem::from_inputs(problem, vec![Vector1::new(2.0)]))
}
