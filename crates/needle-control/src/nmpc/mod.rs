//! Nonlinear model predictive control on the exact discrete SE(3) model: sequential quadratic programming by multiple shooting.
//!
//! Each step shifts the plan of the step before, moves it to the measured pose and improves it: by one Gauss-Newton step (the
//! real-time iteration of Diehl, Bock and Schloeder, 2005) or until it converges. Far off the path the program looks beyond its
//! horizon. The first plan is the best of three candidates: the reference's inputs, and the guessed spin in either sense. Along a path
//! that the needle executes the horizon can end in a terminal set, with a certificate. The tip can be kept in a corridor about the path.

mod configuration;
mod cost;
mod ellipsoid_search;
mod end;
mod line_search;
mod plan;
mod shooting;
mod spin;
mod start;
mod stray;
pub(crate) mod terminal;

pub use configuration::{Convergence, NmpcConfiguration, SpinTarget};
pub use cost::NmpcWeights;

use crate::configuration::ConfigurationError;
use crate::controller::{
    ControlStep, Controller, Measurement, Origin, Softened, SolverStatistics, StopReason,
};
use crate::follower::Follower;
use crate::plan_solver::{PlanSolver, boxed, structured};
use crate::survival::Sample;
use crate::terminal::{ALL_COORDINATES, Chosen, RefusedChoice, TerminalChoice, TerminalRegion};
use end::Form;
use lqr::Certificate;
use mpc_qp::{OcpQp, SolveError, SolveStatus};
use needle_model::{Input, Needle, Pose, ReferencePath};
use plan::Plan;
use shooting::Shooting;
use std::time::Instant;
use stray::Stray;

/// Nonlinear model predictive controller of a bevel-tip needle along a path.
#[derive(Debug, Clone)]
pub struct NmpcController {
    configuration: NmpcConfiguration,
    follower: Follower,
    chosen: Chosen,
    shooting: Shooting,
    candidate: Plan,
    /// Poses of the last plan that was applied, from its own sample on.
    applied: Vec<Pose>,
    /// Whether the plan is one, and the time by which it lags the present sample, s.
    planned: Option<f64>,
    /// How far the last plan's end is outside the terminal set.
    violation: f64,
    statistics: SolverStatistics,
}

