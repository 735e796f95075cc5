//! The pose g = (R, p) of a needle tip in SE(3): composition, exponential and logarithm.
//!
//! Twists are ordered (linear, angular), the linear part in mm and the angular part in rad. Source
//! of the closed forms: T. Barfoot, State Estimation for Robotics, chapter on matrix Lie groups.
//! What a twist does to the tip belongs to [`crate::Needle`], not here.

use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3, Vector6};

use crate::geometry::stumpff::Stumpff;

/// Pose of the needle tip: rotation from body to world, and tip position in the world.
///
/// Body z is the tip's tangent, body x the axis about which the bevel bends the path.
/// The rotation is a unit quaternion, so it stays a rotation however many steps are composed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation from body to world.
    pub rotation: UnitQuaternion<f64>,
    /// Tip position in the world frame, mm.
    pub position_mm: Vector3<f64>,
}

impl Pose {
    /// The world frame itself.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: UnitQuaternion::identity(),
            position_mm: Vector3::zeros(),
        }
    }

    /// Exponential map of a twist (linear mm, angular rad): the motion of a body that holds this
    /// body twist for one unit of time.
    #[must_use]
    pub fn exp(twist: &Vector6<f64>) -> Self {
        let (rho, phi) = split(twist);
        let squared_angle = phi.norm_squared();
        let half = Stumpff::at_squared_angle(0.25 * squared_angle);
        let imag = phi * (0.5 * half.c1);
        let c2 = 0.5 * half.c1 * half.c1;
        let c3 = Stumpff::at_squared_angle(squared_angle).c3;
        let cross = phi.cross(&rho);
        Self {
            rotation: UnitQuaternion::new_unchecked(Quaternion::from_parts(half.c0, imag)),
            position_mm: rho + cross * c2 + phi.cross(&cross) * c3,
        }
    }

    /// Logarithm: the twist (linear mm, angular rad) of least rotation whose exponential is this
    /// pose. The angle is in [0, pi]; at exactly pi the axis is one of two.
    #[must_use]
    pub fn log(&self) -> Vector6<f64> {
        let q = self.rotation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        let (w, imag) = (sign * q.w, q.imag() * sign);
        let sin_half = imag.norm();
        // atan2(s, w) / s tends to 1 / w; below 1e-6 the next term, s^2 / 3, is under rounding.
        let scale = if sin_half < 1e-6 {
            (1.0 - (sin_half / w).powi(2) / 3.0) / w
        } else {
            sin_half.atan2(w) / sin_half
        };
        let phi = imag * (2.0 * scale);
        let d = inverse_jacobian_coefficient(phi.norm_squared());
        let cross = phi.cross(&self.position_mm);
        let rho = self.position_mm - cross * 0.5 + phi.cross(&cross) * d;
        Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
    }

    /// `self * other`: `other` given in the frame of `self`.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        let q = self.rotation.quaternion() * other.rotation.quaternion();
        // One Newton step towards unit norm: products of quaternions drift only by rounding, and
        // this restores them to second order of that drift.
        let correction = 1.5 - 0.5 * q.norm_squared();
        Self {
            rotation: UnitQuaternion::new_unchecked(q * correction),
            position_mm: self.position_mm + self.rotation * other.position_mm,
        }
    }

    /// The inverse pose.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self {
            rotation,
            position_mm: -(rotation * self.position_mm),
        }
    }

    /// `other` as seen from `self`: inverse(self) * other.
    #[must_use]
    pub fn relative(&self, other: &Self) -> Self {
        let inverse = self.rotation.inverse();
        Self {
            rotation: inverse,
            position_mm: Vector3::zeros(),
        }
        .compose(&Self {
            rotation: other.rotation,
            position_mm: other.position_mm - self.position_mm,
        })
    }

    /// Left-invariant error xi = log(reference^-1 * self), (linear mm, angular rad) in the
    /// reference's body frame.
    #[must_use]
    pub fn error_from(&self, reference: &Self) -> Vector6<f64> {
        reference.relative(self).log()
    }

    /// `self * exp(xi)`: the pose whose left-invariant error from `self` is `xi`.
    #[must_use]
    pub fn perturbed(&self, xi: &Vector6<f64>) -> Self {
        self.compose(&Self::exp(xi))
    }

    /// Unit tangent of the path at the tip: body z in the world frame.
    #[must_use]
    pub fn tangent(&self) -> Vector3<f64> {
        self.rotation * Vector3::z()
    }

    /// Rotation as a 3x3 matrix, body to world.
    #[must_use]
    pub fn rotation_matrix(&self) -> Matrix3<f64> {
        self.rotation.to_rotation_matrix().into_inner()
    }

    /// Homogeneous 4x4 matrix, translation in mm.
    #[must_use]
    pub fn to_homogeneous(&self) -> Matrix4<f64> {
        let mut matrix = self.rotation.to_homogeneous();
        matrix
            .fixed_view_mut::<3, 1>(0, 3)
            .copy_from(&self.position_mm);
        matrix
    }

    /// Whether every coordinate is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        // A sum is NaN or infinite when a term is; coordinates near f64::MAX are no positions.
        (self.rotation.quaternion().coords.sum() + self.position_mm.sum()).is_finite()
    }
}

/// Linear and angular part of a twist.
pub(crate) fn split(twist: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (
        Vector3::new(twist[0], twist[1], twist[2]),
        Vector3::new(twist[3], twist[4], twist[5]),
    )
}

/// D(x) in J_l(phi)^-1 = I - phi^/2 + D(|phi|^2) phi^ phi^, that is
/// (1 - (theta/2) cot(theta/2)) / theta^2, regular at 0 and at pi.
pub(crate) fn inverse_jacobian_coefficient(squared_angle: f64) -> f64 {
    let half = Stumpff::at_squared_angle(0.25 * squared_angle);
    (half.c2 - half.c3) / (4.0 * half.c1)
}
