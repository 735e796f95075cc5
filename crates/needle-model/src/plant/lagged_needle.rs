//! Needle with a first-order torsional lag and unknown curvature, as an estimator sees it: the step
//! of (pose, curvature, lag) and its exact 8x8 and 8x2 derivatives.
//!
//! The tip turns at the mean rate of the step; the true rate decays exponentially within it. The
//! difference to a finer integration is of second order in dt.

use nalgebra::{SMatrix, Vector6};

use crate::geometry::pose::Pose;
use crate::plant::needle::{Input, Needle, StepError, check_step, finite};
use crate::plant::torsion::{Torsion, TorsionalLag};

/// Pose with the two slow unknowns of a real needle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedState {
    /// Pose of the tip.
    pub pose: Pose,
    /// The needle, whose curvature is constant over a step.
    pub needle: Needle,
    /// Base roll minus tip roll, rad.
    pub lag_rad: f64,
}

/// Derivatives of a step in the order (left-invariant error 6, curvature in 1/mm, lag in rad).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedJacobians {
    /// 8x8, by the state.
    pub a: SMatrix<f64, 8, 8>,
    /// 8x2, by (v in mm/s, omega of the base in rad/s).
    pub b: SMatrix<f64, 8, 2>,
}

impl LaggedState {
    /// State after `input`, given at the base, is held for `dt_s`.
    ///
    /// # Errors
    /// [`StepError`] when state or input is not finite, or the time step is negative.
    pub fn step(&self, torsion: TorsionalLag, input: Input, dt_s: f64) -> Result<Self, StepError> {
        let (tip_input, lag_rad) = self.tip_input(torsion, input, dt_s)?;
        Ok(Self {
            pose: self.needle.step(&self.pose, tip_input, dt_s)?,
            lag_rad,
            ..*self
        })
    }

    /// Derivatives of [`LaggedState::step`].
    ///
    /// # Errors
    /// As [`LaggedState::step`].
    pub fn linearise(
        &self,
        torsion: TorsionalLag,
        input: Input,
        dt_s: f64,
    ) -> Result<LaggedJacobians, StepError> {
        let (tip_input, _) = self.tip_input(torsion, input, dt_s)?;
        let rigid = self.needle.linearise(tip_input, dt_s)?;
        let (decay, gain_s) = torsion.discretised(dt_s);
        // Tip rotation = omega dt + lag - lag+; its rate is what the rigid step takes.
        let by_tip_rotation: Vector6<f64> = if dt_s > 0.0 {
            rigid.b.column(1) / dt_s
        } else {
            Vector6::zeros()
        };
        let mut a = SMatrix::<f64, 8, 8>::identity();
        a.fixed_view_mut::<6, 6>(0, 0).copy_from(&rigid.a);
        a.fixed_view_mut::<6, 1>(0, 6).copy_from(&rigid.curvature);
        a.fixed_view_mut::<6, 1>(0, 7)
            .copy_from(&(by_tip_rotation * (1.0 - decay)));
        a[(7, 7)] = decay;
        let mut b = SMatrix::<f64, 8, 2>::zeros();
        b.fixed_view_mut::<6, 1>(0, 0).copy_from(&rigid.b.column(0));
        b.fixed_view_mut::<6, 1>(0, 1)
            .copy_from(&(by_tip_rotation * (dt_s - gain_s)));
        b[(7, 1)] = gain_s;
        finite(LaggedJacobians { a, b }, [a.sum(), b.sum()])
    }

    /// Input at the tip (mean rotation speed over the step) and the lag after it.
    fn tip_input(
        &self,
        torsion: TorsionalLag,
        input: Input,
        dt_s: f64,
    ) -> Result<(Input, f64), StepError> {
        check_step(self.lag_rad.is_finite(), input, dt_s)?;
        if dt_s == 0.0 {
            return Ok((input, self.lag_rad));
        }
        // A first-order lag does not depend on the depth.
        let step = Torsion::FirstOrder(torsion).advance(self.lag_rad, input.omega_rad_s, 0.0, dt_s);
        let tip = Input {
            omega_rad_s: step.tip_rotation_rad / dt_s,
            ..input
        };
        finite((tip, step.lag_rad), [step.lag_rad])
    }
}
