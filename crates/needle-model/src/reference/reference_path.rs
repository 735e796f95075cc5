//! The path to follow, as a needle executes it: poses at a fixed time step, the inputs that lead from
//! each to the next, and the arc length. Positions alone become such a path through
//! [`crate::PositionCurve`]; this file only stores, rolls out and interpolates.

use nalgebra::Vector6;
use thiserror::Error;

use crate::geometry::pose::Pose;
use crate::plant::needle::{Input, Needle, StepError, check_step};

/// Poses g_0 .. g_n, inputs u_0 .. u_{n-1} with u_k held from g_k to g_{k+1}, and arc lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePath {
    poses: Vec<Pose>,
    inputs: Vec<Input>,
    arc_length_mm: Vec<f64>,
    /// For each pose, the last of the run of poses at its position: turns in place and pauses.
    run_ends: Vec<usize>,
    dt_s: f64,
}

/// Poses that are nearer than this to the first of their run are at the same position, mm: far below
/// what an insertion advances in a step, far above rounding.
const SAME_POSITION_MM: f64 = 1e-6;

/// Fraction of a time step by which a time may be early for its step: rounding of k dt.
const EARLY_FRACTION: f64 = 1e-9;

/// Why samples make no path.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ReferencePathError {
    /// A path needs one pose more than inputs, and at least one pose.
    #[error("expected {expected} inputs for the poses, found {found}")]
    InputCount {
        /// Number of poses less one.
        expected: usize,
        /// Number of inputs.
        found: usize,
    },
    /// No pose at all.
    #[error("a reference path needs at least one pose")]
    Empty,
    /// The time step is zero.
    #[error("the time step of a path must be positive")]
    ZeroTimeStep,
    /// A sample is not finite, or the time step is invalid.
    #[error("sample {sample}: {source}")]
    Sample {
        /// Index of the pose or input.
        sample: usize,
        /// What is wrong with it.
        source: StepError,
    },
}

impl ReferencePath {
    /// The path that `needle` follows from `start` under `inputs`, each held for `dt_s`.
    ///
    /// # Errors
    /// [`ReferencePathError`] naming the first sample that is not finite.
    pub fn from_inputs(
        needle: Needle,
        start: Pose,
        inputs: Vec<Input>,
        dt_s: f64,
    ) -> Result<Self, ReferencePathError> {
        let mut poses = Vec::with_capacity(inputs.len() + 1);
        let mut pose = start;
        poses.push(pose);
        for (sample, &input) in inputs.iter().enumerate() {
            pose = needle
                .step(&pose, input, dt_s)
                .map_err(|source| ReferencePathError::Sample { sample, source })?;
            poses.push(pose);
        }
        Self::from_samples(poses, inputs, dt_s)
    }

    /// A path from poses and inputs as they are; they need not obey any needle's kinematics:
    /// [`ReferencePath::largest_defect`] says how far they do.
    ///
    /// # Errors
    /// [`ReferencePathError`] when counts disagree or a sample is not finite.
    pub fn from_samples(
        poses: Vec<Pose>,
        inputs: Vec<Input>,
        dt_s: f64,
    ) -> Result<Self, ReferencePathError> {
        let expected = poses
            .len()
            .checked_sub(1)
            .ok_or(ReferencePathError::Empty)?;
        if inputs.len() != expected {
            return Err(ReferencePathError::InputCount {
                expected,
                found: inputs.len(),
            });
        }
        if dt_s == 0.0 {
            return Err(ReferencePathError::ZeroTimeStep);
        }
        let mut arc_length_mm = Vec::with_capacity(poses.len());
        let mut s_mm = 0.0;
        for (sample, pose) in poses.iter().enumerate() {
            let input = inputs.get(sample).copied().unwrap_or(Input::ZERO);
            check_step(pose.is_finite(), input, dt_s)
                .map_err(|source| ReferencePathError::Sample { sample, source })?;
            arc_length_mm.push(s_mm);
            s_mm += input.v_mm_s.abs() * dt_s;
            if !(s_mm + (sample + 1) as f64 * dt_s).is_finite() {
                let source = StepError::Overflow;
                return Err(ReferencePathError::Sample { sample, source });
            }
        }
        Ok(Self {
            run_ends: run_ends(&poses),
            poses,
            inputs,
            arc_length_mm,
            dt_s,
        })
    }

