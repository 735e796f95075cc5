//! Where on the path a controller is, and what lies ahead: poses, inputs and bending of the reference over the horizon.
//!
//! The path is sampled at the controller's own step from the present path time on, along the screw motion between its samples, and its inputs
//! are the means over such a step: so neither clock jitter nor another sample time of the path matters, and the step in which the path ends
//! asks for no more than what is left of it. Past the end the last pose repeats with zero input.

use crate::controller::StopReason;
use nalgebra::Vector3;
use needle_model::{Input, PathProgress, Pose, ReferencePath};

/// What fixes the present point of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tracking {
    /// The time since the first pose that was believed: the tip is to be at a place at a time. A robot that waits for its first image
    /// has lost nothing by it.
    #[default]
    Time,
    /// The nearest point of the path, never backwards: the tip is to be on the path, at the path's speed. A path that turns in
    /// place needs [`Tracking::Time`].
    Progress,
}

/// Samples ahead among which the nearest point is looked for, and time past the end after which the path counts as done.
const LOOKAHEAD: usize = 20;

/// Samples from which on a time without a measurement is a gap, in which the needle may have gone any way.
const GAP: f64 = 3.0;

/// Part of a sample that is rounding of a quotient of times.
const SAMPLE_ROUNDING: f64 = 1e-9;

/// Distance along the last tangent at which the end of the path counts as reached, mm.
const END_TOLERANCE_MM: f64 = 0.02;

/// A path with the present point on it.
#[derive(Debug, Clone)]
pub(crate) struct Tracker {
    path: ReferencePath,
    tracking: Tracking,
    progress: Option<PathProgress>,
    dt_s: f64,
    /// Whether the tip was seen.
    begun: bool,
    time_s: f64,
    finished: Option<StopReason>,
    /// Reference poses, N + 1.
    pub(crate) poses: Vec<Pose>,
    /// Reference inputs, N.
    pub(crate) inputs: Vec<Input>,
}

impl Tracker {
    /// At the start of `path`.
    pub(crate) fn new(path: ReferencePath, tracking: Tracking, dt_s: f64, horizon: usize) -> Self {
        Self {
            path,
            tracking,
            progress: None,
            dt_s,
            begun: false,
            time_s: 0.0,
            finished: None,
            poses: vec![Pose::identity(); horizon + 1],
            inputs: vec![Input::ZERO; horizon],
        }
    }

    /// The path.
    pub(crate) fn path(&self) -> &ReferencePath {
        &self.path
    }

    /// Time along the path, s.
    pub(crate) fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Index of the path's sample at or just before the present point.
    pub(crate) fn step(&self) -> usize {
        self.sample(self.time_s).0
    }

    /// Input of the reference one step before the present point; at the start of the path its first one.
    pub(crate) fn input_before(&self) -> Input {
        self.mean_input((self.time_s - self.dt_s).max(0.0))
    }

    /// Input of the reference just after the horizon.
    pub(crate) fn input_beyond(&self) -> Input {
        self.mean_input(self.time_s + self.inputs.len() as f64 * self.dt_s)
    }

    /// Steps from the horizon's end to the path's.
    pub(crate) fn stages_beyond(&self) -> f64 {
        let left_s = self.path.duration_s() - self.time_s;
        (left_s / self.dt_s - self.inputs.len() as f64).max(0.0)
    }

    /// Moves the present point and refills the horizon; `v_mm_s` was held for `elapsed_s`. Progress that is not seen is what the
    /// needle was told to travel, at the path's speed: none while it stands.
    pub(crate) fn advance(&mut self, elapsed_s: f64, v_mm_s: f64, pose: Option<&Pose>) {
        match (self.tracking, pose) {
            (Tracking::Progress, Some(pose)) => {
                let travelled_s = self.travelled_s(elapsed_s, v_mm_s);
                let travelled_s = match elapsed_s < GAP * self.dt_s {
                    true => travelled_s.unwrap_or(elapsed_s),
                    false => f64::INFINITY,
                };
                self.project(&pose.position_mm, travelled_s);
            }
            (Tracking::Progress, None) => {
                let travelled_s = self.travelled_s(elapsed_s, v_mm_s).unwrap_or(0.0);
                let last_s = self.path.duration_s().max(self.time_s);
                self.time_s = (self.time_s + travelled_s).min(last_s);
            }
            (Tracking::Time, _) if self.begun => {
                self.time_s = (self.time_s + elapsed_s).min(f64::MAX);
            }
            (Tracking::Time, _) => {}
        }
        self.begun |= pose.is_some();
        self.look_ahead();
    }

    /// Puts the present point at a time along the path and refills the horizon.
    pub(crate) fn place(&mut self, time_s: f64) {
        self.time_s = time_s;
        self.look_ahead();
    }

    fn look_ahead(&mut self) {
        for k in 0..self.poses.len() {
            let time_s = self.time_s + k as f64 * self.dt_s;
            let (step, fraction) = self.sample(time_s);
            self.poses[k] = match fraction > 0.0 {
                true => self.path.pose_at_time(time_s),
                false => self.path.poses()[step],
            };
            if k < self.inputs.len() {
                self.inputs[k] = self.mean_input(time_s);
            }
        }
    }

