//! Limits and weights of the problem of [`crate::PositionPathProblem`].

use crate::plant::needle::Input;
use crate::positions::position_path::PositionPathError;

/// Hard limits of the inputs, and how fast to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionPathSettings {
    /// Insertion speed to aim at, mm/s; lowered a little so that the curve is a whole number of steps.
    pub speed_mm_s: f64,
    /// Time step, s.
    pub dt_s: f64,
    /// Least insertion speed, mm/s.
    pub v_min_mm_s: f64,
    /// Greatest insertion speed, mm/s.
    pub v_max_mm_s: f64,
    /// Greatest rotation speed either way, rad/s.
    pub omega_max_rad_s: f64,
    /// Greatest |dv/dt| between steps, mm/s^2; infinite for none. The guess does not know it, nor the next one.
    pub v_rate_max_mm_s2: f64,
    /// Greatest |d omega/dt| between steps, rad/s^2; infinite for none.
    pub omega_rate_max_rad_s2: f64,
    /// Standard deviation that makes a position error cost 1, mm.
    pub position_sigma_mm: f64,
    /// Standard deviation that makes a deviation from the speed cost 1, mm/s.
    pub speed_sigma_mm_s: f64,
    /// Standard deviation that makes a deviation from the guessed rotation cost 1, rad/s.
    pub omega_sigma_rad_s: f64,
}

impl Default for PositionPathSettings {
    /// 5 mm/s at 0.1 s, no retraction, one turn a second at most, reached in 0.1 s and 0.2 s. At a position sigma of 0.05 mm
    /// Gauss-Newton settles in three steps on a curve that needs spinning; at 1e-3 mm its full steps
    /// diverge there, for a gain in accuracy that no needle has.
    fn default() -> Self {
        Self {
            speed_mm_s: 5.0,
            dt_s: 0.1,
            v_min_mm_s: 0.0,
            v_max_mm_s: 10.0,
            omega_max_rad_s: std::f64::consts::TAU,
            v_rate_max_mm_s2: 100.0,
            omega_rate_max_rad_s2: 50.0,
            position_sigma_mm: 0.05,
            speed_sigma_mm_s: 1.0,
            omega_sigma_rad_s: 1.0,
        }
    }
}

impl PositionPathSettings {
    /// The nearest input within the limits.
    #[must_use]
    pub fn within_limits(&self, input: Input) -> Input {
        let limit = self.omega_max_rad_s;
        Input {
            v_mm_s: input.v_mm_s.max(self.v_min_mm_s).min(self.v_max_mm_s),
            omega_rad_s: input.omega_rad_s.max(-limit).min(limit),
        }
    }

    /// Reciprocal standard deviations of position, speed and rotation speed.
    pub(crate) fn weights(&self) -> (f64, f64, f64) {
        (
            1.0 / self.position_sigma_mm,
            1.0 / self.speed_sigma_mm_s,
            1.0 / self.omega_sigma_rad_s,
        )
    }

    /// Checks ranges.
    pub(crate) fn check(&self) -> Result<(), PositionPathError> {
        let positive = [
            ("speed_mm_s", self.speed_mm_s),
            ("dt_s", self.dt_s),
            ("omega_max_rad_s", self.omega_max_rad_s),
            ("position_sigma_mm", self.position_sigma_mm),
            ("speed_sigma_mm_s", self.speed_sigma_mm_s),
            ("omega_sigma_rad_s", self.omega_sigma_rad_s),
        ];
        for (setting, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(PositionPathError::Setting { setting, value });
            }
        }
        for (setting, value) in [
            ("v_rate_max_mm_s2", self.v_rate_max_mm_s2),
            ("omega_rate_max_rad_s2", self.omega_rate_max_rad_s2),
        ] {
            if value.is_nan() || value < 0.0 {
                return Err(PositionPathError::Setting { setting, value });
            }
        }
        // Infinite speed limits are no limits; the others must be numbers in order.
        for (setting, value) in [
            ("v_min_mm_s", self.v_min_mm_s),
            ("v_max_mm_s", self.v_max_mm_s),
        ] {
            if value.is_nan() {
                return Err(PositionPathError::Setting { setting, value });
            }
        }
        if !(self.v_min_mm_s..=self.v_max_mm_s).contains(&self.speed_mm_s) {
            return Err(PositionPathError::Setting {
                setting: "speed_mm_s",
                value: self.speed_mm_s,
            });
        }
        Ok(())
    }
}
