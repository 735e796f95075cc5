//! A plant closer to a real needle than the controller's model: varying curvature, torsion and bevel
//! offset composed around the exact step. Run it at finer steps than the controller's.
//!
//! Within a step the curvature is the one at the step's middle and the tip turns at its mean rate:
//! second order in dt. Retraction reverses the kinematics; the memory of a cut channel is left out.

use crate::geometry::pose::Pose;
use crate::plant::bevel_offset::BevelOffset;
use crate::plant::curvature_profile::CurvatureProfile;
use crate::plant::needle::{Input, Needle, StepError, check_step, finite};
use crate::plant::torsion::Torsion;

/// A needle with the effects that the kinematic model leaves out; each may be absent.
#[derive(Debug, Clone, PartialEq)]
pub struct PhysicalNeedle {
    /// Curvature along the inserted length.
    pub curvature: CurvatureProfile,
    /// How base rotation reaches the tip.
    pub torsion: Torsion,
    /// Distance from the kinematic frame to the visible tip.
    pub bevel_offset: BevelOffset,
}

/// State of a [`PhysicalNeedle`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhysicalState {
    /// Kinematic frame; the visible tip is [`PhysicalNeedle::tip`].
    pub frame: Pose,
    /// Base roll minus tip roll, rad.
    pub lag_rad: f64,
    /// Inserted length, mm; retraction decreases it.
    pub inserted_mm: f64,
}

impl From<Needle> for PhysicalNeedle {
    /// The ideal needle: constant curvature, rigid shaft, no offset.
    fn from(needle: Needle) -> Self {
        Self {
            curvature: CurvatureProfile::constant(needle),
            torsion: Torsion::Rigid,
            bevel_offset: BevelOffset::default(),
        }
    }
}

impl PhysicalNeedle {
    /// State of a needle whose visible tip is at `tip`, relaxed and not yet inserted.
    #[must_use]
    pub fn at_entry(&self, tip: &Pose) -> PhysicalState {
        PhysicalState {
            frame: self.bevel_offset.frame(tip),
            lag_rad: 0.0,
            inserted_mm: 0.0,
        }
    }

    /// Pose of the visible tip.
    #[must_use]
    pub fn tip(&self, state: &PhysicalState) -> Pose {
        self.bevel_offset.tip(&state.frame)
    }

    /// State after `input`, given at the base, is held for `dt_s`.
    ///
    /// # Errors
    /// [`StepError`] when state or input is not finite, the time step is negative, or the result
    /// overflows.
    pub fn step(
        &self,
        state: &PhysicalState,
        input: Input,
        dt_s: f64,
    ) -> Result<PhysicalState, StepError> {
        check_step((state.lag_rad + state.inserted_mm).is_finite(), input, dt_s)?;
        if dt_s == 0.0 {
            // No time, no motion; the lag of a state stays, also one above what friction holds.
            return Ok(*state);
        }
        let advance_mm = input.v_mm_s * dt_s;
        let middle_mm = state.inserted_mm + 0.5 * advance_mm;
        let torsion = self
            .torsion
            .advance(state.lag_rad, input.omega_rad_s, middle_mm, dt_s);
        let tip_input = Input {
            // The pose needs the rotation over the step, not the time that it took.
            omega_rad_s: torsion.tip_rotation_rad / dt_s,
            ..input
        };
        let next = PhysicalState {
            frame: self
                .curvature
                .at(middle_mm)
                .step(&state.frame, tip_input, dt_s)?,
            lag_rad: torsion.lag_rad,
            inserted_mm: state.inserted_mm + advance_mm,
        };
        finite(next, [next.lag_rad, next.inserted_mm])
    }
}
