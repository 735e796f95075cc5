//! The reference under an estimated curvature: what a needle of that curvature would do along the path.
//!
//! Reference inputs belong to one curvature. A needle that bends otherwise must spend its turns otherwise, by roll errors of a radian and
//! more, of which a linearisation about the reference says nothing. So from the first estimate that differs from the model the linear
//! controller follows a nominal needle: it has the estimated curvature, starts on the reference and is steered along it by the nonlinear
//! program (the nominal system of tube MPC; Mayne, Kerrigan, van Wyk and Falugi, 2011). Its plan stands in for the reference over the
//! horizon. It is drawn to the measured needle slowly: what was lost before the estimate was right is won back by the nonlinear plan.

use super::configuration::LinearConfiguration;
use crate::configuration::ConfigurationError;
use crate::controller::{Controller, SolverStatistics};
use crate::nmpc::{Known, NmpcConfiguration, NmpcController, SpinTarget};
use crate::survival::{Sample, Survival};
use crate::terminal::TerminalChoice;
use crate::tracking::{Tracker, Tracking};
use needle_model::{Input, Needle, Pose, ReferencePath};
use std::time::Instant;

/// Time constant with which the nominal needle is drawn to the measured one, s. Never, the error that a filter's first doubts leave
/// stays for the rest of the path (0.33 mm for a needle that bends 20 % less); a tenth of a second would leave nothing to linear control.
const DRAWN_S: f64 = 0.3;

/// The nominal needle and its plan.
#[derive(Debug, Clone)]
pub(super) struct Nominal {
    planner: NmpcController,
    dt_s: f64,
    max_plan_age: usize,
    /// Time along the path of the plan; `None` before there is one.
    planned_s: Option<f64>,
    /// Samples since the program last had an answer.
    age: usize,
    /// Poses from the nominal needle's own on, and its inputs, over the planner's horizon.
    poses: Vec<Pose>,
    inputs: Vec<Input>,
}

impl Nominal {
    /// For a needle along `path`, not yet needed.
    pub(super) fn new(
        needle: Needle,
        path: &ReferencePath,
        configuration: &LinearConfiguration,
    ) -> Result<Self, ConfigurationError> {
        let LinearConfiguration {
            dt_s,
            limits,
            corridor_mm,
            survival,
            ..
        } = *configuration;
        let usual = NmpcConfiguration::default();
        // A shorter plan sees too little of the path to spend turns well.
        let horizon = configuration.horizon.max(usual.horizon);
        let planning = NmpcConfiguration {
            horizon,
            dt_s,
            limits,
            corridor_mm,
            survival: Survival {
                // The linear program needs the other half.
                deadline: survival.deadline.map(|deadline| deadline / 2),
                ..survival
            },
            spin_target: SpinTarget::Reference,
            terminal: TerminalChoice::None,
            tracking: Tracking::Time,
            ..usual
        };
        Ok(Self {
            planner: NmpcController::new(needle, path.clone(), planning)?,
            dt_s,
            max_plan_age: survival.max_plan_age,
            planned_s: None,
            age: 0,
            poses: vec![Pose::identity(); horizon + 1],
            inputs: vec![Input::ZERO; horizon],
        })
    }

    /// Whether the reference is the nominal needle's plan.
    pub(super) fn in_force(&self) -> bool {
        self.planned_s.is_some()
    }

    /// What the nonlinear program took for the present sample.
    pub(super) fn statistics(&self) -> SolverStatistics {
        self.planner.statistics()
    }

    /// Replaces the tracker's poses and inputs by those of a nominal needle of the estimated curvature; returns its input one step before.
    /// `None`, and nothing replaced, while no plan is to be had.
    pub(super) fn stand_in(
        &mut self,
        needle: &Needle,
        measured: &Pose,
        sample: &Sample,
        tracker: &mut Tracker,
        started: Instant,
    ) -> Option<Input> {
        let now_s = tracker.time_s();
        let elapsed_s = self.planned_s.map_or(0.0, |planned_s| now_s - planned_s);
        let held = match self.planned_s {
            None => {
                self.poses[0] = tracker.poses[0];
                tracker.input_before()
            }
            Some(_) => self.travel(needle, elapsed_s),
        };
        let drawn = 1.0 - (-sample.elapsed_s / DRAWN_S).exp();
        let behind = measured.error_from(&self.poses[0]);
        self.poses[0] = self.poses[0].perturbed(&(behind * drawn));
        let here = Known {
            needle: *needle,
            pose: self.poses[0],
            time_s: now_s,
            elapsed_s,
            held,
            reach_s: sample.reach_s,
        };
        match self.planner.plan_from(&here, started) {
            Some(planned) => {
                self.inputs.copy_from_slice(planned);
                self.age = 0;
            }
            None => self.age += 1,
        }
        let none_yet = self.planned_s.is_none() && self.age > 0;
        if none_yet || self.age > self.max_plan_age {
            (self.planned_s, self.age) = (None, 0);
            return None;
        }
        self.planned_s = Some(now_s);
        self.simulate(needle);
        let ahead = tracker.inputs.len();
        tracker.poses.copy_from_slice(&self.poses[..=ahead]);
        tracker.inputs.copy_from_slice(&self.inputs[..ahead]);
        Some(held)
    }

    /// Moves the nominal needle along its plan, whose last inputs repeat; returns the input that it held last.
    fn travel(&mut self, needle: &Needle, elapsed_s: f64) -> Input {
        let samples = (elapsed_s / self.dt_s + 1e-9).max(0.0);
        let last = self.inputs.len() - 1;
        // The cast saturates.
        let whole = (samples as usize).min(last);
        let rest_s = (samples - whole as f64).min(1.0) * self.dt_s;
        let held = if rest_s > 1e-6 * self.dt_s {
            whole
        } else {
            whole.saturating_sub(1)
        };
        let (here, held) = (self.poses[whole], self.inputs[held]);
        self.poses[0] = needle
            .step(&here, self.inputs[whole], rest_s)
            .unwrap_or(here);
        self.inputs.copy_within(whole.., 0);
        held
    }

    /// A needle of this curvature executes the plan exactly; an input that it cannot is rest.
    fn simulate(&mut self, needle: &Needle) {
        for k in 0..self.inputs.len() {
            let here = self.poses[k];
            self.poses[k + 1] = match needle.step(&here, self.inputs[k], self.dt_s) {
                Ok(next) => next,
                Err(_) => {
                    self.inputs[k] = Input::ZERO;
                    here
                }
            };
        }
    }

    /// As newly made.
    pub(super) fn reset(&mut self) {
        self.planner.reset();
        (self.planned_s, self.age) = (None, 0);
    }
}
