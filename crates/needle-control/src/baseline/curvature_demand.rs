//! Curvature that brings the tip back to the path: the outer loop of the PID and of duty-cycled steering.
//!
//! With s the inserted length, the lateral error obeys e'' = k - k_path, k the curvature vector of the tip. The law k
//! = k_path - (2 / l)(h + a(e)) - e_I / l_I^3, h = e' the error of the tangent, e_I the integral of e along s, makes
//! the errors decay over the length l, critically damped where a(e) = e / (2 l). The approach angle a is bounded by
//! sqrt(kappa |e|), the angle from which half of the needle's curvature still turns back into the path: without the
//! bound a needle far off overshoots.

use crate::baseline::law::PathSample;
use crate::baseline::settings::{BaselineError, all_positive};
use nalgebra::Vector3;

/// Largest part of the needle's curvature that the integral may take.
const INTEGRAL_SHARE: f64 = 0.25;

/// Lengths that set the outer loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LateralGains {
    /// Inserted length over which errors decay, mm.
    pub decay_mm: f64,
    /// Inserted length over which the integral acts, mm.
    pub integral_mm: f64,
    /// Length of path ahead over which its curvature is read, mm.
    pub preview_mm: f64,
}

impl LateralGains {
    pub(crate) fn validate(&self) -> Result<(), BaselineError> {
        all_positive(&[
            ("decay_mm", self.decay_mm),
            ("integral_mm", self.integral_mm),
            ("preview_mm", self.preview_mm),
        ])
    }
}

/// The outer loop with its integral.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CurvatureDemand {
    gains: LateralGains,
    /// Integral of the lateral error, mm^2, world frame.
    integral_mm2: Vector3<f64>,
}

impl CurvatureDemand {
    pub(crate) fn new(gains: LateralGains) -> Self {
        Self {
            gains,
            integral_mm2: Vector3::zeros(),
        }
    }

    pub(crate) fn reset(&mut self) {
        self.integral_mm2 = Vector3::zeros();
    }

    /// The wanted curvature vector in the body frame, 1/mm.
    pub(crate) fn at(&mut self, sample: &PathSample<'_>) -> Vector3<f64> {
        let kappa = sample.needle.curvature_per_mm();
        let LateralGains {
            decay_mm,
            integral_mm,
            preview_mm,
        } = self.gains;
        let path_curvature = path_curvature(sample, preview_mm, kappa);
        let reference = sample.path.poses()[sample.step];
        let tangent = reference.tangent();
        let offset = sample.pose.position_mm - reference.position_mm;
        let along_mm = tangent.dot(&offset);
        let lateral = |x: Vector3<f64>| x - tangent * tangent.dot(&x);
        let error = lateral(offset) - path_curvature * (0.5 * along_mm * along_mm);
        let heading = lateral(sample.pose.tangent()) - path_curvature * along_mm;

        let distance_mm = error.norm();
        let approach = (0.5 / decay_mm).min((kappa / distance_mm.max(1e-9)).sqrt());
        self.integral_mm2 += error * (sample.held.v_mm_s * sample.elapsed_s).max(0.0);
        let cube = integral_mm.powi(3);
        // A sum that is not a number must not stay.
        self.integral_mm2 = bounded(self.integral_mm2, INTEGRAL_SHARE * kappa * cube);
        let demand = path_curvature
            - (heading + error * approach) * (2.0 / decay_mm)
            - self.integral_mm2 / cube;
        sample.pose.rotation.inverse_transform_vector(&demand)
    }
}

/// Curvature vector of the path from this step over `preview_mm`, 1/mm; no more than the needle's own.
fn path_curvature(sample: &PathSample<'_>, preview_mm: f64, kappa: f64) -> Vector3<f64> {
    let (poses, arc) = (sample.path.poses(), sample.path.arc_length_mm());
    let here = sample.step;
    let ahead = arc
        .partition_point(|&s| s < arc[here] + preview_mm)
        .min(arc.len() - 1);
    let length_mm = arc[ahead] - arc[here];
    if length_mm > 0.0 {
        let turn = poses[ahead].tangent() - poses[here].tangent();
        bounded(turn / length_mm, kappa)
    } else {
        Vector3::zeros()
    }
}

/// `x` shortened to at most `most`; zero where it is not a number.
fn bounded(x: Vector3<f64>, most: f64) -> Vector3<f64> {
    let size = x.norm();
    if !size.is_finite() {
        Vector3::zeros()
    } else if size > most {
        x * (most / size)
    } else {
        x
    }
}
