//! A needle that bends by kappa can follow any gentler curve by turning unevenly: it spins, and lingers
//! where the bevel points the way the curve bends. This file computes such a roll in closed form, as the
//! starting point of an optimisation.
//!
//! Let theta be the roll measured from the wanted bending direction. Under
//! theta' = a (1 - e cos theta) the mean of cos theta over a turn is (1 - sqrt(1 - e^2)) / e, which
//! equals the wanted ratio m = |k| / kappa for e = 2 m / (1 + m^2); the mean of sin theta is zero.
//! At m = 1 the spin stops at theta = 0: the needle just follows its own arc. The duty-cycled spin of
//! Minhas et al. (2007) is the same idea with a rate that jumps.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::geometry::pose::Pose;
use crate::positions::position_curve::CurvePoint;

/// Turn of the spin in one time step at its mean rate, rad: ten steps a turn resolve it.
const SPIN_PER_STEP_RAD: f64 = 0.6;

/// Integration steps of the roll in one time step.
const SUBSTEPS: u32 = 20;

/// What the spin must respect.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpinLimits {
    pub(crate) needle_curvature_per_mm: f64,
    pub(crate) dt_s: f64,
    pub(crate) omega_max_rad_s: f64,
}

/// Poses along the curve points, the bevel turned so that the bending follows the curve on average.
pub(crate) fn spun_poses(curve: &[CurvePoint], limits: SpinLimits) -> Vec<Pose> {
    let frames = bishop_frames(curve);
    if limits.needle_curvature_per_mm == 0.0 {
        // A straight needle gains nothing by turning.
        let posed = curve.iter().zip(&frames);
        return posed
            .map(|(point, frame)| pose_at(point, frame, 0.0))
            .collect();
    }
    // Wanted bending as (ratio to the needle's, direction) in the frame that does not twist.
    let wanted: Vec<(f64, f64)> = curve
        .iter()
        .zip(&frames)
        .map(|(point, frame)| {
            let k1 = point.curvature_per_mm.dot(&frame.column(0));
            let k2 = point.curvature_per_mm.dot(&frame.column(1));
            let ratio = k1.hypot(k2) / limits.needle_curvature_per_mm;
            (
                if ratio.is_finite() {
                    ratio.min(1.0)
                } else {
                    0.0
                },
                k2.atan2(k1),
            )
        })
        .collect();
    let mut roll = wanted.first().map_or(0.0, |w| w.1);
    let mut poses = Vec::with_capacity(curve.len());
    for (k, point) in curve.iter().enumerate() {
        poses.push(pose_at(point, &frames[k], roll));
        if let Some(&next) = wanted.get(k + 1) {
            roll = roll_after_step(roll, wanted[k], next, limits);
        }
    }
    poses
}

/// Roll after one time step, the wanted bending changing linearly from `now` to `next`.
fn roll_after_step(mut roll: f64, now: (f64, f64), next: (f64, f64), limits: SpinLimits) -> f64 {
    let turn = wrapped(next.1 - now.1);
    let substep = 1.0 / f64::from(SUBSTEPS);
    for i in 0..SUBSTEPS {
        let t = (f64::from(i) + 0.5) * substep;
        let ratio = now.0 + t * (next.0 - now.0);
        let eccentricity = 2.0 * ratio / (1.0 + ratio * ratio);
        let mean =
            SPIN_PER_STEP_RAD.min(limits.omega_max_rad_s * limits.dt_s / (1.0 + eccentricity));
        let direction = now.1 + t * turn;
        // A gentle curve has hardly a direction: follow its turning only as far as it bends.
        let followed = eccentricity * eccentricity * turn.clamp(-mean, mean);
        roll += (mean * (1.0 - eccentricity * (roll - direction).cos()) + followed) * substep;
    }
    roll
}

/// Pose whose tangent is the curve's and whose bevel bends toward `roll` in the untwisted frame.
fn pose_at(point: &CurvePoint, frame: &Matrix3<f64>, roll: f64) -> Pose {
    let bend = frame.column(0) * roll.cos() + frame.column(1) * roll.sin();
    // Our bevel bends toward body -y.
    let y = -bend;
    let x = y.cross(&point.tangent);
    let rotation = Matrix3::from_columns(&[x, y, point.tangent]);
    Pose {
        rotation: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
        position_mm: point.position_mm,
    }
}

/// Rotation-minimising frames (m1, m2, tangent) along the curve: each is the one before, turned by the
/// least rotation that carries tangent to tangent.
fn bishop_frames(curve: &[CurvePoint]) -> Vec<Matrix3<f64>> {
    let mut frames: Vec<Matrix3<f64>> = Vec::with_capacity(curve.len());
    let mut first = Vector3::x();
    if let Some(point) = curve.first() {
        // The axis least along the tangent gives a well-conditioned normal.
        first = Vector3::ith(point.tangent.iamin(), 1.0);
    }
    for point in curve {
        let t = point.tangent;
        let m1 = (first - t * first.dot(&t)).normalize();
        frames.push(Matrix3::from_columns(&[m1, t.cross(&m1), t]));
        first = m1;
    }
    frames
}

/// An angle in [-pi, pi].
fn wrapped(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}
