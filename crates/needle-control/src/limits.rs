//! Limits of the actuators: boxes on the inputs and on their rates of change.

use needle_model::Input;

/// Input box and rate limits; infinite where absent. Rates are per second, so that they hold at any sample time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputLimits {
    /// Least insertion speed, mm/s; 0 forbids to retract.
    pub v_min_mm_s: f64,
    /// Largest insertion speed, mm/s.
    pub v_max_mm_s: f64,
    /// Largest |spin|, rad/s.
    pub omega_max_rad_s: f64,
    /// Largest |dv/dt|, mm/s^2.
    pub v_rate_max_mm_s2: f64,
    /// Largest |d omega/dt|, rad/s^2.
    pub omega_rate_max_rad_s2: f64,
}

/// Limits that no input satisfies, or that are not numbers.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LimitsError {
    /// Not a number, or negative where a size is meant.
    #[error("{field} must be a number of at least 0, found {found}")]
    NotASize {
        /// Field of [`InputLimits`].
        field: &'static str,
        /// As given.
        found: f64,
    },
    /// The speed box does not contain rest.
    #[error(
        "the speeds must satisfy v_min_mm_s <= 0 <= v_max_mm_s, found {v_min_mm_s} and {v_max_mm_s}"
    )]
    SpeedBox {
        /// As given.
        v_min_mm_s: f64,
        /// As given.
        v_max_mm_s: f64,
    },
}

impl Default for InputLimits {
    /// A clinical driver: insertion only, up to 10 mm/s, one revolution a second, reached in 0.1 s and 0.2 s.
    fn default() -> Self {
        Self {
            v_min_mm_s: 0.0,
            v_max_mm_s: 10.0,
            omega_max_rad_s: std::f64::consts::TAU,
            v_rate_max_mm_s2: 100.0,
            omega_rate_max_rad_s2: 50.0,
        }
    }
}

impl InputLimits {
    /// Checks that rest is allowed and every size is one.
    ///
    /// # Errors
    /// [`LimitsError`] names the first field that is wrong.
    pub fn validate(&self) -> Result<(), LimitsError> {
        for (field, found) in [
            ("omega_max_rad_s", self.omega_max_rad_s),
            ("v_rate_max_mm_s2", self.v_rate_max_mm_s2),
            ("omega_rate_max_rad_s2", self.omega_rate_max_rad_s2),
        ] {
            if found.is_nan() || found < 0.0 {
                return Err(LimitsError::NotASize { field, found });
            }
        }
        let Self {
            v_min_mm_s,
            v_max_mm_s,
            ..
        } = *self;
        match v_min_mm_s <= 0.0 && 0.0 <= v_max_mm_s {
            true => Ok(()),
            false => Err(LimitsError::SpeedBox {
                v_min_mm_s,
                v_max_mm_s,
            }),
        }
    }

    /// What was held, by what is told of it: inside the box; a component that is not finite tells nothing.
    pub(crate) fn held(&self, told: Input, before: Input) -> Input {
        let known = |told: f64, before: f64| if told.is_finite() { told } else { before };
        let held = Input {
            v_mm_s: known(told.v_mm_s, before.v_mm_s),
            omega_rad_s: known(told.omega_rad_s, before.omega_rad_s),
        };
        self.admissible(held, held, f64::INFINITY)
    }

