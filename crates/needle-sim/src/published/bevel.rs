//! The bevelled needle as published: state (x mm, y cm, z cm, alpha, beta, gamma), input (v m/s, omega rad/s).

use super::closed_loop::{PublishedNeedle, closed_loop};
use super::constants::{CONSTANTS, NeedleConstants};
use super::horizon::Horizon;
use super::{DT_S, PublishedError, check_horizon, nearest};
use crate::log::{LogRow, RunLog};
use nalgebra::{Matrix2, Matrix6, Matrix6x2, Vector2, Vector3, Vector6};

/// What may be chosen in a bevel run.
#[derive(Debug, Clone, PartialEq)]
pub struct BevelSettings {
    /// Diagonal of Q, for x in mm, y and z in cm, angles in radians.
    pub q_diagonal: [f64; 6],
    /// Diagonal of R, for v in m/s and omega in rad/s.
    pub r_diagonal: [f64; 2],
    /// N, from 1 to 60, the steps of the reference.
    pub horizon: usize,
    /// Tolerance of the solver.
    pub tolerance: f64,
}

impl Default for BevelSettings {
    /// The paper's choice: Q = diag(0.01, 0.1, 0.1, 0.1, 0.1, 0.1), R = diag(100, 10), N = 8; tolerance 1e-8.
    fn default() -> Self {
        let q_diagonal = [0.01, 0.1, 0.1, 0.1, 0.1, 0.1];
        Self {
            q_diagonal,
            r_diagonal: [100.0, 10.0],
            horizon: 8,
            tolerance: 1e-8,
        }
    }
}

/// Row scales: x in mm, y and z in cm.
const X_SCALE: f64 = 1000.0;
const YZ_SCALE: f64 = 100.0;
const NEEDLE: NeedleConstants = CONSTANTS.bevel;
const CRUISE: Vector2<f64> = Vector2::new(NEEDLE.cruise_v_m_s, NEEDLE.cruise_omega_rad_s);

/// A point of the reference: the state after a step, and the input that led to it.
#[derive(Debug, Clone, Copy)]
struct PathPoint {
    state: Vector6<f64>,
    input: Vector2<f64>,
}

/// The program's plant. Beta is updated before gamma uses it.
fn plant(state: &Vector6<f64>, input: &Vector2<f64>) -> Vector6<f64> {
    let [mut x, mut y, mut z, mut alpha, mut beta, mut gamma] = state.data.0[0];
    let (v, omega) = (input[0], input[1]);
    let turn = v * NEEDLE.curvature_per_m * DT_S;
    x += X_SCALE * v * beta.sin() * DT_S;
    y -= YZ_SCALE * v * beta.cos() * alpha.sin() * DT_S;
    z += YZ_SCALE * v * alpha.cos() * beta.cos() * DT_S;
    alpha += turn * gamma.cos() / beta.cos();
    beta += turn * gamma.sin();
    gamma += omega * DT_S - turn * gamma.cos() * beta.tan();
    Vector6::new(x, y, z, alpha, beta, gamma)
}

/// The 61 points of the reference, the start included.
fn reference_points() -> Vec<PathPoint> {
    let cruise = std::iter::repeat_n(0.01, NEEDLE.cruise_steps);
    let brake = (0..NEEDLE.brake_steps).map(|i| 0.009 - 0.001 * i as f64);
    let start = PathPoint {
        state: Vector6::zeros(),
        input: CRUISE,
    };
    let after = |state: &mut Vector6<f64>, v| {
        let input = Vector2::new(v, CRUISE[1]);
        *state = plant(state, &input);
        Some(PathPoint {
            state: *state,
            input,
        })
    };
    std::iter::once(start)
        .chain(cruise.chain(brake).scan(Vector6::zeros(), after))
        .collect()
}

