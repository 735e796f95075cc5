//! Torsion of the needle's shaft: the tip turns less, or later, than the base.
//!
//! The lag is base roll minus tip roll, rad. Two models: a first-order lag, and the static wind-up
//! of dry friction. Source: K. Reed, A. Okamura, N. Cowan, "Modeling and control of needles with
//! torsional friction", IEEE Trans. Biomed. Eng. 56, 2009, who report a lag of more than 45 degrees
//! at 100 mm depth. Distributed shaft inertia and viscous modes of that paper are left out.

use thiserror::Error;

/// Torsion parameters that describe no shaft.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum InvalidTorsion {
    /// The time constant is NaN, infinite or not positive.
    #[error("torsional time constant must be positive and finite, found {time_constant_s} s")]
    TimeConstant {
        /// Time constant found, s.
        time_constant_s: f64,
    },
    /// The wind-up is NaN, infinite or negative, or its depth is not positive.
    #[error(
        "wind-up must be finite and not negative at a positive depth, found {angle_rad} rad at {depth_mm} mm"
    )]
    WindUp {
        /// Wind-up angle found, rad.
        angle_rad: f64,
        /// Depth found, mm.
        depth_mm: f64,
    },
}

/// First-order lag: the tip turns at lag / tau.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorsionalLag {
    time_constant_s: f64,
}

/// Dry friction along the shaft: the tip follows only what exceeds the wind-up of the present depth.
///
/// Friction per length f on a shaft of torsional stiffness GJ winds it up by f L^2 / (2 GJ), so the
/// largest lag grows with the square of the depth L. Reversals show the play of 2 f L^2 / (2 GJ).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StaticWindUp {
    wind_up_rad_per_mm2: f64,
}

/// How base rotation reaches the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Torsion {
    /// The tip turns with the base: the paper's assumption.
    Rigid,
    /// First-order lag.
    FirstOrder(TorsionalLag),
    /// Static wind-up by friction.
    WindUp(StaticWindUp),
}

/// What one step of base rotation does to the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorsionStep {
    /// Rotation of the tip during the step, rad.
    pub tip_rotation_rad: f64,
    /// Lag after the step, rad.
    pub lag_rad: f64,
}

impl TorsionalLag {
    /// A lag with time constant tau = `time_constant_s`.
    ///
    /// # Errors
    /// [`InvalidTorsion::TimeConstant`] when it is not positive and finite.
    pub fn new(time_constant_s: f64) -> Result<Self, InvalidTorsion> {
        if time_constant_s.is_finite() && time_constant_s > 0.0 {
            Ok(Self { time_constant_s })
        } else {
            Err(InvalidTorsion::TimeConstant { time_constant_s })
        }
    }

    /// Factors (decay, gain_s) of the exact step lag+ = decay lag + gain omega, for omega held.
    pub(crate) fn discretised(&self, dt_s: f64) -> (f64, f64) {
        let decay_minus_one = (-dt_s / self.time_constant_s).exp_m1();
        (
            1.0 + decay_minus_one,
            -self.time_constant_s * decay_minus_one,
        )
    }
}

impl StaticWindUp {
    /// A shaft whose lag can reach `angle_rad` at depth `depth_mm`.
    ///
    /// # Errors
    /// [`InvalidTorsion::WindUp`] when the angle is negative or the depth not positive.
    pub fn at_depth(angle_rad: f64, depth_mm: f64) -> Result<Self, InvalidTorsion> {
        let wind_up_rad_per_mm2 = angle_rad / (depth_mm * depth_mm);
        if wind_up_rad_per_mm2.is_finite() && angle_rad >= 0.0 && depth_mm > 0.0 {
            Ok(Self {
                wind_up_rad_per_mm2,
            })
        } else {
            Err(InvalidTorsion::WindUp {
                angle_rad,
                depth_mm,
            })
        }
    }

    /// Largest lag at depth `inserted_mm`, rad.
    #[must_use]
    pub fn limit_rad(&self, inserted_mm: f64) -> f64 {
        let depth_mm = inserted_mm.max(0.0);
        self.wind_up_rad_per_mm2 * depth_mm * depth_mm
    }
}

impl Torsion {
    /// Advances the lag while the base turns at `omega_rad_s` for `dt_s`, at depth `inserted_mm`.
    /// Exact for a rate held over the step.
    #[must_use]
    pub fn advance(
        &self,
        lag_rad: f64,
        omega_rad_s: f64,
        inserted_mm: f64,
        dt_s: f64,
    ) -> TorsionStep {
        let base_rotation_rad = omega_rad_s * dt_s;
        let next_rad = match self {
            Self::Rigid => 0.0,
            Self::FirstOrder(lag) => {
                let (decay, gain_s) = lag.discretised(dt_s);
                decay * lag_rad + gain_s * omega_rad_s
            }
            Self::WindUp(shaft) => {
                let limit = shaft.limit_rad(inserted_mm);
                (lag_rad + base_rotation_rad).max(-limit).min(limit)
            }
        };
        TorsionStep {
            tip_rotation_rad: base_rotation_rad + lag_rad - next_rad,
            lag_rad: next_rad,
        }
    }
}
