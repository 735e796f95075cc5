//! Settings of the filter and what can be wrong with them.

use needle_model::TorsionalLag;

/// Standard deviations of the random walks that the model leaves out, each after one second (so they grow with the
/// square root of time).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProcessNoise {
    /// Position, mm.
    pub position_mm: f64,
    /// Heading about body x and y, rad.
    pub heading_rad: f64,
    /// Roll about the tangent, rad.
    pub roll_rad: f64,
    /// Curvature, 1/mm.
    pub curvature_per_mm: f64,
    /// Torsional lag, rad.
    pub lag_rad: f64,
}

impl Default for ProcessNoise {
    /// A needle that obeys its model but for slow changes of the tissue: curvature wanders by 5e-5 / mm in a second.
    fn default() -> Self {
        Self {
            position_mm: 0.005,
            heading_rad: 5e-4,
            roll_rad: 0.01,
            curvature_per_mm: 5e-5,
            lag_rad: 1e-3,
        }
    }
}

/// Settings of [`crate::NeedleFilter`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterSettings {
    /// Standard deviation of a measured position in each direction, mm.
    pub position_std_mm: f64,
    /// Standard deviation of a measured tangent about each of its two normals, rad.
    pub tangent_std_rad: f64,
    /// What the model leaves out.
    pub process: ProcessNoise,
    /// Torsion of the shaft; `None` where the tip turns with the base.
    pub torsion: Option<TorsionalLag>,
    /// Probability that a good observation is refused as an outlier.
    pub gate_probability: f64,
    /// Outliers in a row of one kind after which the filter takes itself to be lost and widens its belief.
    pub outliers_until_lost: u32,
    /// Longest time without an accepted observation for which a pose is still reported, s.
    pub blind_limit_s: f64,
    /// Sample time that the loop aims at, s; used where the clock does not tell.
    pub dt_s: f64,
    /// Samples and observations that are remembered for late observations, at least 4.
    pub history: usize,
}

impl Default for FilterSettings {
    /// Imaging of 0.2 mm and 1 degree at 10 Hz; one good observation in 10,000 refused; a memory of 2 s for two such sensors.
    fn default() -> Self {
        Self {
            position_std_mm: 0.2,
            tangent_std_rad: 1_f64.to_radians(),
            process: ProcessNoise::default(),
            torsion: None,
            gate_probability: 1e-4,
            outliers_until_lost: 10,
            blind_limit_s: 1.0,
            dt_s: 0.1,
            history: 64,
        }
    }
}

/// Why a filter cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// A time, a standard deviation or a count that must be positive.
    #[error("{field} must be positive and finite, found {found}")]
    NotPositive {
        /// Name of the field.
        field: &'static str,
        /// As given.
        found: f64,
    },
    /// A standard deviation of the process noise that is negative or not a number.
    #[error("{field} must be finite and not negative, found {found}")]
    Negative {
        /// Name of the field.
        field: &'static str,
        /// As given.
        found: f64,
    },
    /// The probability of the gate is outside (0, 1).
    #[error("gate_probability must lie between 0 and 1, found {found}")]
    Probability {
        /// As given.
        found: f64,
    },
    /// Too short a memory.
    #[error("history must be at least 4, found {found}")]
    History {
        /// As given.
        found: usize,
    },
    /// The pose or the lag of the first belief is not finite.
    #[error("the first belief has a coordinate that is not finite")]
    NonFiniteBelief,
    /// The covariance of the first belief is not positive definite.
    #[error("the covariance of the first belief is not symmetric and positive definite")]
    Covariance,
}

impl FilterSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`FilterError`] names the first field that is wrong.
    pub fn validate(&self) -> Result<(), FilterError> {
        for (field, found) in [
            ("position_std_mm", self.position_std_mm),
            ("tangent_std_rad", self.tangent_std_rad),
            ("outliers_until_lost", f64::from(self.outliers_until_lost)),
            ("blind_limit_s", self.blind_limit_s),
            ("dt_s", self.dt_s),
        ] {
            if !(found.is_finite() && found > 0.0) {
                return Err(FilterError::NotPositive { field, found });
            }
        }
        let process = &self.process;
        for (field, found) in [
            ("position_mm", process.position_mm),
            ("heading_rad", process.heading_rad),
            ("roll_rad", process.roll_rad),
            ("curvature_per_mm", process.curvature_per_mm),
            ("lag_rad", process.lag_rad),
        ] {
            if !(found.is_finite() && found >= 0.0) {
                return Err(FilterError::Negative { field, found });
            }
        }
        if !(self.gate_probability > 0.0 && self.gate_probability < 1.0) {
            let found = self.gate_probability;
            return Err(FilterError::Probability { found });
        }
        if self.history < 4 {
            let found = self.history;
            return Err(FilterError::History { found });
        }
        Ok(())
    }
}
