//! What keeps a predictive controller alive: a clock that tolerates clocks, a gate for measurements, and the last good plan.
//!
//! Every input leaves through [`Guard::apply`], which brings it into the limits, rates included, whatever asked for it. A step
//! without a usable answer takes the plan of an earlier step, shifted by the time that has passed, while it is young enough;
//! then the needle is brought to rest.

use crate::configuration::{ConfigurationError, count, positive};
use crate::controller::{Measurement, Origin, StopReason};
use crate::limits::InputLimits;
use crate::sample_clock::SampleClock;
use nalgebra::UnitQuaternion;
use needle_model::{Input, Needle, Pose};
use std::time::{Duration, Instant};

/// When a controller no longer trusts the clock, a measurement, or a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Survival {
    /// Wall time that a step may take; a later answer is not applied. `None` for no deadline.
    pub deadline: Option<Duration>,
    /// Oldest plan that may stand in for a failed step, in samples. A gap of the clock counts as one sample more at most: by then the
    /// needle was to be brought to rest.
    pub max_plan_age: usize,
    /// Distance from the expected position, at first the start of the path, beyond which a measurement is an outlier, mm. Samples that
    /// are missing are no outliers: they widen the gate by what the needle can travel meanwhile.
    pub max_jump_mm: f64,
    /// Outliers without a credible measurement between them after which the next one is believed.
    pub max_outliers: usize,
}

impl Default for Survival {
    /// No deadline, plans of at most 10 samples, jumps of at most 10 mm, 10 outliers in a row.
    fn default() -> Self {
        Self {
            deadline: None,
            max_plan_age: 10,
            max_jump_mm: 10.0,
            max_outliers: 10,
        }
    }
}

impl Survival {
    pub(crate) fn validate(&self) -> Result<(), ConfigurationError> {
        count("survival.max_plan_age", self.max_plan_age, MOST_STAGES)?;
        count("survival.max_outliers", self.max_outliers, MOST_STAGES)?;
        positive("survival.max_jump_mm", self.max_jump_mm)
    }
}

/// Longest horizon, and oldest plan, that a configuration may ask for.
pub(crate) const MOST_STAGES: usize = 10_000;

/// A sample after the clock and the gate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Time since the sample before; the nominal step where the clock tells nothing. Zero at the first sample.
    pub(crate) elapsed_s: f64,
    /// Time for which rate limits may be used up: the shorter of elapsed time and nominal step.
    pub(crate) reach_s: f64,
    /// The pose to act on, if one is to be believed.
    pub(crate) pose: Option<Pose>,
}

/// Memory of one controller's survival.
#[derive(Debug, Clone)]
pub(crate) struct Guard {
    survival: Survival,
    limits: InputLimits,
    dt_s: f64,
    previous: Input,
    clock: SampleClock,
    start: Pose,
    expected: Option<Pose>,
    /// Poses refused since the last one that was believed.
    refused: usize,
    /// Time of the samples without a pose since then.
    blind_s: f64,
    /// Inputs of a plan that are kept, at most; a copy of an empty vector would have forgotten its capacity.
    room: usize,
    plan: Vec<Input>,
    plan_age_s: f64,
}

impl Guard {
    /// At rest at `start`, without a plan; `horizon` inputs at most will be kept.
    pub(crate) fn new(
        survival: Survival,
        limits: InputLimits,
        dt_s: f64,
        horizon: usize,
        start: Pose,
    ) -> Self {
        Self {
            survival,
            limits,
            dt_s,
            start,
            previous: Input::ZERO,
            clock: SampleClock::new(dt_s, None),
            expected: Some(start),
            refused: 0,
            blind_s: 0.0,
            room: horizon,
            plan: Vec::with_capacity(horizon),
            plan_age_s: 0.0,
        }
    }

    /// The input applied last.
    pub(crate) fn previous(&self) -> Input {
        self.previous
    }

    /// Takes an input for the one applied last.
    pub(crate) fn hold(&mut self, input: Input) {
        self.previous = self.limits.held(input, self.previous);
    }

    /// Passes a measurement through the clock and the gate.
    pub(crate) fn accept(
        &mut self,
        needle: &Needle,
        measurement: &Measurement,
        time_s: f64,
    ) -> Sample {
        let (elapsed_s, reach_s) = self.tick(time_s);
        self.plan_age_s += elapsed_s;
        self.expected = self
            .expected
            .and_then(|pose| needle.step(&pose, self.previous, elapsed_s).ok());
        let measured = measurement.pose.and_then(normalised);
        let pose = measured.filter(|pose| self.believes(pose));
        match (measured, pose) {
            (_, Some(_)) => {
                (self.refused, self.blind_s) = (0, 0.0);
                self.expected = pose;
            }
            (Some(_), None) => self.refused = self.refused.saturating_add(1),
            (None, None) => self.blind_s += elapsed_s,
        }
        Sample {
            elapsed_s,
            reach_s,
            pose,
        }
    }

