//! The controller of a scenario: its name and its own settings. Limits and sample time come from the scenario.

mod laws;
mod predictive;

use super::keys::{Allowed, Choice, Keys};
use crate::published::BevelSettings;
use laws::{duty_cycled, lqr, pid, sliding_mode};
use needle_control::{
    BaselineSettings, DutyCycledGains, LinearConfiguration, LqrWeights, NmpcConfiguration,
    PidGains, SlidingModeGains,
};
use predictive::{corridor, linear, nmpc, published};

/// A controller by name with its settings.
#[derive(Debug, Clone, PartialEq)]
pub enum ControllerChoice {
    /// Nonlinear model predictive control.
    Nmpc(NmpcConfiguration),
    /// Linear time-varying model predictive control.
    Ltv(LinearConfiguration),
    /// Predictive control of a straight needle.
    Straight(LinearConfiguration),
    /// PID on the steering angle.
    Pid(Patience, PidGains),
    /// Time-varying LQR.
    Lqr(Patience, LqrWeights),
    /// Sliding mode.
    SlidingMode(Patience, SlidingModeGains),
    /// Duty-cycled spinning.
    DutyCycled(Patience, DutyCycledGains),
    /// The reference's inputs by the clock.
    FeedForward,
    /// The published program with its errors and its own limits; it never comes to an end.
    Published(BevelSettings),
}

/// When an explicit law no longer trusts its measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// Longest time without a usable measurement, s.
    pub patience_s: f64,
    /// Largest credible distance between measured and expected position, mm.
    pub jump_mm: f64,
}

impl Default for Patience {
    fn default() -> Self {
        let BaselineSettings {
            patience_s,
            jump_mm,
            ..
        } = BaselineSettings::default();
        Self {
            patience_s,
            jump_mm,
        }
    }
}

impl Default for ControllerChoice {
    fn default() -> Self {
        Self::named(0)
    }
}

impl ControllerChoice {
    pub(crate) const NAMES: &'static [&'static str] = &[
        "nmpc",
        "ltv",
        "straight",
        "pid",
        "lqr",
        "sliding_mode",
        "duty_cycled",
        "feed_forward",
        "published",
    ];

    /// The controller's name in a scenario.
    #[must_use]
    pub fn name(&self) -> &'static str {
        Self::NAMES[self.index()]
    }

    fn index(&self) -> usize {
        match self {
            Self::Nmpc(_) => 0,
            Self::Ltv(_) => 1,
            Self::Straight(_) => 2,
            Self::Pid(..) => 3,
            Self::Lqr(..) => 4,
            Self::SlidingMode(..) => 5,
            Self::DutyCycled(..) => 6,
            Self::FeedForward => 7,
            Self::Published(_) => 8,
        }
    }

    fn named(index: usize) -> Self {
        let patience = Patience::default();
        match index {
            // The tip is to be on the path, and a path's roll means nothing: what a user asks of a path.
            0 => Self::Nmpc(NmpcConfiguration::default()),
            1 => Self::Ltv(LinearConfiguration::default()),
            2 => Self::Straight(LinearConfiguration::default()),
            3 => Self::Pid(patience, PidGains::default()),
            4 => Self::Lqr(patience, LqrWeights::default()),
            5 => Self::SlidingMode(patience, SlidingModeGains::default()),
            6 => Self::DutyCycled(patience, DutyCycledGains::default()),
            7 => Self::FeedForward,
            _ => Self::Published(BevelSettings::default()),
        }
    }

    pub(super) fn keys(&mut self, keys: &mut dyn Keys) {
        keys.choice(Choice {
            key: "name",
            about: "the controller",
            names: Self::NAMES,
            chosen: self.index(),
            required: true,
            variant: &mut |index, keys| {
                if index != self.index() {
                    *self = Self::named(index);
                }
                match self {
                    Self::Nmpc(configuration) => nmpc(configuration, keys),
                    Self::Ltv(configuration) => {
                        corridor(&mut configuration.corridor_mm, keys);
                        linear(configuration, keys);
                    }
                    // A needle without bevel has no offset across the path.
                    Self::Straight(configuration) => linear(configuration, keys),
                    Self::Pid(patience, gains) => {
                        patience.keys(keys);
                        pid(gains, keys);
                    }
                    Self::Lqr(patience, weights) => {
                        patience.keys(keys);
                        lqr(weights, keys);
                    }
                    Self::SlidingMode(patience, gains) => {
                        patience.keys(keys);
                        sliding_mode(gains, keys);
                    }
                    Self::DutyCycled(patience, gains) => {
                        patience.keys(keys);
                        duty_cycled(gains, keys);
                    }
                    Self::FeedForward => {}
                    Self::Published(settings) => published(settings, keys),
                }
            },
        });
    }
}

impl Patience {
    fn keys(&mut self, keys: &mut dyn Keys) {
        let about = "longest time without a usable measurement before the needle is stopped";
        keys.number("patience_s", &mut self.patience_s, Allowed::POSITIVE, about);
        let about = "largest credible distance between measured and expected position";
        keys.number("jump_mm", &mut self.jump_mm, Allowed::POSITIVE, about);
    }
}

fn positive(keys: &mut dyn Keys, rows: &mut [(&'static str, &mut f64, &'static str)]) {
    for (key, value, about) in rows {
        keys.number(key, value, Allowed::POSITIVE, about);
    }
}

fn not_negative(keys: &mut dyn Keys, rows: &mut [(&'static str, &mut f64, &'static str)]) {
    for (key, value, about) in rows {
        keys.number(key, value, Allowed::NOT_NEGATIVE, about);
    }
}
