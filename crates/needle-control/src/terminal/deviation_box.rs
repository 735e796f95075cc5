//! Room for deviations from a reference's inputs inside the limits of the actuators.

use crate::limits::InputLimits;
use lqr::{ConstraintError, Constraints};
use needle_model::Input;

/// Room for deviations (v, omega) from every input of a reference, mm/s and rad/s, and for their change in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct DeviationBox {
    lower: [f64; 2],
    upper: [f64; 2],
    rate: [f64; 2],
}

impl DeviationBox {
    /// What `limits` leave beside every one of `inputs` at once.
    pub(super) fn of(inputs: &[Input], limits: &InputLimits, dt_s: f64) -> Self {
        let extreme = |of: fn(&Input) -> f64, pick: fn(f64, f64) -> f64| {
            inputs.iter().map(of).reduce(pick).unwrap_or(0.0)
        };
        let change = |of: fn(&Input) -> f64| {
            let steps = inputs
                .windows(2)
                .map(|pair| (of(&pair[1]) - of(&pair[0])).abs());
            steps.fold(0.0, f64::max)
        };
        let v: fn(&Input) -> f64 = |u| u.v_mm_s;
        let omega: fn(&Input) -> f64 = |u| u.omega_rad_s;
        let lower = [
            limits.v_min_mm_s - extreme(v, f64::min),
            -limits.omega_max_rad_s - extreme(omega, f64::min),
        ];
        let upper = [
            limits.v_max_mm_s - extreme(v, f64::max),
            limits.omega_max_rad_s - extreme(omega, f64::max),
        ];
        let rate = [
            limits.v_rate_max_mm_s2 * dt_s - change(v),
            limits.omega_rate_max_rad_s2 * dt_s - change(omega),
        ];
        Self { lower, upper, rate }
    }

    /// Limits on deviations as `lqr` takes them, for a state of that many coordinates.
    pub(super) fn constraints(&self, states: usize) -> Result<Constraints, ConstraintError> {
        Constraints::new(states, 2)
            .with_input_box(&self.lower, &self.upper)?
            .with_rate_box(&self.rate.map(|r| -r), &self.rate)
    }

    /// The limit of which the reference leaves least, in a word.
    pub(super) fn exhausted(&self) -> &'static str {
        let Self { lower, upper, rate } = self;
        let limits = [
            ("the insertion speed", upper[0].min(-lower[0])),
            ("the spin", upper[1].min(-lower[1])),
            ("the change of the insertion speed", rate[0]),
            ("the change of the spin", rate[1]),
        ];
        let least = limits.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        least.map_or("the limits", |(name, _)| name)
    }
}
