//! Residuals that optimal control and estimation put to zero, each with its exact Jacobian.
//!
//! Every Jacobian is by the right perturbation of a pose, g exp(delta) with delta = (linear mm,
//! angular rad): the same coordinates as [`crate::StepJacobians`], so that the blocks of a stage
//! fit together without conversion.

use nalgebra::{Matrix3x6, Matrix6, Matrix6x2, Vector3, Vector6};

use crate::geometry::pose::Pose;
use crate::geometry::se3::{adjoint, block_upper_product, hat, left_jacobian_inverse};
use crate::plant::needle::{Input, Needle, StepError, finite};

/// Residual log(target^-1 f(pose, input)) of one step, and its Jacobians.
///
/// For a multiple-shooting method this is the defect between a predicted and a planned pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepResidual {
    /// 6 (mm, rad), in the frame of the target.
    pub value: Vector6<f64>,
    /// 6x6, by the perturbation of the pose before the step.
    pub by_pose: Matrix6<f64>,
    /// 6x2, by (v in mm/s, omega in rad/s).
    pub by_input: Matrix6x2<f64>,
    /// 6x6, by the perturbation of the target.
    pub by_target: Matrix6<f64>,
    /// 6, by the curvature in 1/mm.
    pub by_curvature: Vector6<f64>,
}

/// Residual log(reference^-1 pose) and its Jacobians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseResidual {
    /// 6 (mm, rad), in the frame of the reference.
    pub value: Vector6<f64>,
    /// 6x6, by the perturbation of the pose: J_r(value)^-1.
    pub by_pose: Matrix6<f64>,
    /// 6x6, by the perturbation of the reference: -J_l(value)^-1.
    pub by_reference: Matrix6<f64>,
}

/// A residual in world coordinates (position in mm, or the unit tangent) and its Jacobian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointResidual {
    /// 3: mm for a position, no unit for a tangent.
    pub value: Vector3<f64>,
    /// 3x6, by the perturbation of the pose.
    pub by_pose: Matrix3x6<f64>,
}

/// The linearised step to the next pose: delta_{k+1} = a delta_k + b delta_u + c, with
/// perturbations of the poses of an iterate. This is the form that stage-wise solvers take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearisedStep {
    /// 6x6.
    pub a: Matrix6<f64>,
    /// 6x2, by (v in mm/s, omega in rad/s).
    pub b: Matrix6x2<f64>,
    /// 6 (mm, rad): the defect of the iterate.
    pub c: Vector6<f64>,
}

impl StepResidual {
    /// The step as a map of perturbations: target exp(delta_{k+1}) is where the perturbed step ends.
    ///
    /// delta_{k+1} = log(target^-1 f(pose exp(delta_k), input + delta_u)) is the residual itself as a
    /// function of pose and input, so its derivatives are `by_pose` and `by_input`, exact to first
    /// order at a defect of any size. (Putting the *linearised* residual to zero by `by_target` would
    /// give J_l(value) in front of both, which agrees only when the defect vanishes.)
    #[must_use]
    pub fn solved_for_target(&self) -> LinearisedStep {
        LinearisedStep {
            a: self.by_pose,
            b: self.by_input,
            c: self.value,
        }
    }
}

impl Needle {
    /// Residual of a step against a planned pose `target`.
    ///
    /// # Errors
    /// [`StepError`] when a pose or the input is not finite, the time step is negative, or something
    /// overflows.
    pub fn step_residual(
        &self,
        pose: &Pose,
        input: Input,
        target: &Pose,
        dt_s: f64,
    ) -> Result<StepResidual, StepError> {
        let predicted = self.step(pose, input, dt_s)?;
        let jacobians = self.linearise(input, dt_s)?;
        let PoseResidual {
            value,
            by_pose: outer,
            by_reference: by_target,
        } = pose_residual(&predicted, target)?;
        let residual = StepResidual {
            value,
            by_pose: block_upper_product(&outer, &jacobians.a),
            by_input: outer * jacobians.b,
            by_target,
            by_curvature: outer * jacobians.curvature,
        };
        let sums = [
            residual.by_pose.sum(),
            residual.by_input.sum(),
            residual.by_curvature.sum(),
        ];
        finite(residual, sums)
    }
}

/// Residual of a pose against a reference pose.
///
/// # Errors
/// [`StepError::NonFiniteState`] when one of them is not finite, [`StepError::Overflow`] when they are
/// too far apart to compare.
pub fn pose_residual(pose: &Pose, reference: &Pose) -> Result<PoseResidual, StepError> {
    if !(pose.is_finite() && reference.is_finite()) {
        return Err(StepError::NonFiniteState);
    }
    let relative = reference.relative(pose);
    let value = relative.log();
    let left_inverse = left_jacobian_inverse(&value);
    let residual = PoseResidual {
        value,
        // J_r(xi)^-1 = J_l(xi)^-1 Ad(exp xi): one Jacobian serves both.
        by_pose: block_upper_product(&left_inverse, &adjoint(&relative)),
        by_reference: -left_inverse,
    };
    let sums = [value.sum(), residual.by_pose.sum(), left_inverse.sum()];
    finite(residual, sums)
}

/// Residual position - target, mm, in the world frame.
#[must_use]
pub fn position_residual(pose: &Pose, target_mm: &Vector3<f64>) -> PointResidual {
    let mut by_pose = Matrix3x6::zeros();
    by_pose
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&pose.rotation_matrix());
    PointResidual {
        value: pose.position_mm - target_mm,
        by_pose,
    }
}

/// Residual tangent - target of the tip's unit tangent, in the world frame. Roll does not enter.
#[must_use]
pub fn tangent_residual(pose: &Pose, target: &Vector3<f64>) -> PointResidual {
    let r = pose.rotation_matrix();
    let mut by_pose = Matrix3x6::zeros();
    by_pose
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(-(r * hat(&Vector3::z()))));
    PointResidual {
        value: pose.tangent() - target,
        by_pose,
    }
}
