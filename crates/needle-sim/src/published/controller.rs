//! The published program behind the interface of the controllers, so that it can be exchanged for one of them. Its errors are kept:
//! the first input's rate is free, v has no lower bound, and it never comes to an end.

use super::bevel::{BevelSettings, Program, SCALES};
use super::constants::CONSTANTS;
use super::horizon::HorizonSolver;
use super::{PublishedError, check_horizon};
use crate::log::SOLVED;
use mpc_qp::SolveStatus;
use nalgebra::{Vector2, Vector6};
use needle_control::{ControlStep, Controller, Measurement, Origin, SolverStatistics, StopReason};
use needle_model::{ChartError, EulerState, Input, ReferencePath};
use std::time::Instant;

/// The paper's controller along any path: one linear program a sample, about the nearest point of the path.
#[derive(Debug)]
pub struct PublishedController {
    program: Program,
    solver: HorizonSolver<6>,
    tolerance: f64,
    step: usize,
}

impl Clone for PublishedController {
    /// Every solve starts cold, so a new solver is as good as the old one.
    fn clone(&self) -> Self {
        Self {
            program: self.program.clone(),
            solver: HorizonSolver::new(self.tolerance),
            ..*self
        }
    }
}

/// Why a path is none for the published program.
#[derive(Debug, thiserror::Error)]
pub enum PublishedPathError {
    /// A pose has no Euler angles.
    #[error("pose {pose} has no Euler angles")]
    Chart {
        /// Index of the pose.
        pose: usize,
        /// What the chart says.
        source: ChartError,
    },
    /// The settings do not fit the path.
    #[error(transparent)]
    Settings(#[from] PublishedError),
}

impl PublishedController {
    /// The program along `path`, whose time step it takes to be 0.1 s and whose needle to be the paper's.
    ///
    /// # Errors
    /// [`PublishedPathError`] for a pose without Euler angles, or a horizon longer than the path.
    pub fn new(path: &ReferencePath, settings: BevelSettings) -> Result<Self, PublishedPathError> {
        check_horizon(settings.horizon, path.inputs().len())?;
        let mut points = Vec::with_capacity(path.poses().len());
        for (pose, at) in path.poses().iter().enumerate() {
            let euler = EulerState::from_pose(at)
                .map_err(|source| PublishedPathError::Chart { pose, source })?;
            // A point carries the input that led to it; the first one that of the step after it.
            let input = path.inputs()[pose.saturating_sub(1)];
            points.push((scaled(&euler), published(input)));
        }
        let tolerance = settings.tolerance;
        Ok(Self {
            program: Program::new(settings, points),
            solver: HorizonSolver::new(tolerance),
            tolerance,
            step: 0,
        })
    }

    /// Input and account from a measured state; `None` after a solve that failed.
    fn solve(&mut self, state: &Vector6<f64>, account: &mut SolverStatistics) -> Option<Input> {
        let horizon = self.program.horizon(state);
        let answer = self.solver.first_input(self.step, &horizon, *state).ok()?;
        account.status = (answer.status == SOLVED).then_some(SolveStatus::Solved);
        account.solves = 1;
        account.iterations = answer.iterations;
        let input = answer.u? + horizon.inputs[0];
        Some(Input {
            v_mm_s: 1000.0 * input[0],
            omega_rad_s: input[1],
        })
    }
}

/// The rows of the program: x in mm, y and z in cm.
fn scaled(euler: &EulerState) -> Vector6<f64> {
    let [x, y, z] = SCALES.map(|scale| scale / 1000.0);
    Vector6::new(
        x * euler.x_mm,
        y * euler.y_mm,
        z * euler.z_mm,
        euler.alpha_rad,
        euler.beta_rad,
        euler.gamma_rad,
    )
}

fn published(input: Input) -> Vector2<f64> {
    Vector2::new(input.v_mm_s / 1000.0, input.omega_rad_s)
}

impl Controller for PublishedController {
    fn step(&mut self, measurement: &Measurement, _time_s: f64) -> ControlStep<'_> {
        let started = Instant::now();
        let mut statistics = SolverStatistics::default();
        let state = measurement
            .pose
            .and_then(|pose| EulerState::from_pose(&pose).ok())
            .map(|euler| scaled(&euler));
        let found = state.and_then(|state| self.solve(&state, &mut statistics));
        self.step += 1;
        statistics.time = started.elapsed();
        let reason = match state {
            Some(_) => StopReason::NoPlan,
            None => StopReason::NoMeasurement,
        };
        // As in the program, a solve that fails moves nothing.
        let (input, origin) = match found {
            Some(input) => (within_limits(input), Origin::Optimal),
            None => (Input::ZERO, Origin::Stop { reason }),
        };
        ControlStep {
            input,
            origin,
            predicted: &[],
            statistics,
        }
    }

