//! Nonlinear model predictive control on the exact discrete SE(3) model: sequential quadratic programming by multiple shooting.
//!
//! Each step shifts the plan of the step before, moves it to the measured pose and improves it: by one Gauss-Newton step (the
//! real-time iteration of Diehl, Bock and Schloeder, 2005) or until it converges. The first plan is the best of three
//! candidates: the reference's inputs, and the guessed spin in either sense. Left out: state constraints.

mod configuration;
mod cost;
mod shooting;
mod spin;

pub use configuration::{Convergence, NmpcConfiguration, SpinTarget};
pub use cost::NmpcWeights;

use crate::configuration::ConfigurationError;
use crate::controller::{
    ControlStep, Controller, Measurement, Origin, SolverStatistics, StopReason,
};
use crate::survival::{Guard, Sample, estimated_needle};
use crate::tracking::Tracker;
use mpc_qp::{OcpQp, OcpSolver, SolveError, SolveStatus, SolverSettings, StructuredSolver};
use needle_model::{Input, Needle, Pose, ReferencePath};
use shooting::{Plan, Shooting};
use spin::{Sense, SpinLaw};
use std::time::Instant;

/// Nonlinear model predictive controller of a bevel-tip needle along a path.
#[derive(Debug, Clone)]
pub struct NmpcController<S = StructuredSolver<6, 2>> {
    configuration: NmpcConfiguration,
    model: Needle,
    needle: Needle,
    tracker: Tracker,
    guard: Guard,
    shooting: Shooting<S>,
    candidate: Plan,
    /// Whether the plan is one, and the time by which it lags the present sample, s.
    planned: Option<f64>,
    statistics: SolverStatistics,
}

impl NmpcController {
    /// A controller at the start of `path`, at rest, on the structured solver.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the setting that is out of range.
    pub fn new(
        needle: Needle,
        path: ReferencePath,
        configuration: NmpcConfiguration,
    ) -> Result<Self, ConfigurationError> {
        let settings = SolverSettings {
            time_limit: configuration.survival.deadline,
            ..SolverSettings::default()
        };
        Self::with_solver(needle, path, configuration, |problem| {
            StructuredSolver::new(problem, settings)
        })
    }
}

