//! What the terminal set says of the tip's position: for pictures and monitors, not for the controller itself.

use super::Ingredients;
use crate::tracking::Tracker;
use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};
use needle_model::Pose;

/// The positions that the terminal set allows for the horizon's last pose: { centre + half_axes d : |d| <= 1 }, to first order in the
/// error. Directions that the controller's model leaves out have length zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerminalRegion {
    /// The reference's position at the horizon's end, mm.
    pub centre_mm: Vector3<f64>,
    /// Its half-axes as columns in the world frame, 3 x 3, mm.
    pub half_axes_mm: Matrix3<f64>,
}

impl TerminalRegion {
    /// The region at the end of the horizon that the tracker holds; row i of the ingredients belongs to `coordinates[i]` of the error.
    pub(crate) fn at_horizon_end(
        tracker: &Tracker,
        ingredients: &Ingredients,
        coordinates: &[usize],
    ) -> Option<Self> {
        let end = ingredients.at(tracker.step() + tracker.inputs.len());
        Self::of_set(end.p, end.level?, coordinates, tracker.poses.last()?)
    }

    /// Projection of { x : x'Px <= level } onto the position error: { d : d'S^-1 d <= level } with S the block of P^-1.
    ///
    /// `coordinates[i]` is the coordinate of the error in the body frame of `reference` that row i of P belongs to; rows beyond are
    /// other states. `None` where P is not positive definite or the set has no interior or no bound.
    fn of_set(
        p: &DMatrix<f64>,
        level: f64,
        coordinates: &[usize],
        reference: &Pose,
    ) -> Option<Self> {
        let inverse = p.clone().cholesky()?.inverse();
        let linear = || (0..coordinates.len()).filter(|&i| coordinates[i] < 3);
        let mut shape = Matrix3::zeros();
        for i in linear() {
            for j in linear() {
                shape[(coordinates[i], coordinates[j])] = level * inverse[(i, j)];
            }
        }
        let usable = level > 0.0 && shape.iter().all(|x| x.is_finite());
        let eigen = usable.then(|| SymmetricEigen::new(shape))?;
        let lengths = eigen.eigenvalues.map(|square| square.max(0.0).sqrt());
        let rotation = reference.rotation.to_rotation_matrix();
        Some(Self {
            centre_mm: reference.position_mm,
            half_axes_mm: rotation * eigen.eigenvectors * Matrix3::from_diagonal(&lengths),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DVector, UnitQuaternion};

    fn turned() -> Pose {
        Pose {
            position_mm: Vector3::new(1.0, 2.0, 3.0),
            rotation: UnitQuaternion::from_euler_angles(0.3, -0.8, 1.1),
        }
    }

    /// The support function of a projection is that of the set: the largest n'd over the set, by a dense sample of its boundary.
    #[test]
    fn region_is_the_projection_of_the_set() {
        let mut p = DMatrix::from_fn(8, 8, |i, j| ((i * 7 + j * 3) as f64 * 0.7).sin());
        p = &p * p.transpose() + DMatrix::identity(8, 8);
        let (level, reference) = (2.5, turned());
        let region = TerminalRegion::of_set(&p, level, &[0, 1, 2, 3, 4, 5], &reference).unwrap();
        let factor = p.clone().cholesky().unwrap();
        let direction = Vector3::new(0.2, -0.5, 0.9);
        // max f x over x'Px <= c is attained at x = P^-1 f sqrt(c / f'P^-1 f).
        let body = reference.rotation.inverse() * direction;
        let f = DVector::from_fn(8, |i, _| if i < 3 { body[i] } else { 0.0 });
        let x = factor.solve(&f) * (level / f.dot(&factor.solve(&f))).sqrt();
        let reach = (region.half_axes_mm.transpose() * direction).norm();
        // Rounding of 8 x 8 factorisations.
        assert!((reach - f.dot(&x)).abs() < 1e-10 * reach);
        assert_eq!(region.centre_mm, reference.position_mm);
    }

    #[test]
    fn depth_alone_makes_a_line_along_the_tangent() {
        let p = DMatrix::from_diagonal(&DVector::from_vec(vec![4.0, 1.0, 1.0, 1.0]));
        let region = TerminalRegion::of_set(&p, 1.0, &[2, 5], &turned()).unwrap();
        let shape = region.half_axes_mm * region.half_axes_mm.transpose();
        let tangent = turned().tangent();
        // Half a millimetre of depth; rounding of a product of rotations.
        assert!((shape - tangent * tangent.transpose() * 0.25).norm() < 1e-14);
    }

    #[test]
    fn a_set_without_interior_or_bound_has_no_region() {
        let p = DMatrix::identity(4, 4);
        for level in [0.0, f64::NAN, f64::INFINITY, -1.0] {
            assert_eq!(TerminalRegion::of_set(&p, level, &[2, 5], &turned()), None);
        }
        assert_eq!(TerminalRegion::of_set(&-p, 1.0, &[2, 5], &turned()), None);
    }
}
