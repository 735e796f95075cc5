//! The plan of the nonlinear controller: poses and inputs over the horizon, not tied to each other while it is improved.

use needle_model::{Input, Needle, Pose};

/// Poses g_0..g_N and inputs u_0..u_{N-1}.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Plan {
    pub(crate) poses: Vec<Pose>,
    pub(crate) inputs: Vec<Input>,
}

impl Plan {
    pub(crate) fn at_rest(horizon: usize) -> Self {
        Self {
            poses: vec![Pose::identity(); horizon + 1],
            inputs: vec![Input::ZERO; horizon],
        }
    }

    /// Moves the plan rigidly so that it starts at `pose`.
    pub(crate) fn embed(&mut self, pose: &Pose) {
        let first = self.poses[0];
        for planned in &mut self.poses {
            *planned = pose.compose(&first.relative(planned));
        }
        self.poses[0] = *pose;
    }

    /// Drops the first `steps` stages; the last ones are left for the caller to fill. Returns the first of these.
    pub(crate) fn shift(&mut self, steps: usize) -> usize {
        let n = self.inputs.len();
        let steps = steps.min(n);
        self.poses.copy_within(steps.., 0);
        self.inputs.copy_within(steps.., 0);
        n - steps
    }

    /// Fills the plan from stage `first` on by simulation; an input that is not finite is rest.
    pub(crate) fn fill(
        &mut self,
        first: usize,
        needle: &Needle,
        dt_s: f64,
        mut input: impl FnMut(&Pose, usize) -> Input,
    ) {
        for k in first..self.inputs.len() {
            let pose = self.poses[k];
            let wanted = input(&pose, k);
            let (input, next) = match needle.step(&pose, wanted, dt_s) {
                Ok(next) => (wanted, next),
                Err(_) => (Input::ZERO, pose),
            };
            self.inputs[k] = input;
            self.poses[k + 1] = next;
        }
    }

    /// Copies another plan of the same horizon without allocating.
    pub(crate) fn overwrite(&mut self, source: &Self) {
        self.poses.copy_from_slice(&source.poses);
        self.inputs.copy_from_slice(&source.inputs);
    }

    pub(crate) fn is_finite(&self) -> bool {
        let sum: f64 = self.inputs.iter().map(|u| u.v_mm_s + u.omega_rad_s).sum();
        sum.is_finite() && self.poses.iter().all(Pose::is_finite)
    }
}
