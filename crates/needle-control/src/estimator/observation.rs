//! What a sensor says of the tip, linearised at a belief, and what the filter made of it.
//!
//! Both residuals are taken in the body frame of the estimate, where the error is: r = R'(p - p^) for a position,
//! with r = I xi_linear to first order, and for a unit tangent t the rotation vector that takes the estimated tangent
//! to it, (-y, x) a / sin a of R't = (x, y, z) at the angle a between them: r = (xi_4, xi_5). Roll enters neither.

use crate::estimator::belief::ERROR_DIMENSION;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use needle_model::Pose;

/// One reading of one sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Observation {
    /// Position of the tip in the world frame, mm.
    Position(Vector3<f64>),
    /// Direction of the needle at the tip in the world frame; of any length but zero.
    Tangent(Vector3<f64>),
}

/// What the filter made of an observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// It corrected the estimate. The normalised innovation squared is chi-square distributed with 3 degrees of
    /// freedom for a position and 2 for a tangent when the filter is consistent.
    Accepted {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// It is beyond the gate and changed nothing.
    Outlier {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// A coordinate or the time is not a number, or a tangent has no direction.
    Unusable,
    /// It was taken before everything that the filter remembers.
    TooOld {
        /// Age, s.
        age_s: f64,
    },
    /// It was taken after the present sample.
    FromTheFuture {
        /// How much later, s.
        ahead_s: f64,
    },
}

/// Residual r, its Jacobian by the error and the variance of its noise: r = h x + noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Innovation<const D: usize> {
    pub(crate) residual: SVector<f64, D>,
    pub(crate) h: SMatrix<f64, D, ERROR_DIMENSION>,
    pub(crate) variance: f64,
}

impl Observation {
    /// With the tangent at unit length; `None` where it says nothing.
    pub(crate) fn normalised(self) -> Option<Self> {
        match self {
            Self::Position(p) => p.sum().is_finite().then_some(self),
            // By the largest entry first: squares of 1e200 overflow, those of 1e-200 vanish.
            Self::Tangent(t) => (t / t.amax())
                .try_normalize(f64::MIN_POSITIVE)
                .filter(|t| t.iter().all(|x| x.is_finite()))
                .map(Self::Tangent),
        }
    }
}

pub(crate) fn position_innovation(
    pose: &Pose,
    position_mm: &Vector3<f64>,
    std_mm: f64,
) -> Innovation<3> {
    let offset = position_mm - pose.position_mm;
    Innovation {
        residual: pose.rotation.inverse_transform_vector(&offset),
        h: SMatrix::identity(),
        variance: std_mm * std_mm,
    }
}

pub(crate) fn tangent_innovation(
    pose: &Pose,
    tangent: &Vector3<f64>,
    std_rad: f64,
) -> Innovation<2> {
    let seen = pose.rotation.inverse_transform_vector(tangent);
    let sine = seen.x.hypot(seen.y);
    // angle / sine tends to 1; a tangent straight behind turns about x, as well as about any other axis.
    let scaled = if sine > 1e-9 {
        Vector2::new(-seen.y, seen.x) * (sine.atan2(seen.z) / sine)
    } else if seen.z >= 0.0 {
        Vector2::new(-seen.y, seen.x)
    } else {
        Vector2::new(std::f64::consts::PI, 0.0)
    };
    let mut h = SMatrix::zeros();
    (h[(0, 3)], h[(1, 4)]) = (1.0, 1.0);
    Innovation {
        residual: scaled,
        h,
        variance: std_rad * std_rad,
    }
}

/// Bounds that the normalised innovation squared of a good observation exceeds with a given probability.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gates {
    /// Chi-square of 3 degrees of freedom.
    pub(crate) position: f64,
    /// Chi-square of 2 degrees of freedom.
    pub(crate) tangent: f64,
}

impl Gates {
    /// Two degrees of freedom in closed form; three by bisection of their tail, once for all.
    pub(crate) fn at(probability: f64) -> Self {
        let (mut low, mut high) = (0.0, LARGEST_GATE);
        for _ in 0..48 {
            let middle = 0.5 * (low + high);
            if tail_of_three(middle) > probability {
                low = middle;
            } else {
                high = middle;
            }
        }
        Self {
            position: 0.5 * (low + high),
            tangent: -2.0 * probability.ln(),
        }
    }
}