    /// Time since the last sample, zero at the first, and the time for which rate limits may be used up.
    fn tick(&mut self, time_s: f64) -> (f64, f64) {
        let first = self.clock.is_fresh();
        // A clock that is set forward by a minute is no minute of insertion: beyond the oldest plan all gaps are alike.
        let longest_s = (self.survival.max_plan_age + 1) as f64 * self.dt_s;
        let elapsed_s = self.clock.tick(time_s).min(longest_s);
        let reach_s = elapsed_s.min(self.dt_s);
        (if first { 0.0 } else { elapsed_s }, reach_s)
    }

    fn believes(&self, pose: &Pose) -> bool {
        // No gap times no limit of speed is no number.
        let strayed_mm = match self.blind_s > 0.0 {
            true => self.limits.v_max_mm_s.max(-self.limits.v_min_mm_s) * self.blind_s,
            false => 0.0,
        };
        self.refused >= self.survival.max_outliers
            || self.expected.is_none_or(|expected| {
                let jump_mm = (pose.position_mm - expected.position_mm).norm();
                jump_mm <= self.survival.max_jump_mm + strayed_mm
            })
    }

    /// Brings an input into the limits and remembers it as applied.
    pub(crate) fn apply(&mut self, wanted: Input, sample: &Sample) -> Input {
        self.previous = self
            .limits
            .admissible(wanted, self.previous, sample.reach_s);
        self.previous
    }

    /// Keeps a plan whose first input belongs to this sample.
    pub(crate) fn keep(&mut self, plan: impl Iterator<Item = Input>) {
        self.plan.clear();
        self.plan.reserve(self.room);
        self.plan.extend(plan.take(self.room));
        self.plan_age_s = 0.0;
    }

    /// The shifted plan if it is young enough, or the way to rest for `reason`.
    pub(crate) fn fall_back(&mut self, sample: &Sample, reason: StopReason) -> (Input, Origin) {
        let age = ((self.plan_age_s / self.dt_s).round() as usize).max(1);
        match self.plan.get(age) {
            Some(&planned) if age <= self.survival.max_plan_age => {
                (self.apply(planned, sample), Origin::ShiftedPlan { age })
            }
            _ => self.stop(sample, reason),
        }
    }

    /// Forgets the plan and brings the needle to rest.
    pub(crate) fn stop(&mut self, sample: &Sample, reason: StopReason) -> (Input, Origin) {
        self.plan.clear();
        (self.apply(Input::ZERO, sample), Origin::Stop { reason })
    }

    /// As newly made.
    pub(crate) fn reset(&mut self) {
        self.previous = Input::ZERO;
        self.clock = SampleClock::new(self.dt_s, None);
        self.expected = Some(self.start);
        (self.refused, self.blind_s) = (0, 0.0);
        self.plan.clear();
        self.plan_age_s = 0.0;
    }

    /// What is left of the deadline of a step that began at `started`; `None` without a deadline.
    pub(crate) fn remaining(&self, started: Instant) -> Option<Duration> {
        let deadline = self.survival.deadline?;
        Some(deadline.saturating_sub(started.elapsed()))
    }

    /// True once a step that began `spent` ago is late.
    pub(crate) fn late(&self, spent: Duration) -> bool {
        self.survival
            .deadline
            .is_some_and(|deadline| spent > deadline)
    }
}

/// Largest estimate of curvature that is believed, as a multiple of the model's.
const MOST_CURVATURE: f64 = 10.0;

/// The needle of an estimated curvature; `None` where there is no estimate, or one that is no needle like the model.
pub(crate) fn estimated_needle(model: &Needle, measurement: &Measurement) -> Option<Needle> {
    measurement
        .curvature_per_mm
        .filter(|estimate| *estimate <= MOST_CURVATURE * model.curvature_per_mm())
        .and_then(|estimate| Needle::new(estimate).ok())
}

/// The pose with a unit quaternion; `None` where a coordinate is not finite or the rotation is none.
pub(crate) fn normalised(pose: Pose) -> Option<Pose> {
    let rotation = UnitQuaternion::try_new(pose.rotation.into_inner(), 1e-6)?;
    let pose = Pose { rotation, ..pose };
    pose.is_finite().then_some(pose)
}
