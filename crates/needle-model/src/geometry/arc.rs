//! Closed forms of a single arc: from a pose to a point, and between two poses where one exists.
//!
//! A needle turned in place by the bevel roll theta and then inserted without rotation moves in the
//! plane of its tangent and the direction (sin theta, -cos theta, 0) of its body frame. The target q
//! in that frame fixes the plane, the curvature 2 rho / (rho^2 + z^2) with rho = hypot(x, y), and the
//! angle 2 atan2(rho, z). Source: circle through a point with a given tangent.

use std::f64::consts::PI;

use nalgebra::{Vector3, Vector6};
use thiserror::Error;

use crate::geometry::pose::Pose;
use crate::plant::duty_cycle::{DutyCycle, DutyCycleError};
use crate::plant::needle::{Input, Needle, StepError, finite};

/// Fraction of the chord, or of the coordinates, below which a lateral distance is rounding.
const ROUNDING: f64 = 1e-12;

/// Half angle below which sine and angle are exchanged for two terms of their series: the next term is
/// below rounding.
const SMALL_ANGLE_RAD: f64 = 1e-4;

/// A turn in place followed by an insertion without rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Turn in place before the insertion, rad in (-pi, pi]; zero when the target is straight ahead.
    pub bevel_roll_rad: f64,
    /// Curvature of the arc, 1/mm.
    pub curvature_per_mm: f64,
    /// Length of the arc, mm.
    pub length_mm: f64,
    /// Pose at the end of the arc.
    pub end: Pose,
}

/// Why there is no arc.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ArcError {
    /// A pose or a target has NaN or infinite coordinates.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The target is at the tip or straight behind it.
    #[error("no arc leads to a target at or straight behind the tip: {behind_mm} mm behind")]
    Unreachable {
        /// How far behind the tip, mm.
        behind_mm: f64,
    },
    /// The arc to the target's position does not arrive along its tangent.
    #[error("the only arc to the target arrives {angle_rad} rad off its tangent")]
    TangentMismatch {
        /// Angle between the arc's tangent and the target's, rad.
        angle_rad: f64,
    },
}

impl Arc {
    /// The arc from `start` to the point `target_mm`.
    ///
    /// # Errors
    /// [`ArcError::Unreachable`] for a point at or straight behind the tip, to the rounding of the
    /// coordinates; [`ArcError::Step`] for coordinates that are not finite or overflow.
    pub fn to_point(start: &Pose, target_mm: &Vector3<f64>) -> Result<Self, ArcError> {
        if !(start.is_finite() && target_mm.sum().is_finite()) {
            return Err(StepError::NonFiniteState.into());
        }
        let q = start
            .rotation
            .inverse_transform_vector(&(target_mm - start.position_mm));
        let rho = q.x.hypot(q.y);
        let chord_mm = rho.hypot(q.z);
        // Differences of coordinates are known to their rounding only.
        let rounding_mm = ROUNDING * start.position_mm.amax().max(target_mm.amax());
        let at_tip = chord_mm <= rounding_mm;
        let behind = q.z <= 0.0 && rho <= rounding_mm.max(ROUNDING * chord_mm);
        if at_tip || behind {
            return Err(ArcError::Unreachable { behind_mm: -q.z });
        }
        let bevel_roll_rad = if rho == 0.0 { 0.0 } else { q.x.atan2(-q.y) };
        let half_rad = rho.atan2(q.z);
        let angle_rad = 2.0 * half_rad;
        let curvature_per_mm = 2.0 * (rho / chord_mm) / chord_mm;
        // Arc over chord is half / sin(half), with sin(half) = rho / chord.
        let arc_over_chord = if half_rad < SMALL_ANGLE_RAD {
            1.0 + half_rad * half_rad / 6.0
        } else {
            half_rad * (chord_mm / rho)
        };
        let length_mm = chord_mm * arc_over_chord;
        let roll = Pose::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, bevel_roll_rad));
        let insertion = Pose::exp(&Vector6::new(0.0, 0.0, length_mm, angle_rad, 0.0, 0.0));
        let arc = Self {
            bevel_roll_rad,
            curvature_per_mm,
            length_mm,
            end: start.compose(&roll).compose(&insertion),
        };
        let end = arc.end.position_mm.sum();
        Ok(finite(
            arc,
            [bevel_roll_rad, curvature_per_mm, length_mm, end],
        )?)
    }

    /// The arc from `start` to the pose `target`, and the turn in place (rad, in (-pi, pi]) that
    /// remains at its end. It exists only when the arc to the target's position arrives along its
    /// tangent, within `tolerance_rad`.
    ///
    /// # Errors
    /// As [`Arc::to_point`], and [`ArcError::TangentMismatch`].
    pub fn to_pose(
        start: &Pose,
        target: &Pose,
        tolerance_rad: f64,
    ) -> Result<(Self, f64), ArcError> {
        if !target.is_finite() {
            return Err(StepError::NonFiniteState.into());
        }
        let arc = Self::to_point(start, &target.position_mm)?;
        let (ours, theirs) = (arc.end.tangent(), target.tangent());
        let angle_rad = ours.cross(&theirs).norm().atan2(ours.dot(&theirs));
        // A tolerance that is not a number accepts nothing.
        if angle_rad.is_nan() || tolerance_rad.is_nan() || angle_rad > tolerance_rad {
            return Err(ArcError::TangentMismatch { angle_rad });
        }
        let x_target = arc
            .end
            .rotation
            .inverse_transform_vector(&(target.rotation * Vector3::x()));
        Ok((arc, x_target.y.atan2(x_target.x)))
    }

    /// The duty cycle with which `needle` follows this arc on average.
    ///
    /// # Errors
    /// [`DutyCycleError::Curvature`] when the arc bends more than the needle.
    pub fn duty_cycle(&self, needle: Needle) -> Result<DutyCycle, DutyCycleError> {
        DutyCycle::for_curvature(needle, self.curvature_per_mm)
    }

    /// Whether the arc turns the tangent by more than half a turn: the target lies behind the plane
    /// of the tip, and the arc, though a solution, is rarely what is meant.
    #[must_use]
    pub fn exceeds_half_turn(&self) -> bool {
        self.curvature_per_mm * self.length_mm > PI
    }

    /// The insertion at speed `v_mm_s`: input and duration in s; `None` when the speed is not positive
    /// and finite, or so small that the duration overflows.
    #[must_use]
    pub fn insertion(&self, v_mm_s: f64) -> Option<(Input, f64)> {
        let input = Input {
            v_mm_s,
            omega_rad_s: 0.0,
        };
        let duration_s = self.length_mm / v_mm_s;
        (v_mm_s > 0.0 && v_mm_s.is_finite() && duration_s.is_finite())
            .then_some((input, duration_s))
    }
}
