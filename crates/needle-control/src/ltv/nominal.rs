//! The reference under an estimated curvature: what a needle of that curvature would do along the path.
//!
//! Reference inputs belong to one curvature. A needle that bends otherwise must spend its turns otherwise, by roll errors of a radian and
//! more, of which a linearisation about the reference says nothing. So from the first estimate that differs from the model the linear
//! controller follows a nominal needle: it has the estimated curvature, starts on the reference and is steered along it by the nonlinear
//! controller (the nominal system of tube MPC; Mayne, Kerrigan, van Wyk and Falugi, 2011). Its plan stands in for the reference over the
//! horizon. It is drawn to the measured needle slowly: what was lost before the estimate was right is won back by the nonlinear plan.

use super::configuration::LinearConfiguration;
use crate::configuration::ConfigurationError;
use crate::controller::{Controller, Measurement};
use crate::nmpc::{NmpcConfiguration, NmpcController, SpinTarget};
use crate::terminal::TerminalChoice;
use crate::tracking::{Tracker, Tracking};
use needle_model::{Input, Needle, Pose, ReferencePath};

/// Time constant with which the nominal needle is drawn to the measured one, s. Never, the error that a filter's first doubts leave
/// stays for the rest of the path (0.33 mm for a needle that bends 20 % less); a tenth of a second would leave nothing to linear control.
const DRAWN_S: f64 = 0.3;

/// The nominal needle and its plan.
#[derive(Debug, Clone)]
pub(super) struct Nominal {
    planner: NmpcController,
    dt_s: f64,
    /// Time along the path of the plan; `None` before there is one.
    planned_s: Option<f64>,
    /// Poses from the nominal needle's own on, N + 1.
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
            horizon,
            dt_s,
            limits,
            survival,
            ..
        } = *configuration;
        let planning = NmpcConfiguration {
            horizon,
            dt_s,
            limits,
            survival,
            spin_target: SpinTarget::Reference,
            terminal: TerminalChoice::None,
            // It is told the time along the path.
            tracking: Tracking::Time,
            ..NmpcConfiguration::default()
        };
        Ok(Self {
            planner: NmpcController::new(needle, path.clone(), planning)?,
            dt_s,
            planned_s: None,
            poses: vec![Pose::identity(); horizon + 1],
            inputs: vec![Input::ZERO; horizon],
        })
    }

    /// Whether the reference is the nominal needle's plan.
    pub(super) fn in_force(&self) -> bool {
        self.planned_s.is_some()
    }

    /// Replaces the tracker's poses and inputs by those of a nominal needle of the estimated curvature; returns its input one step before.
    pub(super) fn stand_in(
        &mut self,
        needle: &Needle,
        measured: &Pose,
        tracker: &mut Tracker,
    ) -> Input {
        let now_s = tracker.time_s();
        let before = match self.planned_s {
            None => {
                self.poses[0] = tracker.poses[0];
                tracker.input_before()
            }
            Some(planned_s) => self.travel(needle, now_s - planned_s),
        };
        if self.planned_s != Some(now_s) {
            let drawn = 1.0 - (-self.dt_s / DRAWN_S).exp();
            let behind = measured.error_from(&self.poses[0]);
            self.poses[0] = self.poses[0].perturbed(&(behind * drawn));
            self.plan(needle, now_s);
        }
        tracker.poses.copy_from_slice(&self.poses);
        tracker.inputs.copy_from_slice(&self.inputs);
        before
    }

    /// Moves the nominal needle along its plan; returns the input that it held last.
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
        let here = self.poses[whole];
        self.poses[0] = needle
            .step(&here, self.inputs[whole], rest_s)
            .unwrap_or(here);
        self.inputs[held]
    }

    /// Plans from the nominal needle's pose on; what the plan does not reach, it is at rest.
    fn plan(&mut self, needle: &Needle, now_s: f64) {
        self.planned_s = Some(now_s);
        let measured = Measurement {
            pose: Some(self.poses[0]),
            curvature_per_mm: Some(needle.curvature_per_mm()),
        };
        let planned = self.planner.step(&measured, now_s);
        let (first, predicted) = (planned.input, planned.predicted);
        for k in 0..self.inputs.len() {
            let link = match predicted.get(k..k + 2) {
                Some([here, next]) => here.relative(next).log() / self.dt_s,
                _ => Default::default(),
            };
            let input = match k {
                0 => first,
                _ => Input {
                    v_mm_s: link[2],
                    omega_rad_s: link[5],
                },
            };
            let here = self.poses[k];
            // Simulated: a needle of this curvature executes the plan exactly.
            (self.inputs[k], self.poses[k + 1]) = match needle.step(&here, input, self.dt_s) {
                Ok(next) => (input, next),
                Err(_) => (Input::ZERO, here),
            };
        }
    }

    /// As newly made.
    pub(super) fn reset(&mut self) {
        self.planner.reset();
        self.planned_s = None;
    }
}
