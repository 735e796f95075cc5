//! Linear model predictive control about a reference: time-varying on SE(3), and time-invariant for the straight needle.
//!
//! The error is xi = log(g_r^-1 g), linearised along the reference itself, so the program is the same wherever the world frame
//! is. Of a straight needle only depth (xi_3) and roll (xi_6) answer to the inputs; there the model is x+ = x + dt u exactly,
//! the paper's problem. Both share this file; they differ in the coordinates of the error and the terminal choices.

mod configuration;
mod regulator;

pub use configuration::{LinearConfiguration, LinearWeights};

use crate::configuration::ConfigurationError;
use crate::controller::{
    ControlStep, Controller, Measurement, Origin, SolverStatistics, StopReason,
};
use crate::follower::Follower;
use crate::program::{MakeSolver, PlanSolver, boxed, structured};
use crate::survival::{Guard, Sample};
use crate::terminal::{
    ALL_COORDINATES, Chosen, DEPTH_AND_ROLL, Ingredients, TerminalChoice, TerminalRegion,
};
use crate::tracking::Tracker;
use lqr::Certificate;
use mpc_qp::{ConstraintGroup, OcpQp, SolveError};
use nalgebra::{SMatrix, SVector, Vector2, Vector6};
use needle_model::{Input, Needle, Pose, ReferencePath, StepError};
use regulator::{Regulator, weighted_stage};
use std::time::Instant;

/// Model predictive controller linearised along the reference; `NX` counts the coordinates of the error and the two inputs.
#[derive(Debug, Clone)]
pub struct LinearController<const NX: usize> {
    configuration: LinearConfiguration,
    coordinates: &'static [usize],
    follower: Follower,
    regulator: Regulator<NX>,
    ingredients: Ingredients,
    chosen: TerminalChoice,
    /// Poses of the last plan that was applied, from its own sample on.
    predicted: Vec<Pose>,
    /// Error of the last pose that was solved from.
    present: Vector6<f64>,
    lag_s: f64,
    value: f64,
    statistics: SolverStatistics,
}

/// Linear time-varying controller on SE(3).
pub type LtvController = LinearController<8>;

/// Controller of the straight needle: depth and roll.
pub type StraightController = LinearController<4>;

impl LtvController {
    /// A controller at the start of `path`, at rest, on the structured solver.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the setting that is out of range, or holds the reason why the terminal choice cannot be had.
    pub fn new(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
    ) -> Result<Self, ConfigurationError> {
        let make_solver = structured(configuration.survival.deadline);
        Self::with_solver(needle, path, configuration, make_solver)
    }

    /// The same on a solver of the caller's choice.
    ///
    /// # Errors
    /// As [`LtvController::new`].
    pub fn with_solver<S: PlanSolver<8> + 'static>(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
        make_solver: impl FnMut(&OcpQp<8, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        configuration.validate()?;
        let coordinates = ALL_COORDINATES;
        let problem = configuration.terminal_problem(needle, &path, coordinates);
        let chosen = problem.choose(configuration.terminal)?;
        Self::assemble(
            needle,
            path,
            configuration,
            coordinates,
            chosen,
            &mut boxed(make_solver),
        )
    }
}

impl StraightController {
    /// A controller of a straight needle (`curvature_per_mm` of zero) at the start of `path`, on the structured solver.
    ///
    /// # Errors
    /// As [`LtvController::new`], and [`TerminalError::Bent`](crate::TerminalError::Bent).
    pub fn new(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
    ) -> Result<Self, ConfigurationError> {
        let make_solver = structured(configuration.survival.deadline);
        Self::with_solver(needle, path, configuration, make_solver)
    }

    /// The same on a solver of the caller's choice.
    ///
    /// # Errors
    /// As [`StraightController::new`].
    pub fn with_solver<S: PlanSolver<4> + 'static>(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
        make_solver: impl FnMut(&OcpQp<4, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        configuration.validate()?;
        let coordinates = DEPTH_AND_ROLL;
        let problem = configuration.terminal_problem(needle, &path, coordinates);
        let chosen = problem.choose_straight(configuration.terminal)?;
        Self::assemble(
            needle,
            path,
            configuration,
            coordinates,
            chosen,
            &mut boxed(make_solver),
        )
    }
}