    /// A path through poses, with the inputs read off the motion between neighbours: v from the
    /// displacement along the tangent, omega from the turn about it. Exact when a needle executed
    /// the poses and turned by less than half a turn a step (poses do not count whole turns);
    /// [`ReferencePath::largest_defect`] tells.
    ///
    /// # Errors
    /// As [`ReferencePath::from_samples`], naming the pose that is not finite, or the first of two
    /// poses whose motion overflows.
    pub fn from_poses(poses: Vec<Pose>, dt_s: f64) -> Result<Self, ReferencePathError> {
        if dt_s == 0.0 {
            return Err(ReferencePathError::ZeroTimeStep);
        }
        // Before the inputs: these would blame the pose ahead of the one that is not finite.
        if let Some(sample) = poses.iter().position(|pose| !pose.is_finite()) {
            let source = StepError::NonFiniteState;
            return Err(ReferencePathError::Sample { sample, source });
        }
        let inputs = poses
            .windows(2)
            .map(|pair| {
                let xi = pair[1].error_from(&pair[0]) / dt_s;
                Input {
                    v_mm_s: xi[2],
                    omega_rad_s: xi[5],
                }
            })
            .collect();
        Self::from_samples(poses, inputs, dt_s)
    }

    /// Poses, one more than inputs.
    #[must_use]
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Inputs; input k leads from pose k to pose k + 1.
    #[must_use]
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// Arc length at each pose, mm: the sum of |v| dt up to it.
    #[must_use]
    pub fn arc_length_mm(&self) -> &[f64] {
        &self.arc_length_mm
    }

    /// Time step, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        self.dt_s
    }

    /// Time at the last pose, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.inputs.len() as f64 * self.dt_s
    }

    /// Step nearest to a time, within the path.
    #[must_use]
    pub fn step_at_time(&self, time_s: f64) -> usize {
        // The cast saturates: negative times and NaN give 0.
        ((time_s / self.dt_s).round() as usize).min(self.inputs.len())
    }

    /// Input held at a time in s; zero before the path begins and from its end on.
    #[must_use]
    pub fn input_at_time(&self, time_s: f64) -> Input {
        let position = time_s / self.dt_s + EARLY_FRACTION;
        let held = (position >= 0.0).then(|| self.inputs.get(position as usize));
        held.flatten().copied().unwrap_or(Input::ZERO)
    }

    /// Last step of the run of poses that share the position of step `k` (turns in place, pauses).
    pub(crate) fn last_step_at_same_position(&self, k: usize) -> usize {
        self.run_ends[k]
    }

    /// Pose at a time in s, along the screw motion between neighbours; the ends beyond.
    #[must_use]
    pub fn pose_at_time(&self, time_s: f64) -> Pose {
        let position = (time_s / self.dt_s).max(0.0);
        let k = (position as usize).min(self.inputs.len());
        match self.poses.get(k + 1) {
            Some(next) => {
                let xi = next.error_from(&self.poses[k]);
                self.poses[k].perturbed(&(xi * (position - k as f64)))
            }
            None => self.poses[k],
        }
    }

    /// The step residual of largest norm (mm and rad alike) if `needle` were to execute the path, and
    /// its step; `None` for a path of one pose.
    ///
    /// # Errors
    /// [`StepError`], which no path built by this type causes.
    pub fn largest_defect(
        &self,
        needle: Needle,
    ) -> Result<Option<(usize, Vector6<f64>)>, StepError> {
        let mut largest: Option<(usize, Vector6<f64>)> = None;
        for (k, &input) in self.inputs.iter().enumerate() {
            let predicted = needle.step(&self.poses[k], input, self.dt_s)?;
            let defect = predicted.error_from(&self.poses[k + 1]);
            if largest.is_none_or(|(_, d)| defect.norm() > d.norm()) {
                largest = Some((k, defect));
            }
        }
        Ok(largest)
    }
}

/// For each pose, the index of the last one of its run at one position.
fn run_ends(poses: &[Pose]) -> Vec<usize> {
    let mut ends = Vec::with_capacity(poses.len());
    let mut start = 0;
    for k in 1..=poses.len() {
        // Measured from the run's first pose: a slow drift is not one long turn.
        let same =
            |pose: &Pose| (pose.position_mm - poses[start].position_mm).norm() < SAME_POSITION_MM;
        if !poses.get(k).is_some_and(same) {
            ends.resize(k, k - 1);
            start = k;
        }
    }
    ends
}