    /// The admissible input nearest to `wanted`, after `previous` was held before and `dt_s` later. A component that is
    /// not a number counts as rest. A `previous` outside the box is brought back at the rate limit.
    #[must_use]
    pub fn admissible(&self, wanted: Input, previous: Input, dt_s: f64) -> Input {
        let toward = |wanted: f64, previous: f64, rate: f64, [low, high]: [f64; 2]| {
            let wanted = if wanted.is_nan() {
                0.0
            } else {
                wanted.clamp(low, high)
            };
            let reach = rate * dt_s.max(0.0);
            if reach.is_finite() {
                // Between the two: the sum may round past what is wanted, and out of the box.
                let (low, high) = (previous.min(wanted), previous.max(wanted));
                (previous + (wanted - previous).clamp(-reach, reach)).clamp(low, high)
            } else {
                wanted
            }
        };
        let spin = [-self.omega_max_rad_s, self.omega_max_rad_s];
        let speed = [self.v_min_mm_s, self.v_max_mm_s];
        Input {
            v_mm_s: toward(wanted.v_mm_s, previous.v_mm_s, self.v_rate_max_mm_s2, speed),
            omega_rad_s: toward(
                wanted.omega_rad_s,
                previous.omega_rad_s,
                self.omega_rate_max_rad_s2,
                spin,
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REST: Input = Input {
        v_mm_s: 0.0,
        omega_rad_s: 0.0,
    };

    #[test]
    fn limits_without_rest_or_with_a_negative_size_are_refused() {
        InputLimits::default().validate().unwrap();
        for (v_min_mm_s, v_max_mm_s) in [(1.0, 2.0), (-2.0, -1.0), (f64::NAN, 1.0), (0.0, f64::NAN)]
        {
            let limits = InputLimits {
                v_min_mm_s,
                v_max_mm_s,
                ..InputLimits::default()
            };
            assert!(matches!(
                limits.validate(),
                Err(LimitsError::SpeedBox { .. })
            ));
        }
        for size in [-1.0, f64::NAN] {
            let limits = InputLimits {
                omega_rate_max_rad_s2: size,
                ..InputLimits::default()
            };
            let refused = limits.validate();
            assert!(matches!(
                refused,
                Err(LimitsError::NotASize {
                    field: "omega_rate_max_rad_s2",
                    ..
                })
            ));
        }
    }

    #[test]
    fn admissible_input_respects_box_and_rate() {
        let limits = InputLimits::default();
        let wanted = Input {
            v_mm_s: 100.0,
            omega_rad_s: -100.0,
        };
        let first = limits.admissible(wanted, REST, 0.05);
        assert_eq!(
            first,
            Input {
                v_mm_s: 5.0,
                omega_rad_s: -2.5
            }
        );
        let later = limits.admissible(wanted, first, 10.0);
        assert_eq!(
            later,
            Input {
                v_mm_s: 10.0,
                omega_rad_s: -std::f64::consts::TAU
            }
        );
    }

    #[test]
    fn what_is_not_a_number_brings_the_needle_to_rest() {
        let wanted = Input {
            v_mm_s: f64::NAN,
            omega_rad_s: f64::NEG_INFINITY,
        };
        let unlimited = InputLimits {
            v_rate_max_mm_s2: f64::INFINITY,
            omega_rate_max_rad_s2: f64::INFINITY,
            ..InputLimits::default()
        };
        let input = unlimited.admissible(wanted, REST, 0.1);
        assert_eq!(
            input,
            Input {
                v_mm_s: 0.0,
                omega_rad_s: -std::f64::consts::TAU
            }
        );
    }

    proptest::proptest! {
        #[test]
        fn admissible_input_is_in_the_box_to_the_last_bit(
            sizes in proptest::array::uniform5(0.0..30.0_f64),
            wanted in proptest::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64), 1..30),
            dt_s in 1e-3..0.3_f64,
        ) {
            let limits = InputLimits {
                v_min_mm_s: -sizes[0],
                v_max_mm_s: sizes[1],
                omega_max_rad_s: sizes[2],
                v_rate_max_mm_s2: 10.0 * sizes[3],
                omega_rate_max_rad_s2: 10.0 * sizes[4],
            };
            let mut input = REST;
            for (v_mm_s, omega_rad_s) in wanted {
                input = limits.admissible(Input { v_mm_s, omega_rad_s }, input, dt_s);
                proptest::prop_assert!((-sizes[0]..=sizes[1]).contains(&input.v_mm_s), "{input:?}");
                proptest::prop_assert!(input.omega_rad_s.abs() <= sizes[2], "{input:?}");
            }
        }
    }
}