impl<const NX: usize> LinearController<NX> {
    fn assemble(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
        coordinates: &'static [usize],
        Chosen {
            choice,
            ingredients,
        }: Chosen,
        make_solver: MakeSolver<'_, NX>,
    ) -> Result<Self, ConfigurationError> {
        let LinearConfiguration {
            horizon,
            dt_s,
            limits,
            tracking,
            survival,
            ..
        } = configuration;
        let weights = &configuration.weights;
        let mut q = SMatrix::<f64, NX, NX>::zeros();
        for (i, &coordinate) in coordinates.iter().enumerate() {
            q[(i, i)] = weights.error[coordinate];
        }
        let start = path.poses().first().copied().unwrap_or_else(Pose::identity);
        let stage = weighted_stage(&q, &weights.of_input(), &weights.of_change());
        Ok(Self {
            coordinates,
            follower: Follower::new(
                needle,
                Tracker::new(path, tracking, dt_s, horizon),
                Guard::new(survival, limits, dt_s, horizon, start),
            ),
            regulator: Regulator::new(stage, horizon, limits, dt_s, &ingredients, make_solver)?,
            ingredients,
            chosen: choice,
            predicted: vec![Pose::identity(); horizon + 1],
            present: Vector6::zeros(),
            lag_s: 0.0,
            value: f64::NAN,
            statistics: SolverStatistics::default(),
            configuration,
        })
    }

    /// The configuration.
    #[must_use]
    pub fn configuration(&self) -> &LinearConfiguration {
        &self.configuration
    }

    /// The terminal choice in force; never [`TerminalChoice::Auto`].
    #[must_use]
    pub fn terminal(&self) -> TerminalChoice {
        self.chosen
    }

    /// What is claimed of the terminal ingredients, check by check; `None` without a terminal set. The claims are about the
    /// model's curvature: an estimate that differs voids them.
    #[must_use]
    pub fn certificate(&self) -> Option<&Certificate> {
        self.ingredients.certificate.as_ref()
    }

    /// Where the terminal set of the last step wants the tip at the horizon's end; `None` without a set.
    #[must_use]
    pub fn terminal_region(&self) -> Option<TerminalRegion> {
        let tracker = &self.follower.tracker;
        TerminalRegion::at_horizon_end(tracker, &self.ingredients, self.coordinates)
    }