    fn applied(&mut self, _input: Input) {}

    fn reset(&mut self) {
        self.solver = HorizonSolver::new(self.tolerance);
        self.step = 0;
    }
}

/// The program's own bounds; its solver may pass them by its tolerance.
fn within_limits(input: Input) -> Input {
    let (v_max_mm_s, omega_max_rad_s) = (1000.0 * CONSTANTS.v_max_m_s, CONSTANTS.omega_max_rad_s);
    Input {
        v_mm_s: input.v_mm_s.min(v_max_mm_s),
        omega_rad_s: input.omega_rad_s.clamp(-omega_max_rad_s, omega_max_rad_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::{DT_S, bevel_reference, run_bevel};

    /// The path of the program's own reference, poses and inputs.
    fn own_path() -> ReferencePath {
        let rows = bevel_reference().rows;
        let euler = |row: &crate::log::LogRow| EulerState {
            x_mm: row.x_mm.unwrap(),
            y_mm: row.y_mm.unwrap(),
            z_mm: row.z_mm.unwrap(),
            alpha_rad: row.alpha_rad.unwrap(),
            beta_rad: row.beta_rad.unwrap(),
            gamma_rad: row.gamma_rad.unwrap(),
        };
        let poses = rows.iter().map(|row| euler(row).to_pose()).collect();
        let inputs = rows[1..].iter().map(|row| Input {
            v_mm_s: row.v_mm_s.unwrap(),
            omega_rad_s: row.omega_rad_s.unwrap(),
        });
        ReferencePath::from_samples(poses, inputs.collect(), DT_S).unwrap()
    }

    #[test]
    fn on_its_own_states_the_controller_gives_the_inputs_of_the_published_run() {
        let run = run_bevel("own", &BevelSettings::default()).unwrap();
        let mut controller =
            PublishedController::new(&own_path(), BevelSettings::default()).unwrap();
        for pair in run.rows.windows(2).take(40) {
            let (here, next) = (&pair[0], &pair[1]);
            let pose = EulerState {
                x_mm: here.x_mm.unwrap(),
                y_mm: here.y_mm.unwrap(),
                z_mm: here.z_mm.unwrap(),
                alpha_rad: here.alpha_rad.unwrap(),
                beta_rad: here.beta_rad.unwrap(),
                gamma_rad: here.gamma_rad.unwrap(),
            };
            let input = controller.step(&Measurement::of(pose.to_pose()), 0.0).input;
            // The angles pass through a pose and back: rounding of 1e-15, through a solver of tolerance 1e-8.
            assert!(
                (input.v_mm_s - next.v_mm_s.unwrap()).abs() < 1e-3
                    && (input.omega_rad_s - next.omega_rad_s.unwrap()).abs() < 1e-5,
                "step {}: {input:?}",
                here.step
            );
        }
    }

    #[test]
    fn a_missing_measurement_moves_nothing_and_says_so() {
        let mut controller =
            PublishedController::new(&own_path(), BevelSettings::default()).unwrap();
        let step = controller.step(&Measurement::default(), 0.0);
        let reason = StopReason::NoMeasurement;
        assert_eq!(step.input, Input::ZERO);
        assert_eq!(step.origin, Origin::Stop { reason });
    }
}