/// The published prediction matrices at a reference point: no identity, no dt in A, and the derivative of x with
/// respect to beta in the column of alpha.
fn prediction(point: &PathPoint) -> (Matrix6<f64>, Matrix6x2<f64>) {
    let [_, _, _, alpha, beta, gamma] = point.state.data.0[0];
    let (v, kappa) = (point.input[0], NEEDLE.curvature_per_m);
    let mut a = Matrix6::zeros();
    a[(0, 3)] = X_SCALE * v * beta.cos();
    a[(1, 3)] = -YZ_SCALE * v * alpha.cos() * beta.cos();
    a[(1, 4)] = YZ_SCALE * v * alpha.sin() * beta.sin();
    a[(2, 3)] = -YZ_SCALE * v * alpha.sin() * beta.cos();
    a[(2, 4)] = -YZ_SCALE * v * alpha.cos() * beta.sin();
    a[(3, 4)] = kappa * v * gamma.cos() * beta.tan() / beta.cos();
    a[(3, 5)] = -kappa * v * gamma.sin() / beta.cos();
    a[(4, 5)] = kappa * v * gamma.cos();
    a[(5, 4)] = -kappa * v * gamma.cos() / beta.cos().powi(2);
    a[(5, 5)] = kappa * v * gamma.sin() * beta.tan();
    let mut b = Matrix6x2::zeros();
    b[(0, 0)] = X_SCALE * beta.sin();
    // Only the x row of B is scaled: y and z stay in metres.
    b[(1, 0)] = -beta.cos() * alpha.sin();
    b[(2, 0)] = beta.cos() * alpha.cos();
    b[(3, 0)] = kappa * gamma.cos() / beta.cos();
    b[(4, 0)] = kappa * gamma.sin();
    b[(5, 0)] = -kappa * gamma.cos() * beta.tan();
    b[(5, 1)] = 1.0;
    (a, b * DT_S)
}

/// N + 1 columns from point `first` on, as the program fills them near the end of the path.
fn window(path: &[PathPoint], first: usize, horizon: usize) -> Vec<PathPoint> {
    let points = path.len();
    let at_rest = PathPoint {
        input: Vector2::zeros(),
        ..path[points - 1]
    };
    let column = |i: usize| {
        if first >= points - 2 {
            at_rest
        } else if first + i < points {
            path[first + i]
        } else if i < horizon {
            at_rest
        } else {
            // Column N is never filled in once the window reaches past the path.
            PathPoint {
                state: Vector6::zeros(),
                input: Vector2::zeros(),
            }
        }
    };
    (0..=horizon).map(column).collect()
}

fn nearest_point(path: &[PathPoint], state: &Vector6<f64>) -> usize {
    let positions: Vec<Vector3<f64>> = path
        .iter()
        .map(|point| point.state.fixed_rows::<3>(0).into())
        .collect();
    nearest(&positions, &state.fixed_rows::<3>(0).into())
}

/// The published bevel reference as a run.
#[must_use]
pub fn bevel_reference() -> RunLog {
    let rows = reference_points().into_iter().enumerate();
    let rows = rows.map(|(step, point)| {
        BevelNeedle::row(step, &point.state, (step > 0).then_some(&point.input))
    });
    RunLog {
        run: "reference".into(),
        dt_s: DT_S,
        rows: rows.collect(),
    }
}

/// The closed loop of 71 steps from rest at the origin.
///
/// # Errors
/// [`PublishedError`] if the settings make no valid program.
pub fn run_bevel(run: &str, settings: &BevelSettings) -> Result<RunLog, PublishedError> {
    check_horizon(settings.horizon, NEEDLE.reference_steps())?;
    let needle = BevelNeedle {
        settings,
        path: reference_points(),
    };
    closed_loop(run, &needle, settings.tolerance, NEEDLE.closed_loop_steps)
}

/// Scales of the position's rows, in units of a metre.
pub(super) const SCALES: [f64; 3] = [X_SCALE, YZ_SCALE, YZ_SCALE];

/// The program along a path of the caller's.
#[derive(Debug, Clone)]
pub(super) struct Program {
    settings: BevelSettings,
    path: Vec<PathPoint>,
}

impl Program {
    /// Along points of scaled states, each with the input that led to it.
    pub(super) fn new(settings: BevelSettings, points: Vec<(Vector6<f64>, Vector2<f64>)>) -> Self {
        let path = points
            .into_iter()
            .map(|(state, input)| PathPoint { state, input })
            .collect();
        Self { settings, path }
    }

