//! Tangent-space operators of SE(3): ad, Ad, and the left and right Jacobians of the exponential
//! with their inverses, all in closed form and all in (linear, angular) order.
//!
//! Source: T. Barfoot, State Estimation for Robotics, sections on the SE(3) Jacobian; rewritten
//! with Stumpff functions so that small angles need no special case.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::geometry::pose::{Pose, inverse_jacobian_coefficient, split};
use crate::geometry::stumpff::Stumpff;

/// w^: the matrix with `hat(w) * x = w.cross(x)`.
#[must_use]
pub fn hat(w: &Vector3<f64>) -> Matrix3<f64> {
    w.cross_matrix()
}

/// ad of a twist (v, w): [[w^, v^], [0, w^]], 6x6.
#[must_use]
pub fn ad(twist: &Vector6<f64>) -> Matrix6<f64> {
    let (v, w) = split(twist);
    block_upper(&hat(&w), &hat(&v))
}

/// Ad of a pose (R, p): [[R, p^ R], [0, R]], 6x6.
#[must_use]
pub fn adjoint(pose: &Pose) -> Matrix6<f64> {
    let r = pose.rotation_matrix();
    block_upper(&r, &(hat(&pose.position_mm) * r))
}

/// Left Jacobian: exp(xi + d) = exp(J_l(xi) d) exp(xi) to first order in d.
///
/// J_l(xi) is also the integral of exp(s ad_xi) over s from 0 to 1.
#[must_use]
pub fn left_jacobian(xi: &Vector6<f64>) -> Matrix6<f64> {
    let (rho, phi) = split(xi);
    let c = Stumpff::at_squared_angle(phi.norm_squared());
    let f = hat(&phi);
    let j = Matrix3::identity() + f * c.c2 + f * f * c.c3;
    block_upper(&j, &coupling(&rho, &phi, &c))
}

/// Upper right block Q of the left Jacobian. The products of rho^ and phi^ are written out, with s = rho . phi:
/// phi^ rho^ phi^ = -s phi^, and phi^ phi^ rho^ + rho^ phi^ phi^ = -|phi|^2 rho^ - s phi^.
fn coupling(rho: &Vector3<f64>, phi: &Vector3<f64>, c: &Stumpff) -> Matrix3<f64> {
    let s = rho.dot(phi);
    let outer = rho * phi.transpose();
    // C_2 = 1/2 - |phi|^2 C_4.
    let mut q =
        hat(&(rho * c.c2 + phi * (s * (2.0 * c.c4 - c.c3)))) + (outer + outer.transpose()) * c.c3;
    q -= phi * phi.transpose() * (s * (c.c4 - 3.0 * c.c5));
    let diagonal = s * (phi.norm_squared() * (c.c4 - 3.0 * c.c5) - 2.0 * c.c3);
    q + Matrix3::from_diagonal_element(diagonal)
}

/// Right Jacobian: exp(xi + d) = exp(xi) exp(J_r(xi) d) to first order in d; J_r(xi) = J_l(-xi).
#[must_use]
pub fn right_jacobian(xi: &Vector6<f64>) -> Matrix6<f64> {
    left_jacobian(&-xi)
}

/// Inverse of [`left_jacobian`]. Rotations below 2 pi only, which every logarithm satisfies.
#[must_use]
pub fn left_jacobian_inverse(xi: &Vector6<f64>) -> Matrix6<f64> {
    let (rho, phi) = split(xi);
    let squared_angle = phi.norm_squared();
    let f = hat(&phi);
    let j_inverse =
        Matrix3::identity() - f * 0.5 + f * f * inverse_jacobian_coefficient(squared_angle);
    let q = coupling(&rho, &phi, &Stumpff::at_squared_angle(squared_angle));
    block_upper(&j_inverse, &-(j_inverse * q * j_inverse))
}

/// Inverse of [`right_jacobian`]; rotations below 2 pi.
#[must_use]
pub fn right_jacobian_inverse(xi: &Vector6<f64>) -> Matrix6<f64> {
    left_jacobian_inverse(&-xi)
}

/// Product of two matrices of the form [[diagonal, upper], [0, diagonal]], which has that form again.
pub(crate) fn block_upper_product(left: &Matrix6<f64>, right: &Matrix6<f64>) -> Matrix6<f64> {
    let blocks = |m: &Matrix6<f64>| -> (Matrix3<f64>, Matrix3<f64>) {
        (
            m.fixed_view::<3, 3>(0, 0).into_owned(),
            m.fixed_view::<3, 3>(0, 3).into_owned(),
        )
    };
    let ((d, u), (e, v)) = (blocks(left), blocks(right));
    block_upper(&(d * e), &(d * v + u * e))
}

/// [[diagonal, upper], [0, diagonal]].
fn block_upper(diagonal: &Matrix3<f64>, upper: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(diagonal);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(diagonal);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(upper);
    m
}
