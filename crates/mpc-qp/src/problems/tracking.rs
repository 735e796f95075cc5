//! The benchmark: six states, two inputs with rate limits, tracking of a helix by a unicycle in space.
//!
//! The tip of a steered needle is such a unicycle, as is a fixed-wing aircraft. It moves along its axis at `v = 10 mm/s`, turns about it at `omega = 1 rad/s` and bends with curvature 1/150 per mm. The
//! left-invariant error (mm, rad) obeys `e_{k+1} = A e_k + B (u_k - u_r)`, `A = exp(-ad_V dt)`,
//! `B = integral of exp(-ad_V s) ds [V1 V2]` over dt = 0.1 s. Limits: v in [0, 20] mm/s, |omega| <= 12.7 rad/s, steps of at
//! most 3 mm/s and 0.5 rad/s. Q = diag(1, 1, 1, 10, 10, 1), R = 0.1 I.

use super::draw::Draw;
use crate::error::ProblemError;
use crate::problem::OcpQp;
use crate::stage::Stage;
use crate::terminal::{Terminal, TerminalSet};
use nalgebra::{Matrix2, Matrix6, Matrix6x2, Vector2, Vector6};

const STEP_S: f64 = 0.1;
const SPEED_MM_S: f64 = 10.0;
const SPIN_RAD_S: f64 = 1.0;
const CURVATURE_PER_MM: f64 = 1.0 / 150.0;

/// The model, its weight at the end of the horizon, and a stage that every problem of the family shares.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracking {
    /// Dynamics, running cost and limits, in deviations from the reference input.
    pub stage: Stage<6, 2>,
    /// Cost-to-go of 400 unconstrained stages.
    pub p: Matrix6<f64>,
    gain: nalgebra::Matrix2x6<f64>,
}

impl Default for Tracking {
    fn default() -> Self {
        let (a, b) = discretised();
        let mut stage = Stage::new(a, b);
        stage.q = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 10.0, 10.0, 1.0));
        stage.r = Matrix2::identity() * 0.1;
        stage.u_min = Vector2::new(-SPEED_MM_S, -12.7 - SPIN_RAD_S);
        stage.u_max = Vector2::new(20.0 - SPEED_MM_S, 12.7 - SPIN_RAD_S);
        stage.du_max = Vector2::new(3.0, 0.5);
        stage.du_min = -stage.du_max;
        let mut p = stage.q;
        let mut gain = nalgebra::Matrix2x6::zeros();
        for _ in 0..400 {
            let weight = stage.r + b.tr_mul(&p) * b;
            gain = weight.try_inverse().unwrap_or_default() * b.tr_mul(&p) * a;
            p = stage.q + a.tr_mul(&p) * (a - b * gain);
            p = (p + p.transpose()) * 0.5;
        }
        Self { stage, p, gain }
    }
}

impl Tracking {
    /// A random start: errors of about a millimetre and a tenth of a radian.
    #[must_use]
    pub fn start(seed: u64) -> Vector6<f64> {
        let mut draw = Draw::new(seed);
        let size = Vector6::new(1.0, 1.0, 1.0, 0.1, 0.1, 0.3);
        Vector6::from_fn(|i, _| size[i] * draw.uniform(-1.0, 1.0))
    }

    /// The problem from `start`; with `cone` the terminal set is the sublevel set of the terminal cost that the clipped
    /// linear feedback just reaches, so the problem is feasible whatever the horizon.
    ///
    /// # Errors
    /// [`ProblemError::EmptyHorizon`], or a start that is not finite.
    pub fn problem(
        &self,
        start: Vector6<f64>,
        horizon: usize,
        cone: bool,
    ) -> Result<OcpQp<6, 2>, ProblemError> {
        let mut terminal = Terminal::new(self.p);
        if cone {
            let end = self.clipped_feedback(start, horizon);
            let level = (end.dot(&(self.p * end)) * 1.02).max(1e-3);
            terminal.set = TerminalSet::Ellipsoid {
                shape: self.p,
                center: Vector6::zeros(),
                level,
            };
        }
        OcpQp::new(start, vec![self.stage.clone(); horizon], terminal)
    }

    fn clipped_feedback(&self, start: Vector6<f64>, horizon: usize) -> Vector6<f64> {
        let (mut x, mut before) = (start, Vector2::zeros());
        for _ in 0..horizon {
            let wish: Vector2<f64> = -(self.gain * x);
            for i in 0..2 {
                let low = self.stage.u_min[i].max(before[i] + self.stage.du_min[i]);
                let high = self.stage.u_max[i].min(before[i] + self.stage.du_max[i]);
                before[i] = wish[i].clamp(low, high);
            }
            x = self.stage.successor(&x, &before);
        }
        x
    }
}

/// A and B by their power series, which converges at once for a rotation of a tenth of a radian.
fn discretised() -> (Matrix6<f64>, Matrix6x2<f64>) {
    let (linear, angular) = (
        [0.0, 0.0, SPEED_MM_S],
        [CURVATURE_PER_MM * SPEED_MM_S, 0.0, SPIN_RAD_S],
    );
    let cross =
        |w: [f64; 3]| nalgebra::Matrix3::new(0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0);
    let mut adjoint = Matrix6::zeros();
    adjoint
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&cross(angular));
    adjoint
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&cross(angular));
    adjoint
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&cross(linear));
    let mut directions = Matrix6x2::zeros();
    (directions[(2, 0)], directions[(3, 0)], directions[(5, 1)]) = (1.0, CURVATURE_PER_MM, 1.0);
    let (mut a, mut integral) = (Matrix6::identity(), Matrix6::identity() * STEP_S);
    let mut term = Matrix6::identity();
    for order in 1..20 {
        term = term * adjoint * (-STEP_S / f64::from(order));
        a += term;
        integral += term * (STEP_S / f64::from(order + 1));
    }
    (a, integral * directions)
}