impl<S: OcpSolver<6, 2>> NmpcController<S> {
    /// The same on a solver of the caller's choice.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the setting that is out of range, or holds the solver's refusal.
    pub fn with_solver(
        needle: Needle,
        path: ReferencePath,
        configuration: NmpcConfiguration,
        make_solver: impl FnOnce(&OcpQp<6, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        configuration.validate()?;
        let NmpcConfiguration {
            horizon,
            dt_s,
            limits,
            tracking,
            survival,
            ..
        } = configuration;
        let shooting = Shooting::new(&configuration, make_solver)?;
        Ok(Self {
            model: needle,
            needle,
            tracker: Tracker::new(path, tracking, dt_s, horizon),
            guard: Guard::new(survival, limits, dt_s, horizon),
            candidate: shooting.plan.clone(),
            shooting,
            planned: None,
            statistics: SolverStatistics::default(),
            configuration,
        })
    }

    /// The configuration.
    #[must_use]
    pub fn configuration(&self) -> &NmpcConfiguration {
        &self.configuration
    }

    /// The path followed.
    #[must_use]
    pub fn path(&self) -> &ReferencePath {
        self.tracker.path()
    }

    fn decide(
        &mut self,
        measurement: &Measurement,
        time_s: f64,
        started: Instant,
    ) -> (Input, Origin) {
        if let Some(needle) = estimated_needle(&self.model, measurement) {
            self.needle = needle;
        }
        let sample = self.guard.accept(&self.needle, measurement, time_s);
        self.tracker.advance(sample.elapsed_s, sample.pose.as_ref());
        self.shift(sample.elapsed_s);
        if self.tracker.finished(sample.pose.as_ref()) {
            self.planned = None;
            return self.guard.stop(&sample, StopReason::PathEnd);
        }
        let Some(pose) = sample.pose else {
            return self.guard.fall_back(&sample, StopReason::NoMeasurement);
        };
        if self.improve(&pose, &sample, started) && !self.guard.late(started.elapsed()) {
            let input = self.shooting.plan.inputs[0];
            self.guard.keep(self.shooting.plan.inputs.iter().copied());
            return (self.guard.apply(input, &sample), Origin::Optimal);
        }
        self.guard.fall_back(&sample, StopReason::NoPlan)
    }

    /// Shifts the plan by the whole steps that have passed since it was made and fills its end.
    fn shift(&mut self, elapsed_s: f64) {
        let Some(lag_s) = self.planned else { return };
        let (dt_s, horizon) = (self.configuration.dt_s, self.configuration.horizon);
        let steps = ((lag_s + elapsed_s) / dt_s).round();
        if steps >= horizon as f64 {
            self.planned = None;
            self.shooting.forget();
            return;
        }
        self.planned = Some(lag_s + elapsed_s - steps * dt_s);
        self.shooting.shift_guess(steps as usize);
        let first = self.shooting.plan.shift(steps as usize);
        let spin: f64 = self.shooting.plan.inputs[..first]
            .iter()
            .map(|u| u.omega_rad_s)
            .sum();
        let sense = if spin < 0.0 {
            Sense::Negative
        } else {
            Sense::Positive
        };
        let (law, needle, tracker) = (self.law(), self.needle, &self.tracker);
        fill(
            &mut self.shooting.plan,
            first,
            &needle,
            tracker,
            |pose, k| law.input(&needle, tracker, pose, k, sense),
            dt_s,
        );
    }

    fn law(&self) -> SpinLaw {
        SpinLaw {
            omega_max_rad_s: self.configuration.limits.omega_max_rad_s,
            dt_s: self.configuration.dt_s,
        }
    }

    /// Improves the plan from `pose`; false if no usable plan results.
    fn improve(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> bool {
        if self.planned.is_none() {
            return self.plan_afresh(pose, sample, started);
        }
        self.shooting.plan.embed(pose);
        let good = match self.configuration.convergence {
            Convergence::RealTime => {
                self.solve(sample).has_solution() && self.shooting.take_full_step()
            }
            Convergence::Full {
                tolerance,
                max_iterations,
            } => self.converge(sample, started, tolerance, max_iterations),
        };
        if !good {
            // A plan that led nowhere is no guess for the next sample.
            self.planned = None;
            self.shooting.forget();
        }
        good
    }

    fn solve(&mut self, sample: &Sample) -> SolveStatus {
        let previous = self.guard.previous();
        let (status, iterations) =
            self.shooting
                .solve(&self.needle, &self.tracker, previous, sample.reach_s);
        self.statistics.status = Some(status);
        self.statistics.solves += 1;
        self.statistics.iterations += iterations;
        status
    }

    /// Gauss-Newton steps with a line search; false only if the first one fails.
    fn converge(&mut self, sample: &Sample, started: Instant, tolerance: f64, most: usize) -> bool {
        for iteration in 0..most {
            if iteration > 0 && self.guard.late(2 * started.elapsed()) {
                break;
            }
            if !self.solve(sample).has_solution() {
                return iteration > 0;
            }
            let small = self.shooting.step_size() < tolerance;
            if small {
                return self.shooting.take_full_step();
            }
            if !self.shooting.search(&self.needle, &self.tracker) {
                break;
            }
        }
        true
    }

    /// The best of the reference's inputs and the guessed spins, each improved a little.
    fn plan_afresh(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> bool {
        let (law, needle, dt_s) = (self.law(), self.needle, self.configuration.dt_s);
        let mut best = f64::INFINITY;
        for sense in [Some(Sense::Positive), Some(Sense::Negative), None] {
            if best.is_finite() && self.guard.late(2 * started.elapsed()) {
                break;
            }
            self.shooting.forget();
            let tracker = &self.tracker;
            self.shooting.plan.poses[0] = *pose;
            fill(
                &mut self.shooting.plan,
                0,
                &needle,
                tracker,
                |pose, k| match sense {
                    Some(sense) => law.input(&needle, tracker, pose, k, sense),
                    None => tracker.inputs[k],
                },
                dt_s,
            );
            if !self.converge(sample, started, 1e-6, self.configuration.start_iterations) {
                continue;
            }
            let cost = self.shooting.cost(&self.shooting.plan, &self.tracker);
            if cost < best {
                best = cost;
                self.candidate
                    .poses
                    .copy_from_slice(&self.shooting.plan.poses);
                self.candidate
                    .inputs
                    .copy_from_slice(&self.shooting.plan.inputs);
            }
        }
        std::mem::swap(&mut self.shooting.plan, &mut self.candidate);
        self.shooting.forget();
        self.planned = best.is_finite().then_some(0.0);
        best.is_finite()
    }
}

impl SpinLaw {
    /// The guess of stage `k` from `pose`: the reference's speed and the guessed spin.
    fn input(
        &self,
        needle: &Needle,
        tracker: &Tracker,
        pose: &Pose,
        k: usize,
        sense: Sense,
    ) -> Input {
        let v_mm_s = tracker.inputs[k].v_mm_s;
        // Rotation at rest bends nothing.
        let omega_rad_s = match v_mm_s == 0.0 {
            true => 0.0,
            false => self.omega_rad_s(needle, pose, &tracker.bending_per_mm(k), sense),
        };
        Input {
            v_mm_s,
            omega_rad_s,
        }
    }
}

/// Fills the plan from stage `first` on by simulation; an input that is not finite is rest.
fn fill(
    plan: &mut Plan,
    first: usize,
    needle: &Needle,
    tracker: &Tracker,
    input: impl Fn(&Pose, usize) -> Input,
    dt_s: f64,
) {
    debug_assert_eq!(plan.inputs.len(), tracker.inputs.len());
    for k in first..plan.inputs.len() {
        let pose = plan.poses[k];
        let wanted = input(&pose, k);
        let (input, next) = match needle.step(&pose, wanted, dt_s) {
            Ok(next) => (wanted, next),
            Err(_) => (Input::ZERO, pose),
        };
        plan.inputs[k] = input;
        plan.poses[k + 1] = next;
    }
}

impl<S: OcpSolver<6, 2>> Controller for NmpcController<S> {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        let started = Instant::now();
        self.statistics = SolverStatistics::default();
        let (input, origin) = self.decide(measurement, time_s, started);
        self.statistics.time = started.elapsed();
        let predicted: &[Pose] = match origin {
            Origin::Stop { .. } => &[],
            _ => &self.shooting.plan.poses,
        };
        ControlStep {
            input,
            origin,
            predicted,
            statistics: self.statistics,
        }
    }

    fn reset(&mut self) {
        self.needle = self.model;
        self.tracker.reset();
        self.guard.reset();
        self.shooting.forget();
        self.planned = None;
    }
}
