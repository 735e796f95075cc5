//! Exact derivatives of the discrete step on SE(3), in left-invariant errors.
//!
//! With g = g_r exp(xi), a step of the same input gives xi+ = Ad(exp(-V dt)) xi without remainder,
//! and a change dV of the twist adds J_r(V dt) dV dt. Hence A and B below are the derivatives of
//! the discrete step itself, not of a discretised rate: equations (8) to (13) of the paper without
//! their errors. The derivative by curvature is what an estimator of curvature needs.

use nalgebra::{Matrix6, Matrix6x2, Vector6};

use crate::geometry::pose::Pose;
use crate::geometry::se3::{adjoint, right_jacobian};
use crate::plant::needle::{Input, Needle, StepError, check_step, finite};

/// Derivatives of one step in left-invariant errors (linear mm, angular rad) before and after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepJacobians {
    /// 6x6, by the error before the step: Ad(exp(-V dt)).
    pub a: Matrix6<f64>,
    /// 6x2, by (v in mm/s, omega in rad/s).
    pub b: Matrix6x2<f64>,
    /// 6, by the curvature in 1/mm.
    pub curvature: Vector6<f64>,
}

impl Needle {
    /// Derivatives of [`Needle::step`]. They do not depend on the pose: the error is left-invariant
    /// and so is the plant.
    ///
    /// # Errors
    /// [`StepError`] when the input is not finite, the time step is negative or not finite, or a
    /// derivative overflows.
    pub fn linearise(&self, input: Input, dt_s: f64) -> Result<StepJacobians, StepError> {
        check_step(true, input, dt_s)?;
        let xi = self.twist(input) * dt_s;
        let right = right_jacobian(&xi);
        // Columns of J_r dt times V1 = (e_z, kappa e_x), V2 = (0, e_z) and v (0, e_x).
        let about_x = right.column(3) * dt_s;
        let by_v = right.column(2) * dt_s + about_x * self.curvature_per_mm();
        let by_omega = right.column(5) * dt_s;
        let jacobians = StepJacobians {
            a: adjoint(&Pose::exp(&-xi)),
            b: Matrix6x2::from_columns(&[by_v, by_omega]),
            curvature: about_x * input.v_mm_s,
        };
        // A sum is finite when every term is, and one that overflows is of no use either.
        let sums = [
            jacobians.a.sum(),
            jacobians.b.sum(),
            jacobians.curvature.sum(),
        ];
        finite(jacobians, sums)
    }
}