/// A needle whose state is known, at a time along the path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    pub(crate) needle: Needle,
    pub(crate) pose: Pose,
    /// Time along the path.
    pub(crate) time_s: f64,
    /// Since the plan before.
    pub(crate) elapsed_s: f64,
    /// Held until now; the first input can be changed from it for `reach_s`.
    pub(crate) held: Input,
    pub(crate) reach_s: f64,
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
        let make_solver = structured(configuration.survival.deadline);
        Self::with_solver(needle, path, configuration, make_solver)
    }

    /// The same on a solver of the caller's choice.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the setting that is out of range, or holds the solver's refusal.
    pub fn with_solver<S: PlanSolver<6> + 'static>(
        needle: Needle,
        path: ReferencePath,
        configuration: NmpcConfiguration,
        make_solver: impl FnMut(&OcpQp<6, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        configuration.validate()?;
        let chosen = terminal::chosen(needle, &path, &configuration)?;
        let with_set = chosen.ingredients.at(0).level.is_some();
        let shooting = Shooting::new(&configuration, with_set, &mut boxed(make_solver))?;
        Ok(Self {
            follower: Follower::new(needle, path, configuration.pursuit()),
            chosen,
            candidate: shooting.plan.clone(),
            applied: shooting.plan.poses.clone(),
            shooting,
            planned: None,
            violation: 0.0,
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
        self.follower.tracker.path()
    }

    /// The terminal choice in force; never [`TerminalChoice::Auto`].
    #[must_use]
    pub fn terminal(&self) -> TerminalChoice {
        self.chosen.choice
    }

    /// What [`TerminalChoice::Auto`] could not have in full, with the reasons: the stronger choices that it tried, and last the one in
    /// force itself where its cost stands at the end without a set. Empty for a choice by name.
    #[must_use]
    pub fn refused_terminals(&self) -> &[RefusedChoice] {
        &self.chosen.refused
    }

    /// What is claimed of the terminal ingredients, check by check; `None` without a terminal set. The last check is about the needle
    /// itself, the others about the linearised one. All are about the model's curvature: under an estimate that is more than 0.1 % off they
    /// say nothing, and the set is left out.
    #[must_use]
    pub fn certificate(&self) -> Option<&Certificate> {
        self.chosen.ingredients.certificate.as_ref()
    }

    /// Where the terminal set of the last step wants the tip at the horizon's end; `None` without a set, or where another curvature is
    /// estimated than the set is about.
    #[must_use]
    pub fn terminal_region(&self) -> Option<TerminalRegion> {
        if self.follower.needle_differs() {
            return None;
        }
        let tracker = &self.follower.tracker;
        TerminalRegion::at_horizon_end(tracker, &self.chosen.ingredients, ALL_COORDINATES)
    }

    /// Cost V_N of the present plan, in the units of the weights, by those in force at the last step; the price of leaving a corridor is no part of it.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.shooting
            .cost(&self.shooting.plan, &self.follower.tracker)
    }

    /// Inputs of a plan from a pose that is known: no clock, no gate, no fall-back. `None` where no plan results by the deadline of a
    /// step that began at `started`.
    pub(crate) fn plan_from(&mut self, here: &Known, started: Instant) -> Option<&[Input]> {
        let Follower {
            needle,
            tracker,
            guard,
            ..
        } = &mut self.follower;
        *needle = here.needle;
        tracker.place(here.time_s);
        guard.hold(here.held);
        self.statistics = SolverStatistics::default();
        self.shift(here.elapsed_s);
        let sample = Sample {
            elapsed_s: here.elapsed_s,
            reach_s: here.reach_s,
            pose: Some(here.pose),
        };
        let planned = self.improve(&here.pose, &sample, started);
        planned.then_some(&self.shooting.plan.inputs)
    }

    /// Of the last step.
    pub(crate) fn statistics(&self) -> SolverStatistics {
        self.statistics
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
        let improved = sample
            .pose
            .is_some_and(|pose| self.improve(&pose, &sample, started));
        let tracker = &self.follower.tracker;
        let softened = Softened {
            corridor_mm: self.shooting.left_by_mm(tracker),
            terminal_set: self.violation.max(self.shooting.outside(tracker)),
        };
        let guard = &mut self.follower.guard;
        if !improved || guard.late(started.elapsed()) {
            return guard.fall_back(&sample, StopReason::NoPlan);
        }
        let inputs = &self.shooting.plan.inputs;
        guard.keep(inputs.iter().copied());
        self.applied.copy_from_slice(&self.shooting.plan.poses);
        (guard.apply(inputs[0], &sample), softened.origin())
    }

    /// Improves the plan from `pose`; false if no usable plan results.
    fn improve(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> bool {
        let NmpcConfiguration { horizon, dt_s, .. } = self.configuration;
        let mut form = self.chosen.form(self.follower.tracker.step() + horizon);
        if self.follower.needle_differs() {
            form = form.map(Form::without_set);
        }
        let stray = Stray::at(pose, &self.follower, dt_s);
        self.shooting.weigh(form, &stray);
        if let Some(corridor) = &mut self.shooting.corridor {
            let tracker = &self.follower.tracker;
            let (kappa_per_mm, bending) = (
                self.follower.needle.curvature_per_mm(),
                tracker.bending_per_mm(0),
            );
            corridor.enclose(pose, &tracker.poses[0], kappa_per_mm, &bending);
        }
        if self.planned.is_none() {
            return self.plan_afresh(pose, sample, started);
        }
        self.shooting.plan.embed(pose);
        let good = match self.configuration.convergence {
            Convergence::RealTime => {
                self.solve(sample, started) && self.take_real_time_step(sample.reach_s)
            }
            Convergence::Full {
                tolerance,
                max_iterations,
            } => {
                self.shooting
                    .bring_within_reach(&self.follower, sample.reach_s);
                self.converge(sample, started, tolerance, max_iterations)
            }
        };
        if !good {
            self.shooting.forget();
            // A plan that led nowhere is no guess for the next sample; one that there was no time to improve is.
            if self.statistics.status != Some(SolveStatus::TimeLimit) {
                self.planned = None;
            }
        }
        good
    }

    /// Moves the plan by one real-time iteration; false if that leads nowhere. The cost says nothing of the way into a terminal set: with
    /// one the step is taken in full.
    fn take_real_time_step(&mut self, reach_s: f64) -> bool {
        if self.shooting.end.has_set() {
            return self.shooting.take_full_step();
        }
        self.shooting.take_falling_step(&self.follower, reach_s)
    }

    /// Solves for a step; false without one.
    fn solve(&mut self, sample: &Sample, started: Instant) -> bool {
        let account = self.shooting.solve(&self.follower, sample.reach_s, started);
        self.statistics.status = Some(account.status);
        self.statistics.solves += account.solves;
        self.statistics.iterations += account.iterations;
        self.violation = account.violation;
        account.status.has_solution()
    }

    /// Gauss-Newton steps with a line search; false only if the first one fails.
    fn converge(&mut self, sample: &Sample, started: Instant, tolerance: f64, most: usize) -> bool {
        for iteration in 0..most {
            if iteration > 0 && self.follower.guard.late(2 * started.elapsed()) {
                break;
            }
            if !self.solve(sample, started) {
                return iteration > 0;
            }
            let small = self.shooting.step_size() < tolerance;
            if small {
                return self.shooting.take_full_step();
            }
            let Follower {
                needle, tracker, ..
            } = &self.follower;
            if !self.shooting.search(needle, tracker) {
                break;
            }
        }
        true
    }
}

impl Controller for NmpcController {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        let started = Instant::now();
        self.statistics = SolverStatistics::default();
        let (input, origin) = self.decide(measurement, time_s, started);
        self.statistics.time = started.elapsed();
        ControlStep {
            input,
            origin,
            predicted: origin.ahead(&self.applied),
            statistics: self.statistics,
        }
    }

    fn applied(&mut self, input: Input) {
        self.follower.guard.hold(input);
    }

    fn reset(&mut self) {
        self.follower.reset();
        self.shooting.forget();
        self.planned = None;
    }
}
