//! Time-varying LQR around a reference that the needle can execute: u = u_r + K_k log(g_r^-1 g), saturated.
//!
//! The gains come from the backward Riccati chain of `lqr` on the exact derivatives of the discrete step. It is a law
//! for small errors: limits enter only as saturation. Where the reference does not obey the needle's kinematics
//! ([`needle_model::ReferencePath::largest_defect`]) or is close to planar, the linear model has no answer to the
//! drift and the law is poor; design of the reference is then the cure, not the weights.

use crate::baseline::law::{PathSample, SteeringLaw};
use crate::baseline::settings::{BaselineError, all_positive};
use faer::Mat;
use lqr::{BackwardChain, Stage};
use nalgebra::{SMatrix, Vector2, Vector6};
use needle_model::{Input, Needle, ReferencePath, StepJacobians};

/// Weights of [`TimeVaryingLqr`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LqrWeights {
    /// Weights of the squared error (linear per mm^2, angular per rad^2) in each sample.
    pub error: Vector6<f64>,
    /// Weights of the squared deviations of (v per (mm/s)^2, omega per (rad/s)^2) in each sample.
    pub input: Vector2<f64>,
    /// Factor of the error's weights at the last pose.
    pub terminal: f64,
}

impl Default for LqrWeights {
    /// The best of the study in `docs/baselines.md`.
    fn default() -> Self {
        Self {
            error: Vector6::new(1.0, 1.0, 1.0, 1000.0, 1000.0, 0.1),
            input: Vector2::new(0.1, 0.01),
            terminal: 10.0,
        }
    }
}

/// The law: one gain a step of the reference.
#[derive(Debug, Clone)]
pub struct TimeVaryingLqr {
    /// 2x6: inputs (v, omega) by errors (linear mm, angular rad).
    gains: Vec<SMatrix<f64, 2, 6>>,
    /// Sample time that they are for, s.
    dt_s: f64,
}

/// Relative difference of sample times that is rounding.
const SAME_TIME: f64 = 1e-9;

impl TimeVaryingLqr {
    /// Gains along `path` for `needle`, for a loop at the path's own sample time. Cost and memory are linear in the length of the path.
    ///
    /// # Errors
    /// [`BaselineError`]: a weight that is not positive, or a chain without answer, with its step.
    pub fn new(
        path: &ReferencePath,
        needle: Needle,
        weights: LqrWeights,
    ) -> Result<Self, BaselineError> {
        for weight in weights.error.iter().chain(weights.input.iter()) {
            all_positive(&[("weight", *weight)])?;
        }
        all_positive(&[("terminal", weights.terminal)])?;
        let dt_s = path.dt_s();
        if path.inputs().is_empty() {
            let gains = Vec::new();
            return Ok(Self { gains, dt_s });
        }
        let mut models = Vec::with_capacity(path.inputs().len());
        for (step, &input) in path.inputs().iter().enumerate() {
            let StepJacobians { a, b, .. } = needle
                .linearise(input, dt_s)
                .map_err(|source| BaselineError::Linearisation { step, source })?;
            models.push((
                Mat::from_fn(6, 6, |i, j| a[(i, j)]),
                Mat::from_fn(6, 2, |i, j| b[(i, j)]),
            ));
        }
        let q = Mat::from_fn(6, 6, |i, j| if i == j { weights.error[i] } else { 0.0 });
        let r = Mat::from_fn(2, 2, |i, j| if i == j { weights.input[i] } else { 0.0 });
        let terminal = Mat::from_fn(6, 6, |i, j| weights.terminal * q[(i, j)]);
        let stages: Vec<Stage<'_>> = models
            .iter()
            .map(|(a, b)| Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref()))
            .collect();
        let chain = BackwardChain::solve(&stages, terminal.as_ref())?;
        let gains = chain
            .k
            .iter()
            .map(|k| SMatrix::from_fn(|i, j| k[(i, j)]))
            .collect();
        Ok(Self { gains, dt_s })
    }
}

impl SteeringLaw for TimeVaryingLqr {
    fn wanted(&mut self, sample: &PathSample<'_>) -> Input {
        let reference = sample.reference_input();
        // At the last pose there is no step any more.
        let Some(gain) = self.gains.get(sample.step).or(self.gains.last()) else {
            return reference;
        };
        let error = sample.pose.error_from(&sample.path.poses()[sample.step]);
        let correction = gain * error;
        Input {
            v_mm_s: reference.v_mm_s + correction[0],
            omega_rad_s: reference.omega_rad_s + correction[1],
        }
    }

    fn fits(&self, path: &ReferencePath, dt_s: f64) -> Result<(), BaselineError> {
        let (expected, found) = (self.gains.len(), path.inputs().len());
        if expected != found {
            return Err(BaselineError::OtherPath { expected, found });
        }
        for found in [path.dt_s(), dt_s] {
            let expected = self.dt_s;
            if (found - expected).abs() > SAME_TIME * expected {
                return Err(BaselineError::OtherSampleTime { expected, found });
            }
        }
        Ok(())
    }

    fn reset(&mut self) {}
}
