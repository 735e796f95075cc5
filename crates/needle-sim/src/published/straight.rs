//! The straight needle (kappa = 0) as published: state (z, gamma) in metres and radians, A = I, B = dt I.

use super::closed_loop::{PublishedNeedle, closed_loop};
use super::horizon::{DEGREE, Horizon};
use super::{DT_S, PublishedError, check_horizon, nearest};
use crate::log::{LogRow, RunLog};
use nalgebra::{Matrix2, Vector2};

/// What may be chosen in a straight run.
#[derive(Debug, Clone, PartialEq)]
pub struct StraightSettings {
    /// Diagonal of Q, for z in metres and gamma in radians.
    pub q_diagonal: [f64; 2],
    /// Diagonal of R, for v in m/s and omega in rad/s.
    pub r_diagonal: [f64; 2],
    /// N, from 1 to 100, the steps of the reference.
    pub horizon: usize,
    /// Tolerance of the solver.
    pub tolerance: f64,
}

impl Default for StraightSettings {
    /// The paper's: Q = 10 I, R = I, N = 8; tolerance 1e-8.
    fn default() -> Self {
        Self {
            q_diagonal: [10.0; 2],
            r_diagonal: [1.0; 2],
            horizon: 8,
            tolerance: 1e-8,
        }
    }
}

const CRUISE_STEPS: usize = 90;
const BRAKE_STEPS: usize = 10;
const CLOSED_LOOP_STEPS: usize = 101;
const REFERENCE_SPIN_RAD_S: f64 = 0.1 * DEGREE;

fn reference_inputs() -> impl Iterator<Item = Vector2<f64>> {
    let cruise = std::iter::repeat_n(0.1, CRUISE_STEPS);
    let brake = (0..BRAKE_STEPS).map(|i| 0.09 - 0.01 * i as f64);
    cruise
        .chain(brake)
        .map(|v| Vector2::new(v, REFERENCE_SPIN_RAD_S))
}

/// The 100 states after each reference input; the start is not among them.
fn reference_states() -> Vec<Vector2<f64>> {
    let after = |state: &mut Vector2<f64>, input| {
        *state += DT_S * input;
        Some(*state)
    };
    reference_inputs().scan(Vector2::zeros(), after).collect()
}

/// The published straight reference as a run: the start, then its 100 states.
#[must_use]
pub fn straight_reference() -> RunLog {
    let start = StraightNeedle::row(0, &Vector2::zeros(), None);
    let later = reference_states()
        .into_iter()
        .zip(reference_inputs())
        .enumerate();
    let rows = std::iter::once(start)
        .chain(later.map(|(i, (state, input))| StraightNeedle::row(i + 1, &state, Some(&input))));
    RunLog {
        run: "reference".into(),
        dt_s: DT_S,
        rows: rows.collect(),
    }
}

/// The closed loop of 101 steps from rest at the origin.
///
/// # Errors
/// [`PublishedError`] if the settings make no valid program.
pub fn run_straight(run: &str, settings: &StraightSettings) -> Result<RunLog, PublishedError> {
    check_horizon(settings.horizon, CRUISE_STEPS + BRAKE_STEPS)?;
    let needle = StraightNeedle {
        settings,
        path: reference_states(),
    };
    closed_loop(run, &needle, settings.tolerance, CLOSED_LOOP_STEPS)
}

struct StraightNeedle<'a> {
    settings: &'a StraightSettings,
    path: Vec<Vector2<f64>>,
}

impl PublishedNeedle<2> for StraightNeedle<'_> {
    fn horizon(&self, state: &Vector2<f64>) -> Horizon<2> {
        let (first, last) = (nearest(&self.path, state), self.path.len() - 1);
        let columns = 0..=self.settings.horizon;
        Horizon {
            a: Matrix2::identity(),
            b: Matrix2::identity() * DT_S,
            q: Matrix2::from_diagonal(&self.settings.q_diagonal.into()),
            r: Matrix2::from_diagonal(&self.settings.r_diagonal.into()),
            states: columns
                .clone()
                .map(|i| self.path[(first + i).min(last)])
                .collect(),
            inputs: columns.clone().map(|_| Vector2::zeros()).collect(),
            // The stage cost measures the distance to the end of the path, not to the window.
            targets: columns.map(|_| self.path[last]).collect(),
        }
    }

    fn advance(&self, state: &Vector2<f64>, input: &Vector2<f64>) -> Vector2<f64> {
        state + DT_S * input
    }

    fn row(step: usize, state: &Vector2<f64>, input: Option<&Vector2<f64>>) -> LogRow {
        LogRow {
            step,
            time_s: step as f64 * DT_S,
            z_mm: Some(state[0] * 1000.0),
            gamma_rad: Some(state[1]),
            v_mm_s: input.map(|u| u[0] * 1000.0),
            omega_rad_s: input.map(|u| u[1]),
            ..LogRow::default()
        }
    }

    fn with_reference(&self, row: LogRow, state: &Vector2<f64>) -> LogRow {
        let index = nearest(&self.path, state);
        LogRow {
            ref_z_mm: Some(self.path[index][0] * 1000.0),
            nearest: Some(index),
            ..row
        }
    }
}
