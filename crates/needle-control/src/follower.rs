//! What every predictive controller does before it plans: the clock, the gate for measurements, the present point of the path,
//! and the samples at which there is nothing to plan.

use crate::controller::{Measurement, Origin, StopReason};
use crate::limits::InputLimits;
use crate::survival::{Guard, Sample, Survival, estimated_needle};
use crate::tracking::{Tracker, Tracking};
use needle_model::{Input, Needle, Pose, ReferencePath};

/// Relative difference of curvature that is worth another reference: less moves the needle by micrometres along 100 mm.
const NOTICEABLE: f64 = 1e-3;

/// What every predictive controller is told of its task beside needle and path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pursuit {
    pub(crate) horizon: usize,
    pub(crate) dt_s: f64,
    pub(crate) limits: InputLimits,
    pub(crate) tracking: Tracking,
    pub(crate) survival: Survival,
}

/// Follows a path with one needle.
#[derive(Debug, Clone)]
pub(crate) struct Follower {
    model: Needle,
    /// The needle of the last estimate of curvature, else the model.
    pub(crate) needle: Needle,
    pub(crate) tracker: Tracker,
    pub(crate) guard: Guard,
}

impl Follower {
    /// At the start of the path, at rest.
    pub(crate) fn new(model: Needle, path: ReferencePath, pursuit: Pursuit) -> Self {
        let Pursuit {
            horizon,
            dt_s,
            limits,
            tracking,
            survival,
        } = pursuit;
        let start = path.poses().first().copied().unwrap_or_else(Pose::identity);
        Self {
            model,
            needle: model,
            tracker: Tracker::new(path, tracking, dt_s, horizon),
            guard: Guard::new(survival, limits, dt_s, horizon, start),
        }
    }

    /// Whether the estimated curvature is noticeably another than the model's.
    pub(crate) fn needle_differs(&self) -> bool {
        let (estimate, model) = (
            self.needle.curvature_per_mm(),
            self.model.curvature_per_mm(),
        );
        (estimate - model).abs() > NOTICEABLE * model
    }

    /// Takes in a measurement and moves the present point of the path.
    pub(crate) fn observe(&mut self, measurement: &Measurement, time_s: f64) -> Sample {
        if let Some(needle) = estimated_needle(&self.model, measurement) {
            self.needle = needle;
        }
        let sample = self.guard.accept(&self.needle, measurement, time_s);
        let held = self.guard.previous();
        self.tracker
            .advance(sample.elapsed_s, held.v_mm_s, sample.pose.as_ref());
        sample
    }

    /// The input of a sample without need or ground for a new plan: the end of the path or of its time, or no measurement.
    pub(crate) fn without_plan(&mut self, sample: &Sample) -> Option<(Input, Origin)> {
        if let Some(reason) = self.tracker.finished(sample.pose.as_ref()) {
            return Some(self.guard.stop(sample, reason));
        }
        match sample.pose {
            Some(_) => None,
            None => Some(self.guard.fall_back(sample, StopReason::NoMeasurement)),
        }
    }

    /// As newly made.
    pub(crate) fn reset(&mut self) {
        self.needle = self.model;
        self.tracker.reset();
        self.guard.reset();
    }
}
