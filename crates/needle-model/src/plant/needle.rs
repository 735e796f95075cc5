//! The needle, its inputs, and one exact step: g(t + dt) = g(t) exp(V dt) with body twist
//! V = [0, 0, v, kappa v, 0, omega], equations (2) and (3) of the paper.
//!
//! Exact for inputs held over dt; torsion, bevel offset and varying curvature are added by
//! [`crate::PhysicalNeedle`].

use nalgebra::Vector6;
use thiserror::Error;

use crate::geometry::pose::Pose;

/// Inputs held over one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Input {
    /// Insertion speed along the tip's tangent, mm/s. Negative retracts.
    pub v_mm_s: f64,
    /// Rotation speed about the tip's tangent, rad/s.
    pub omega_rad_s: f64,
}

impl Input {
    /// Needle at rest.
    pub const ZERO: Self = Self {
        v_mm_s: 0.0,
        omega_rad_s: 0.0,
    };

    fn is_finite(&self) -> bool {
        self.v_mm_s.is_finite() && self.omega_rad_s.is_finite()
    }
}

/// A curvature that no needle has.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("needle curvature must be finite and not negative, found {curvature_per_mm} per mm")]
pub struct InvalidCurvature {
    /// The curvature that was refused, 1/mm.
    pub curvature_per_mm: f64,
}

/// Why a step was refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum StepError {
    /// A coordinate of the pose or state is NaN or infinite.
    #[error("the state has a coordinate that is not finite")]
    NonFiniteState,
    /// An input is NaN or infinite.
    #[error("input is not finite: v = {v_mm_s} mm/s, omega = {omega_rad_s} rad/s")]
    NonFiniteInput {
        /// Insertion speed found, mm/s.
        v_mm_s: f64,
        /// Rotation speed found, rad/s.
        omega_rad_s: f64,
    },
    /// The time step is NaN, infinite or negative.
    #[error("time step must be finite and not negative, found {dt_s} s")]
    InvalidTimeStep {
        /// Time step found, s.
        dt_s: f64,
    },
    /// Everything was finite, but the result is not: speeds or coordinates too large to compute with.
    #[error("the values are finite, but the result overflows double precision")]
    Overflow,
}

/// `value` when all of its entries are finite.
pub(crate) fn finite<T>(value: T, entries: impl IntoIterator<Item = f64>) -> Result<T, StepError> {
    if entries.into_iter().all(f64::is_finite) {
        Ok(value)
    } else {
        Err(StepError::Overflow)
    }
}

/// Checks what every step of every plant requires of its inputs.
pub(crate) fn check_step(state_is_finite: bool, input: Input, dt_s: f64) -> Result<(), StepError> {
    if !state_is_finite {
        Err(StepError::NonFiniteState)
    } else if !input.is_finite() {
        Err(StepError::NonFiniteInput {
            v_mm_s: input.v_mm_s,
            omega_rad_s: input.omega_rad_s,
        })
    } else if !(dt_s.is_finite() && dt_s >= 0.0) {
        Err(StepError::InvalidTimeStep { dt_s })
    } else {
        Ok(())
    }
}

/// A bevel-tip needle: a tip that follows an arc of constant curvature about its body x axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Needle {
    curvature_per_mm: f64,
}

impl Needle {
    /// A needle of curvature `curvature_per_mm`; zero is a straight needle.
    ///
    /// # Errors
    /// [`InvalidCurvature`] when it is negative, NaN or infinite.
    pub fn new(curvature_per_mm: f64) -> Result<Self, InvalidCurvature> {
        if curvature_per_mm.is_finite() && curvature_per_mm >= 0.0 {
            Ok(Self { curvature_per_mm })
        } else {
            Err(InvalidCurvature { curvature_per_mm })
        }
    }

    /// Curvature of the path without rotation, 1/mm.
    #[must_use]
    pub fn curvature_per_mm(&self) -> f64 {
        self.curvature_per_mm
    }

    /// Body twist V = [0, 0, v, kappa v, 0, omega] per second, equations (2) and (3).
    #[must_use]
    pub fn twist(&self, input: Input) -> Vector6<f64> {
        let v = input.v_mm_s;
        Vector6::new(
            0.0,
            0.0,
            v,
            self.curvature_per_mm * v,
            0.0,
            input.omega_rad_s,
        )
    }

    /// Pose after `input` is held for `dt_s`, exact.
    ///
    /// # Errors
    /// [`StepError`] when the pose or the input is not finite, the time step is negative, or the
    /// motion overflows.
    pub fn step(&self, pose: &Pose, input: Input, dt_s: f64) -> Result<Pose, StepError> {
        check_step(pose.is_finite(), input, dt_s)?;
        let next = pose.compose(&Pose::exp(&(self.twist(input) * dt_s)));
        if next.is_finite() {
            Ok(next)
        } else {
            Err(StepError::Overflow)
        }
    }
}
