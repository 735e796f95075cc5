//! Progress along a path: the nearest point that never goes backwards, found by looking ahead of the
//! last one. A path that comes close to itself cannot make it jump.
//!
//! Positions do not tell the samples of a turn in place (or of a pause) apart. Such a run is a gate:
//! the search stops at its first sample, the run is gone through sample by sample, one a query or by
//! the tip's orientation, and only then does the search continue beyond it. So a path that orients the
//! needle first and inserts it then is followed in that order, whatever the noise of positions.

use nalgebra::Vector3;

use crate::geometry::pose::Pose;
use crate::reference::reference_path::ReferencePath;
use crate::reference::reference_window::ReferenceWindow;

/// Difference of |q . q'| below which two orientations are equally near: some roundings of 1.
const EQUAL_ORIENTATION: f64 = 1e-14;

/// Tracks the nearest step of one path. A query costs at most `lookahead` distances and as many as it
/// advances: O(1) amortised, whatever the length of the path and of its turns in place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathProgress {
    step: usize,
    lookahead: usize,
    /// Whether `step` answered a query already: only then does another one mean elapsed time.
    answered: bool,
}

impl PathProgress {
    /// Starts at the path's first step. `lookahead` is how many samples are looked at beyond the last
    /// step even though their distance increases; at least 1. Where it decreases, the search goes on.
    #[must_use]
    pub fn from_start(lookahead: usize) -> Self {
        Self::at(0, lookahead)
    }

    /// Starts at the nearest step of the whole path, the first if several are equally near.
    #[must_use]
    pub fn acquired(path: &ReferencePath, position_mm: &Vector3<f64>, lookahead: usize) -> Self {
        let mut best = (0, f64::INFINITY);
        for (k, pose) in path.poses().iter().enumerate() {
            let squared = (pose.position_mm - position_mm).norm_squared();
            if squared < best.1 {
                best = (k, squared);
            }
        }
        Self::at(best.0, lookahead)
    }

    fn at(step: usize, lookahead: usize) -> Self {
        Self {
            step,
            lookahead: lookahead.max(1),
            answered: false,
        }
    }

    /// Last step found.
    #[must_use]
    pub fn step(&self) -> usize {
        self.step
    }

    /// Advances to the nearest of the next samples and returns its step, never less than the last one.
    /// Within a turn in place each query advances by one sample: query once a time step of the path.
    /// A position that is not a number changes nothing.
    pub fn advance(&mut self, path: &ReferencePath, position_mm: &Vector3<f64>) -> usize {
        let elapsed = usize::from(self.answered);
        self.advance_within(path, position_mm, |first, last| (first + elapsed).min(last))
    }

    /// Like [`PathProgress::advance`], but within a turn in place the step follows the tip's
    /// orientation: it advances as long as the samples come nearer to it (a pause, where they are
    /// alike, is passed at once), and a tip that does not turn does not advance.
    pub fn advance_to_pose(&mut self, path: &ReferencePath, tip: &Pose) -> usize {
        let nearness = |k: usize| {
            let (a, b) = (path.poses()[k].rotation, tip.rotation);
            a.coords.dot(&b.coords).abs()
        };
        self.advance_within(path, &tip.position_mm, |first, last| {
            let mut step = first;
            while step < last && nearness(step + 1) >= nearness(step) - EQUAL_ORIENTATION {
                step += 1;
            }
            step
        })
    }

    /// Advances, and returns the window of `horizon` inputs from there.
    pub fn window(
        &mut self,
        path: &ReferencePath,
        position_mm: &Vector3<f64>,
        horizon: usize,
    ) -> ReferenceWindow {
        let step = self.advance(path, position_mm);
        path.window(step, horizon)
    }

    /// One query; `turned` moves within a turn in place from a sample to at most its last one.
    fn advance_within(
        &mut self,
        path: &ReferencePath,
        position_mm: &Vector3<f64>,
        turned: impl Fn(usize, usize) -> usize,
    ) -> usize {
        let first = self.step.min(path.poses().len() - 1);
        if !position_mm.iter().all(|x| x.is_finite()) {
            self.step = first;
            return first;
        }
        let run_end = path.last_step_at_same_position(first);
        self.step = if first < run_end {
            turned(first, run_end)
        } else {
            self.nearest_ahead(path, position_mm, first)
        };
        self.answered = true;
        self.step
    }

    /// Nearest step from `first` up to the lookahead, further while the distance decreases, and not
    /// beyond the first sample of a turn in place.
    fn nearest_ahead(
        &self,
        path: &ReferencePath,
        position_mm: &Vector3<f64>,
        first: usize,
    ) -> usize {
        let squared = |k: usize| (path.poses()[k].position_mm - position_mm).norm_squared();
        let mut best = (first, squared(first));
        for k in first + 1..path.poses().len() {
            let candidate = squared(k);
            if candidate < best.1 {
                best = (k, candidate);
            } else if k - first >= self.lookahead {
                break;
            }
            if path.last_step_at_same_position(k) > k {
                break;
            }
        }
        best.0
    }
}
