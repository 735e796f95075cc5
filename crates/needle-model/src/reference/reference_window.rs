//! The part of a path that a controller with horizon N looks at: N + 1 poses and N inputs. Past the
//! end of the path the last pose repeats with zero input: the needle stops.

use crate::geometry::pose::Pose;
use crate::plant::needle::Input;
use crate::reference::reference_path::ReferencePath;

/// N + 1 reference poses and N reference inputs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceWindow {
    /// Step of the path at which the window starts.
    pub first_step: usize,
    /// Poses, N + 1.
    pub poses: Vec<Pose>,
    /// Inputs, N; input k leads from pose k to pose k + 1.
    pub inputs: Vec<Input>,
}

impl ReferenceWindow {
    /// Refills this window from `step` on: always `horizon` + 1 poses and `horizon` inputs, also beyond
    /// the path's end. Allocates only when the horizon grows; a stage takes 72 bytes, so the caller
    /// bounds a horizon that comes from outside.
    pub fn refill(&mut self, path: &ReferencePath, step: usize, horizon: usize) {
        let last = path.poses().len() - 1;
        self.first_step = step.min(last);
        self.poses.clear();
        self.inputs.clear();
        for ahead in 0..horizon {
            let k = step.saturating_add(ahead);
            self.poses.push(path.poses()[k.min(last)]);
            let input = path.inputs().get(k).copied();
            self.inputs.push(input.unwrap_or(Input::ZERO));
        }
        let end = step.saturating_add(horizon).min(last);
        self.poses.push(path.poses()[end]);
    }
}

impl ReferencePath {
    /// Window of `horizon` inputs from a step on.
    #[must_use]
    pub fn window(&self, step: usize, horizon: usize) -> ReferenceWindow {
        let mut window = ReferenceWindow::default();
        window.refill(self, step, horizon);
        window
    }

    /// Window of `horizon` inputs from the step nearest to a time on.
    #[must_use]
    pub fn window_at_time(&self, time_s: f64, horizon: usize) -> ReferenceWindow {
        self.window(self.step_at_time(time_s), horizon)
    }
}