    /// Optimal cost V_N of the last step that was solved, in the units of the weights; NaN before.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.value
    }

    fn decide(
        &mut self,
        measurement: &Measurement,
        time_s: f64,
        started: Instant,
    ) -> (Input, Origin) {
        let sample = self.follower.observe(measurement, time_s);
        self.shift(sample.elapsed_s);
        if let Some(step) = self.follower.without_plan(&sample) {
            return step;
        }
        let origin = sample
            .pose
            .and_then(|pose| self.solve(&pose, &sample, started));
        let Follower { tracker, guard, .. } = &mut self.follower;
        match origin {
            Some(origin) if !guard.late(started.elapsed()) => {
                let (wanted, solution) = (&tracker.inputs, self.regulator.solution());
                let planned = wanted.iter().zip(&solution.u).map(|(u, d)| absolute(*u, d));
                guard.keep(planned);
                let input = guard.apply(absolute(wanted[0], &solution.u[0]), &sample);
                self.predict();
                (input, origin)
            }
            _ => guard.fall_back(&sample, StopReason::NoPlan),
        }
    }

    /// Moves guesses by the whole steps that have passed since the last sample.
    fn shift(&mut self, elapsed_s: f64) {
        let (dt_s, horizon) = (self.configuration.dt_s, self.configuration.horizon);
        let steps = ((self.lag_s + elapsed_s) / dt_s)
            .round()
            .clamp(0.0, horizon as f64);
        self.lag_s = (self.lag_s + elapsed_s - steps * dt_s).clamp(-dt_s, dt_s);
        self.regulator.shift(steps as usize);
    }

    /// Solves from a pose; `None` without a usable answer.
    fn solve(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> Option<Origin> {
        self.linearise().ok()?;
        let Follower { tracker, guard, .. } = &self.follower;
        // The deviation applied last was one from the reference's input at that time.
        let before = tracker.input_before();
        self.regulator
            .set_limits(before, &tracker.inputs, sample.reach_s);
        let xi = pose.error_from(&tracker.poses[0]);
        self.present = xi;
        let mut error = SVector::<f64, NX>::zeros();
        for (i, &coordinate) in self.coordinates.iter().enumerate() {
            error[i] = xi[coordinate];
        }
        let previous = guard.previous();
        let previous = Vector2::new(
            previous.v_mm_s - before.v_mm_s,
            previous.omega_rad_s - before.omega_rad_s,
        );
        let end_step = tracker.step() + self.configuration.horizon;
        let answer = self
            .regulator
            .solve(
                &error,
                &previous,
                (&self.ingredients, end_step),
                guard.remaining(started),
            )
            .ok()?;
        self.statistics.status = Some(answer.status);
        self.statistics.solves += answer.solves;
        self.statistics.iterations += answer.iterations;
        let usable =
            answer.status.has_solution() && self.regulator.solution().u[0].sum().is_finite();
        if !usable {
            return None;
        }
        // The programs carry the factor 1/2 of `mpc-qp`.
        self.value = 2.0 * self.regulator.solution().objective;
        Some(match answer.violation > 0.0 {
            true => Origin::Degraded {
                softened: ConstraintGroup::TerminalSet,
                violation: answer.violation,
            },
            false => Origin::Optimal,
        })
    }

    fn linearise(&mut self) -> Result<(), StepError> {
        let (tracker, dt_s) = (&self.follower.tracker, self.configuration.dt_s);
        for k in 0..self.configuration.horizon {
            let (here, next) = (&tracker.poses[k], &tracker.poses[k + 1]);
            let link = self
                .follower
                .needle
                .step_residual(here, tracker.inputs[k], next, dt_s)?
                .solved_for_target();
            let stage = self.regulator.stage_mut(k);
            for (i, &row) in self.coordinates.iter().enumerate() {
                for (j, &column) in self.coordinates.iter().enumerate() {
                    stage.a[(i, j)] = link.a[(row, column)];
                }
                for j in 0..2 {
                    stage.b[(i, j)] = link.b[(row, j)];
                }
                stage.c[i] = link.c[row];
            }
        }
        Ok(())
    }

    /// Poses of the plan; coordinates outside the model keep the present error.
    fn predict(&mut self) {
        let reference = &self.follower.tracker.poses;
        for (k, x) in self.regulator.solution().x.iter().enumerate() {
            let mut xi = self.present;
            for (i, &coordinate) in self.coordinates.iter().enumerate() {
                xi[coordinate] = x[i];
            }
            self.predicted[k] = reference[k].perturbed(&xi);
        }
    }

    fn decided(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        let started = Instant::now();
        self.statistics = SolverStatistics::default();
        let (input, origin) = self.decide(measurement, time_s, started);
        self.statistics.time = started.elapsed();
        let predicted: &[Pose] = match origin {
            Origin::Stop { .. } => &[],
            Origin::ShiftedPlan { age } => self.predicted.get(age..).unwrap_or_default(),
            _ => &self.predicted,
        };
        ControlStep {
            input,
            origin,
            predicted,
            statistics: self.statistics,
        }
    }

    fn forget(&mut self) {
        self.follower.reset();
        self.regulator.shift(usize::MAX);
        self.lag_s = 0.0;
        self.value = f64::NAN;
    }
}

// One for each, not one for all `NX`: so both are compiled here and not again in every crate that uses them.
impl Controller for LtvController {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        self.decided(measurement, time_s)
    }

    fn reset(&mut self) {
        self.forget();
    }
}

impl Controller for StraightController {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        self.decided(measurement, time_s)
    }

    fn reset(&mut self) {
        self.forget();
    }
}

fn absolute(wanted: Input, deviation: &Vector2<f64>) -> Input {
    Input {
        v_mm_s: wanted.v_mm_s + deviation[0],
        omega_rad_s: wanted.omega_rad_s + deviation[1],
    }
}
