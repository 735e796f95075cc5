//! Sliding-mode steering: insert, and turn the bevel toward the target as fast as allowed.
//!
//! After D. C. Rucker, J. Das, H. Gilbert, P. Swaney, M. Miga, N. Sarkar, R. Webster, "Sliding mode control of
//! steerable needles", IEEE Trans. Robotics 29, 2013: a law that needs no parameter of the needle and has bounded
//! inputs. In this crate's frame: the target q seen from the tip, the turn s = atan2(q_x, -q_y) that brings it into
//! the plane of bending (the sliding surface is s = 0), and
//!
//!   v = v_reference,    omega = lambda sat(s / phi),    sat(y) = y for |y| <= 1, else sign(y).
//!
//! phi = 0 would be the discontinuous law; the boundary layer phi replaces its chatter, which a sampled loop cannot
//! perform. A path is followed as there, by a target that moves along it: the point of the path a fixed length ahead
//! of the tip, beyond its end along the last tangent. Written from the paper's idea and conventions of this crate;
//! its reachability proof is for targets, not for this look-ahead.

use crate::baseline::bevel::turn_rad;
use crate::baseline::law::{PathSample, SteeringLaw};
use crate::baseline::settings::{BaselineError, all_positive};
use nalgebra::Vector3;
use needle_model::Input;

/// Gains of [`SlidingMode`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlidingModeGains {
    /// Length of path between tip and target, mm.
    pub lookahead_mm: f64,
    /// lambda as a fraction of the largest spin, at most 1.
    pub spin_fraction: f64,
    /// Boundary layer phi, rad.
    pub boundary_rad: f64,
}

impl Default for SlidingModeGains {
    /// The best of the study in `docs/baselines.md`.
    fn default() -> Self {
        Self {
            lookahead_mm: 7.0,
            spin_fraction: 1.0,
            boundary_rad: 2.0,
        }
    }
}

/// The law.
#[derive(Debug, Clone, Copy)]
pub struct SlidingMode {
    gains: SlidingModeGains,
}

impl SlidingMode {
    /// The law with these gains.
    ///
    /// # Errors
    /// [`BaselineError::NotPositive`] names the first gain that is wrong.
    pub fn new(gains: SlidingModeGains) -> Result<Self, BaselineError> {
        all_positive(&[
            ("lookahead_mm", gains.lookahead_mm),
            ("spin_fraction", gains.spin_fraction),
            ("boundary_rad", gains.boundary_rad),
        ])?;
        Ok(Self { gains })
    }
}

/// The point of the path `lookahead_mm` ahead of the nearest step, world frame.
fn target_mm(sample: &PathSample<'_>, lookahead_mm: f64) -> Vector3<f64> {
    let (poses, arc) = (sample.path.poses(), sample.path.arc_length_mm());
    let wanted_mm = arc[sample.step] + lookahead_mm;
    let after = arc.partition_point(|&s| s <= wanted_mm);
    // arc[step] is at most what is wanted, so there is a step before.
    let before = after.saturating_sub(1);
    let beyond_mm = wanted_mm - arc[before];
    poses[before].position_mm + poses[before].tangent() * beyond_mm
}

impl SteeringLaw for SlidingMode {
    fn wanted(&mut self, sample: &PathSample<'_>) -> Input {
        let toward = target_mm(sample, self.gains.lookahead_mm) - sample.pose.position_mm;
        let target = sample.pose.rotation.inverse_transform_vector(&toward);
        let surface = turn_rad(&target, sample.held.omega_rad_s);
        let lambda = self.gains.spin_fraction * sample.omega_max_rad_s;
        Input {
            omega_rad_s: lambda * (surface / self.gains.boundary_rad).clamp(-1.0, 1.0),
            ..sample.reference_input()
        }
    }

    fn reset(&mut self) {}
}