/// Beyond it a tail of three degrees of freedom is below the least number that is not zero.
const LARGEST_GATE: f64 = 1500.0;

/// Probability that |r|^2 > x for a standard normal r in three dimensions: the integral of sqrt(2 / pi) r^2 exp(-r^2
/// / 2) from sqrt(x) on, by Simpson's rule over a reach that leaves out less than 1e-17 of it.
fn tail_of_three(x: f64) -> f64 {
    const INTERVALS: usize = 400;
    const REACH: f64 = 10.0;
    let step = REACH / INTERVALS as f64;
    let density = |k: usize| {
        let r = x.sqrt() + step * k as f64;
        r * r * (-0.5 * r * r).exp()
    };
    let inner: f64 = (1..INTERVALS)
        .map(|k| density(k) * if k % 2 == 1 { 4.0 } else { 2.0 })
        .sum();
    (2.0 / std::f64::consts::PI).sqrt() * step / 3.0 * (density(0) + inner + density(INTERVALS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_of_any_length_have_a_direction() {
        for length in [1e-310, 1e-200, 1.0, 1e200, 1e308] {
            let seen = Observation::Tangent(Vector3::new(0.0, 0.0, -length)).normalised();
            assert_eq!(seen, Some(Observation::Tangent(-Vector3::z())), "{length}");
        }
        for nothing in [0.0, f64::NAN, f64::INFINITY] {
            let seen = Observation::Tangent(Vector3::new(0.0, nothing, 0.0)).normalised();
            assert_eq!(seen, None, "{nothing}");
        }
    }
    use nalgebra::Vector6;

    #[test]
    fn gates_are_the_quantiles_of_chi_square() {
        // Tabulated: 3 degrees of freedom, 0.05 -> 7.815, 1e-3 -> 16.266, 1e-4 -> 21.108; 2 of them, 1e-3 -> 13.816.
        for (probability, bound) in [(0.05, 7.815), (1e-3, 16.266), (1e-4, 21.108)] {
            // Tables rounded to 1e-3.
            assert!((Gates::at(probability).position - bound).abs() < 1e-3);
        }
        assert!((Gates::at(1e-3).tangent - 13.816).abs() < 1e-3);
        // A gate that lets everything pass, and one that lets nothing pass.
        assert!(Gates::at(1e-300).position > 1300.0 && Gates::at(1.0 - 1e-12).position < 1e-3);
    }

    #[test]
    fn innovations_are_the_error_to_first_order() {
        let estimate = Pose::exp(&Vector6::new(3.0, -2.0, 50.0, 0.4, -0.7, 1.9));
        let xi = Vector6::new(1.0, -2.0, 0.5, -0.7, 0.6, 0.9) * 1e-5;
        let truth = estimate.perturbed(&xi);
        let position = position_innovation(&estimate, &truth.position_mm, 1.0);
        let tangent = tangent_innovation(&estimate, &truth.tangent(), 1.0);
        let mut error = SVector::<f64, ERROR_DIMENSION>::zeros();
        error.fixed_rows_mut::<6>(0).copy_from(&xi);
        // The second-order remainder of an error of 2e-5, plus rounding of positions of 50 mm.
        assert!((position.residual - position.h * error).norm() < 1e-9);
        assert!((tangent.residual - tangent.h * error).norm() < 1e-9);
    }

    #[test]
    fn a_tangent_residual_is_the_angle_at_any_angle() {
        let estimate = Pose::identity();
        for angle in [1e-12_f64, 1e-3, 1.0, 2.0, 3.1, std::f64::consts::PI] {
            let tangent = Vector3::new(angle.sin() * 0.6, angle.sin() * 0.8, angle.cos());
            let seen = tangent_innovation(&estimate, &tangent, 1.0).residual.norm();
            // Rounding of sine and cosine.
            assert!((seen - angle).abs() < 1e-9, "{angle}: {seen}");
        }
    }
}