    /// The program of a step from `state`.
    pub(super) fn horizon(&self, state: &Vector6<f64>) -> Horizon<6> {
        horizon_at(&self.settings, &self.path, state)
    }
}

/// The program of a step from `state` along a path.
fn horizon_at(settings: &BevelSettings, path: &[PathPoint], state: &Vector6<f64>) -> Horizon<6> {
    let columns = window(path, nearest_point(path, state), settings.horizon);
    let (a, b) = prediction(&columns[0]);
    let states: Vec<_> = columns.iter().map(|point| point.state).collect();
    Horizon {
        a,
        b,
        q: Matrix6::from_diagonal(&settings.q_diagonal.into()),
        r: Matrix2::from_diagonal(&settings.r_diagonal.into()),
        targets: states.clone(),
        states,
        inputs: columns.iter().map(|point| point.input).collect(),
    }
}

/// Millimetres of a position in the program's scaled rows.
fn position_mm(state: &Vector6<f64>) -> [f64; 3] {
    [
        state[0] / X_SCALE * 1000.0,
        state[1] / YZ_SCALE * 1000.0,
        state[2] / YZ_SCALE * 1000.0,
    ]
}

struct BevelNeedle<'a> {
    settings: &'a BevelSettings,
    path: Vec<PathPoint>,
}

impl PublishedNeedle<6> for BevelNeedle<'_> {
    fn horizon(&self, state: &Vector6<f64>) -> Horizon<6> {
        horizon_at(self.settings, &self.path, state)
    }

    fn advance(&self, state: &Vector6<f64>, input: &Vector2<f64>) -> Vector6<f64> {
        plant(state, input)
    }

    fn row(step: usize, state: &Vector6<f64>, input: Option<&Vector2<f64>>) -> LogRow {
        let [x_mm, y_mm, z_mm] = position_mm(state).map(Some);
        LogRow {
            step,
            time_s: step as f64 * DT_S,
            x_mm,
            y_mm,
            z_mm,
            alpha_rad: Some(state[3]),
            beta_rad: Some(state[4]),
            gamma_rad: Some(state[5]),
            v_mm_s: input.map(|u| u[0] * 1000.0),
            omega_rad_s: input.map(|u| u[1]),
            ..LogRow::default()
        }
    }

    fn with_reference(&self, row: LogRow, state: &Vector6<f64>) -> LogRow {
        let index = nearest_point(&self.path, state);
        let [ref_x_mm, ref_y_mm, ref_z_mm] = position_mm(&self.path[index].state).map(Some);
        LogRow {
            ref_x_mm,
            ref_y_mm,
            ref_z_mm,
            nearest: Some(index),
            ..row
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reference is made with the simulator from the start of the loop, so its logged inputs alone follow it.
    #[test]
    fn feed_forward_alone_has_zero_error() {
        let reference = bevel_reference();
        let mut state = Vector6::zeros();
        for row in &reference.rows[1..] {
            let input = Vector2::new(row.v_mm_s.unwrap() / 1000.0, row.omega_rad_s.unwrap());
            state = plant(&state, &input);
            let logged = [row.x_mm, row.y_mm, row.z_mm].map(Option::unwrap);
            for (mine, logged) in position_mm(&state).into_iter().zip(logged) {
                assert!((mine - logged).abs() < 1e-12, "step {}", row.step);
            }
        }
    }

    #[test]
    fn window_past_the_end_repeats_the_last_point_and_never_fills_column_n() {
        let path = reference_points();
        let columns = window(&path, 55, 8);
        assert_eq!(columns[5].state, path[60].state);
        assert_eq!(
            (columns[7].state, columns[7].input),
            (path[60].state, Vector2::zeros())
        );
        assert_eq!(
            (columns[8].state, columns[8].input),
            (Vector6::zeros(), Vector2::zeros())
        );
        let columns = window(&path, 59, 8);
        assert!(
            columns
                .iter()
                .all(|column| column.state == path[60].state && column.input == Vector2::zeros())
        );
        assert_eq!(window(&path, 52, 8)[8].state, path[60].state);
    }
}
