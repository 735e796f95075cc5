//! A guess of the spin: the roll turns unevenly, slowest where the bevel points the way the path bends.
//!
//! Let theta be the roll measured from the wanted bending direction. Under theta' = a (1 - e cos theta) the mean of cos theta is
//! m, the wanted bending as a fraction of the needle's, for e = 2 m / (1 + m^2): the needle follows the path on average. Source:
//! as in `needle-model`'s guess for positions; here in feedback form, from whatever pose the needle has, in either sense.
//! Without such a guess the start is symmetric: the cost of spinning to the left and to the right is the same, and its
//! gradient at rest is zero.

use nalgebra::Vector3;
use needle_model::{Needle, Pose};

/// Largest mean turn in one step, rad: ten steps a turn resolve it.
const MEAN_TURN_RAD: f64 = 0.6;

/// Curvature below which a needle cannot be steered by spinning, 1/mm.
const STRAIGHT_PER_MM: f64 = 1e-9;

/// Sense of a spin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sense {
    Positive,
    Negative,
}

/// What the guess must respect.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpinLaw {
    pub(crate) omega_max_rad_s: f64,
    pub(crate) dt_s: f64,
}

impl SpinLaw {
    /// Spin of a step from `pose`, rad/s, where the path wants to bend by `bending_per_mm` (a vector in the world).
    pub(crate) fn omega_rad_s(
        &self,
        needle: &Needle,
        pose: &Pose,
        bending_per_mm: &Vector3<f64>,
        sense: Sense,
    ) -> f64 {
        let kappa_per_mm = needle.curvature_per_mm();
        if kappa_per_mm < STRAIGHT_PER_MM {
            return 0.0;
        }
        let wanted = pose.rotation.inverse_transform_vector(bending_per_mm);
        let ratio = (wanted.x.hypot(wanted.y) / kappa_per_mm).min(1.0);
        let eccentricity = 2.0 * ratio / (1.0 + ratio * ratio);
        let mean_rad = MEAN_TURN_RAD.min(self.omega_max_rad_s * self.dt_s / (1.0 + eccentricity));
        // Rolling by phi turns the bending, which is toward body -y, to (sin phi, -cos phi).
        let theta = -wanted.x.atan2(-wanted.y);
        let sign = match sense {
            Sense::Positive => 1.0,
            Sense::Negative => -1.0,
        };
        // The middle of the step decides: one explicit midpoint step of the law.
        let rate = |theta: f64| sign * mean_rad * (1.0 - eccentricity * theta.cos());
        let middle = theta + 0.5 * rate(theta);
        rate(middle) / self.dt_s
    }
}
