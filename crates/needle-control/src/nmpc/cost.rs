//! Stage cost of the nonlinear controller and its Gauss-Newton model in the right perturbation of the pose.
//!
//! ```text
//! l(g, u) = w_p |p - p_r|^2 + w_t |t - t_r|^2 + w_roll roll^2 + w_v (v - v_r)^2 + w_omega (omega - omega_r)^2
//! ```
//! with positions p, unit tangents t, and roll the twist about the tangent from reference to pose. With a weight on roll of
//! zero the reference needs no roll, and any curve in space is a reference. Near the reference, with equal weights, this is
//! the quadratic form diag(w_p, w_p, w_p, w_t, w_t, w_roll) of the left-invariant error.

use nalgebra::{Matrix6, Vector3, Vector6};
use needle_model::{Input, Pose};

/// Weights of the cost; zero leaves a term out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NmpcWeights {
    /// Of squared position error, 1/mm^2.
    pub position: f64,
    /// Of the squared error of the unit tangent.
    pub tangent: f64,
    /// Of squared roll error, 1/rad^2.
    pub roll: f64,
    /// Of the squared deviation from the reference's speed, s^2/mm^2.
    pub v: f64,
    /// Of the squared spin, s^2/rad^2.
    pub omega: f64,
    /// Of squared position error at the end of the horizon, 1/mm^2.
    pub end_position: f64,
    /// Of squared tangent error at the end of the horizon.
    pub end_tangent: f64,
    /// Of squared roll error at the end of the horizon, 1/rad^2.
    pub end_roll: f64,
}

impl Default for NmpcWeights {
    fn default() -> Self {
        Self {
            position: 1.0,
            tangent: 12.5,
            roll: 0.0,
            v: 1.0,
            omega: 5.0e-5,
            end_position: 0.25,
            end_tangent: 45.0,
            end_roll: 0.0,
        }
    }
}

/// Weights of one pose: position, tangent, roll.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PoseWeights {
    pub(crate) position: f64,
    /// Of twice the product of position and tangent error, 1/mm.
    pub(crate) cross: f64,
    pub(crate) tangent: f64,
    pub(crate) roll: f64,
}

impl NmpcWeights {
    pub(crate) fn running(&self) -> PoseWeights {
        PoseWeights {
            position: self.position,
            cross: 0.0,
            tangent: self.tangent,
            roll: self.roll,
        }
    }

    pub(crate) fn end(&self) -> PoseWeights {
        PoseWeights {
            position: self.end_position,
            cross: 0.0,
            tangent: self.end_tangent,
            roll: self.end_roll,
        }
    }

    /// Cost of an input against the wanted one.
    pub(crate) fn of_input(&self, input: Input, wanted: Input) -> f64 {
        self.v * (input.v_mm_s - wanted.v_mm_s).powi(2)
            + self.omega * (input.omega_rad_s - wanted.omega_rad_s).powi(2)
    }
}

impl PoseWeights {
    /// Cost of a pose.
    pub(crate) fn of_pose(&self, pose: &Pose, reference: &Pose) -> f64 {
        let position = pose.position_mm - reference.position_mm;
        let tangent = pose.tangent() - reference.tangent();
        let roll = match self.roll > 0.0 {
            true => roll_error(pose, reference).0,
            false => 0.0,
        };
        self.position * position.norm_squared()
            + 2.0 * self.cross * position.dot(&tangent)
            + self.tangent * tangent.norm_squared()
            + self.roll * roll * roll
    }

    /// Gradient and Gauss-Newton Hessian of *half* the cost by the perturbation of the pose.
    pub(crate) fn model(&self, pose: &Pose, reference: &Pose) -> (Vector6<f64>, Matrix6<f64>) {
        let to_body = pose.rotation.inverse();
        let position = to_body * (pose.position_mm - reference.position_mm);
        let tangent = Vector3::z() - to_body * reference.tangent();
        let pull = position * self.position + tangent * self.cross;
        let turn = position * self.cross + tangent * self.tangent;
        // A rotation theta moves the tangent by (theta_y, -theta_x, 0).
        let mut gradient = Vector6::new(pull.x, pull.y, pull.z, -turn.y, turn.x, 0.0);
        let mut hessian = Matrix6::from_diagonal(&Vector6::new(
            self.position,
            self.position,
            self.position,
            self.tangent,
            self.tangent,
            0.0,
        ));
        (hessian[(0, 4)], hessian[(4, 0)]) = (self.cross, self.cross);
        (hessian[(1, 3)], hessian[(3, 1)]) = (-self.cross, -self.cross);
        if self.roll > 0.0 {
            let (roll, by_pose) = roll_error(pose, reference);
            gradient += by_pose * (self.roll * roll);
            hessian += by_pose * by_pose.transpose() * self.roll;
        }
        (gradient, hessian)
    }
}

/// Twist about body z from the reference to the pose, rad in [-pi, pi], and its derivative by the perturbation of the pose.
fn roll_error(pose: &Pose, reference: &Pose) -> (f64, Vector6<f64>) {
    let q = (reference.rotation.inverse() * pose.rotation).into_inner();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let roll = 2.0 * (sign * q.k).atan2(sign * q.w);
    let size = q.w * q.w + q.k * q.k;
    let mut by_pose = Vector6::zeros();
    // At half a turn of the tangent the twist is undefined, and its derivative is left out.
    if size > 1e-12 {
        by_pose[3] = (q.k * q.i - q.w * q.j) / size;
        by_pose[4] = (q.w * q.i + q.k * q.j) / size;
        by_pose[5] = 1.0;
    }
    (roll, by_pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses() -> (Pose, Pose) {
        let reference = Pose::exp(&Vector6::new(1.0, -2.0, 3.0, 0.4, -0.2, 0.9));
        let pose = reference.perturbed(&Vector6::new(0.3, 0.2, -0.4, 0.3, -0.25, 0.8));
        (pose, reference)
    }

    #[test]
    fn gradient_is_the_derivative_of_the_cost() {
        let (pose, reference) = poses();
        let weights = PoseWeights {
            position: 1.3,
            cross: 3.1,
            tangent: 25.0,
            roll: 0.7,
        };
        let gradient = weights.model(&pose, &reference).0;
        let h = 1e-5;
        for i in 0..6 {
            let cost = |s: f64| weights.of_pose(&pose.perturbed(&Vector6::ith(i, s)), &reference);
            let slope = 0.5 * (cost(h) - cost(-h)) / (2.0 * h);
            // Central differences: h^2 times third derivatives of order 25.
            assert!(
                (gradient[i] - slope).abs() < 1e-7,
                "{i}: {} {slope}",
                gradient[i]
            );
        }
    }

    #[test]
    fn near_the_reference_the_cost_is_the_form_of_the_left_invariant_error() {
        let (_, reference) = poses();
        let weights = PoseWeights {
            position: 1.0,
            cross: 0.0,
            tangent: 10.0,
            roll: 2.0,
        };
        let xi = Vector6::new(1.0, -0.5, 0.7, 0.6, -0.8, 0.9) * 1e-4;
        let cost = weights.of_pose(&reference.perturbed(&xi), &reference);
        let form = xi[0].powi(2)
            + xi[1].powi(2)
            + xi[2].powi(2)
            + 10.0 * (xi[3].powi(2) + xi[4].powi(2))
            + 2.0 * xi[5].powi(2);
        // They differ by third order: 1e-4 of the form, times a constant of order one.
        assert!((cost - form).abs() < 1e-3 * form, "{cost} {form}");
    }
}