    /// Mean of the reference's inputs over a step from a time on; zero past the end.
    fn mean_input(&self, time_s: f64) -> Input {
        let samples = self.dt_s / self.path.dt_s();
        let (step, mut begun) = self.sample(time_s);
        let (mut mean, mut left) = (Input::ZERO, samples);
        for input in self.path.inputs().iter().skip(step) {
            let part = left.min(1.0 - begun);
            mean.v_mm_s += input.v_mm_s * part / samples;
            mean.omega_rad_s += input.omega_rad_s * part / samples;
            (left, begun) = (left - part, 0.0);
            if left < SAMPLE_ROUNDING {
                break;
            }
        }
        mean
    }

    /// Step at or before a time, and the fraction of the next one; a fraction of rounding is none.
    fn sample(&self, time_s: f64) -> (usize, f64) {
        let position = (time_s / self.path.dt_s()).max(0.0);
        let step = ((position + SAMPLE_ROUNDING) as usize).min(self.path.inputs().len());
        let beyond = position - step as f64;
        let fraction = if beyond < SAMPLE_ROUNDING || step == self.path.inputs().len() {
            0.0
        } else {
            beyond
        };
        (step, fraction)
    }

    /// Speed of the reference in a step, zero past its end.
    fn speed_mm_s(&self, step: usize) -> f64 {
        let input = self.path.inputs().get(step);
        input.map_or(0.0, |u| u.v_mm_s.abs())
    }

    /// Time along the path that the needle has travelled; `None` where the path turns in place.
    fn travelled_s(&self, elapsed_s: f64, v_mm_s: f64) -> Option<f64> {
        let speed_mm_s = self.speed_mm_s(self.step());
        (speed_mm_s > 0.0).then(|| (v_mm_s / speed_mm_s * elapsed_s).max(0.0))
    }

    /// Moves to the nearest point. A tip that seems to be farther ahead than the needle can have come by more than a sample is followed
    /// at twice its pace: one glitch within the gate must not cost the rest of the path. At first, and after a gap, it is believed.
    fn project(&mut self, position_mm: &Vector3<f64>, travelled_s: f64) {
        let path = &self.path;
        let most_s = match self.progress {
            Some(_) => self.time_s + travelled_s + self.dt_s,
            None => f64::INFINITY,
        };
        let mut progress = self
            .progress
            .unwrap_or_else(|| PathProgress::acquired(path, position_mm, LOOKAHEAD));
        let step = progress.advance(path, position_mm);
        // The nearest sample is within half a step of the nearest point: correct along the tangent.
        let nearest = &path.poses()[step];
        let ahead_mm = (position_mm - nearest.position_mm).dot(&nearest.tangent());
        let speed_mm_s = self.speed_mm_s(if ahead_mm < 0.0 {
            step.saturating_sub(1)
        } else {
            step
        });
        let correction_s = if speed_mm_s > 0.0 {
            (ahead_mm / speed_mm_s).clamp(-path.dt_s(), path.dt_s())
        } else {
            0.0
        };
        let found_s = (step as f64 * path.dt_s() + correction_s).min(path.duration_s());
        if found_s <= most_s {
            self.progress = Some(progress);
        }
        self.time_s = self.time_s.max(found_s.min(most_s));
    }

    /// Why nothing more is to be done, once the tip has come to the end of the path or the path's time is over for good. The first
    /// reason stands.
    pub(crate) fn finished(&mut self, pose: Option<&Pose>) -> Option<StopReason> {
        let patience_s = LOOKAHEAD as f64 * self.dt_s;
        let over =
            self.tracking == Tracking::Time && self.time_s > self.path.duration_s() + patience_s;
        if self.finished.is_none() {
            self.finished = match self.reached(pose) {
                true => Some(StopReason::PathEnd),
                false => over.then_some(StopReason::OutOfTime),
            };
        }
        self.finished
    }

    fn reached(&self, pose: Option<&Pose>) -> bool {
        // Only near the end in time: a path may pass the plane of its last pose before.
        let near_s = self.path.duration_s() - 1.5 * self.dt_s;
        let (Some(end), Some(pose)) = (self.path.poses().last(), pose) else {
            return false;
        };
        let ahead_mm = (end.position_mm - pose.position_mm).dot(&end.tangent());
        self.time_s >= near_s && ahead_mm <= END_TOLERANCE_MM
    }

    /// Wanted change of the tangent by arc length between reference poses `k` and `k + 1`, 1/mm, in the world.
    pub(crate) fn bending_per_mm(&self, k: usize) -> Vector3<f64> {
        let k = k.min(self.inputs.len().saturating_sub(1));
        let (here, next) = (&self.poses[k], &self.poses[k + 1]);
        let length_mm = (next.position_mm - here.position_mm).norm();
        if length_mm > 1e-9 {
            (next.tangent() - here.tangent()) / length_mm
        } else {
            Vector3::zeros()
        }
    }

    /// As newly made.
    pub(crate) fn reset(&mut self) {
        self.progress = None;
        self.begun = false;
        self.time_s = 0.0;
        self.finished = None;
    }
}
