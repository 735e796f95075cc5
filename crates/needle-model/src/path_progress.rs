//! Progress along a path: the nearest point that never goes backwards, found by looking a bounded
//! number of samples ahead of the last one. A path that comes close to itself cannot make it jump.

use nalgebra::Vector3;

use crate::reference_path::ReferencePath;
use crate::reference_window::ReferenceWindow;

/// Tracks the nearest step of one path. The cost of a query is at most `lookahead` distances,
/// whatever the length of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathProgress {
    step: usize,
    lookahead: usize,
}

impl PathProgress {
    /// Starts at the path's first step. `lookahead` is how many samples the tip may advance between
    /// two queries; at least 1.
    #[must_use]
    pub fn from_start(lookahead: usize) -> Self {
        Self {
            step: 0,
            lookahead: lookahead.max(1),
        }
    }

    /// Starts at the nearest step of the whole path, the first if several are equally near.
    #[must_use]
    pub fn acquired(path: &ReferencePath, position_mm: &Vector3<f64>, lookahead: usize) -> Self {
        Self {
            step: nearest(path, position_mm, 0, path.poses().len()),
            lookahead: lookahead.max(1),
        }
    }

    /// Last step found.
    #[must_use]
    pub fn step(&self) -> usize {
        self.step
    }

    /// Advances to the nearest of the next samples and returns its step. It is never less than the
    /// last one; samples at equal distance (turning in place) do not advance it.
    pub fn advance(&mut self, path: &ReferencePath, position_mm: &Vector3<f64>) -> usize {
        let len = path.poses().len();
        let first = self.step.min(len - 1);
        let end = first.saturating_add(self.lookahead).saturating_add(1);
        self.step = nearest(path, position_mm, first, end.min(len));
        self.step
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
}

/// Nearest step in `first..end`, not empty; a position that is not a number leaves it at `first`.
fn nearest(path: &ReferencePath, position_mm: &Vector3<f64>, first: usize, end: usize) -> usize {
    let mut best = (first, f64::INFINITY);
    for (k, pose) in path.poses()[first..end].iter().enumerate() {
        let squared = (pose.position_mm - position_mm).norm_squared();
        if squared < best.1 {
            best = (first + k, squared);
        }
    }
    best.0
}
