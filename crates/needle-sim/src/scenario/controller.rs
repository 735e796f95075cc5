//! The controller of a scenario: its name and its own settings. Limits and sample time come from the scenario.

use super::keys::{Allowed, Choice, Keys, one_of, size};
use needle_control::{
    BaselineSettings, Convergence, DutyCycledGains, LateralGains, LinearConfiguration, LqrWeights,
    NmpcConfiguration, PidGains, SlidingModeGains, SpinTarget, Survival, TerminalChoice, Tracking,
};
use std::time::Duration;

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

/// Longest horizon of a scenario: beyond it a run takes hours.
const LONGEST_HORIZON: u64 = 1000;

impl ControllerChoice {
    const NAMES: &'static [&'static str] = &[
        "nmpc",
        "ltv",
        "straight",
        "pid",
        "lqr",
        "sliding_mode",
        "duty_cycled",
        "feed_forward",
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
            _ => Self::FeedForward,
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
                    Self::Ltv(configuration) | Self::Straight(configuration) => {
                        linear(configuration, keys);
                    }
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

fn tracking(value: &mut Tracking, keys: &mut dyn Keys) {
    let about = "what fixes the present point of the path: the clock, or the tip";
    let variants = &[Tracking::Time, Tracking::Progress];
    one_of(
        keys,
        "tracking",
        value,
        (&["time", "progress"], variants),
        about,
    );
}

fn survival(survival: &mut Survival, keys: &mut dyn Keys) {
    let mut deadline_s = survival.deadline.map(|deadline| deadline.as_secs_f64());
    let about = "wall time that a step may take; a later answer is not applied. Makes runs depend on the machine";
    keys.optional(
        "deadline_s",
        &mut deadline_s,
        Allowed::From(1e-6, 1e3),
        about,
    );
    survival.deadline = deadline_s.and_then(|s| Duration::try_from_secs_f64(s).ok());
    let about = "oldest plan that may stand in for a failed step, in samples";
    size(
        keys,
        "max_plan_age",
        &mut survival.max_plan_age,
        (1, 1000),
        about,
    );
    let about = "distance from the expected position beyond which a measurement is an outlier";
    keys.number(
        "max_jump_mm",
        &mut survival.max_jump_mm,
        Allowed::POSITIVE,
        about,
    );
}

fn nmpc(c: &mut NmpcConfiguration, keys: &mut dyn Keys) {
    let stages = (1, LONGEST_HORIZON);
    size(
        keys,
        "horizon",
        &mut c.horizon,
        stages,
        "samples of the horizon",
    );
    tracking(&mut c.tracking, keys);
    let about = "what the spin's weight pulls toward; the reference's is right where the needle executes the path";
    let targets = &[SpinTarget::Rest, SpinTarget::Reference];
    one_of(
        keys,
        "spin_target",
        &mut c.spin_target,
        (&["rest", "reference"], targets),
        about,
    );
    convergence(&mut c.convergence, keys);
    terminal(&mut c.terminal, keys);
    let about = "damping of the change of roll, in mean stage costs";
    keys.number("damping", &mut c.damping, Allowed::NOT_NEGATIVE, about);
    let about = "Gauss-Newton steps for each candidate of the first plan";
    size(
        keys,
        "start_iterations",
        &mut c.start_iterations,
        (1, 1000),
        about,
    );
    survival(&mut c.survival, keys);
    let w = &mut c.weights;
    keys.table("weights", "weights of the cost", &mut |keys| {
        not_negative(
            keys,
            &mut [
                (
                    "position",
                    &mut w.position,
                    "squared position error, 1/mm^2",
                ),
                (
                    "tangent",
                    &mut w.tangent,
                    "squared error of the unit tangent",
                ),
                ("roll", &mut w.roll, "squared roll error, 1/rad^2"),
                (
                    "end_position",
                    &mut w.end_position,
                    "the same at the horizon's end",
                ),
                (
                    "end_tangent",
                    &mut w.end_tangent,
                    "the same at the horizon's end",
                ),
                ("end_roll", &mut w.end_roll, "the same at the horizon's end"),
            ],
        );
        positive(
            keys,
            &mut [
                (
                    "v",
                    &mut w.v,
                    "squared deviation from the path's speed, s^2/mm^2",
                ),
                ("omega", &mut w.omega, "squared spin, s^2/rad^2"),
            ],
        );
    });
}

fn convergence(value: &mut Convergence, keys: &mut dyn Keys) {
    keys.choice(Choice {
        key: "convergence",
        about: "how far each step is solved",
        names: &["real_time", "full"],
        chosen: usize::from(*value != Convergence::RealTime),
        required: false,
        variant: &mut |index, keys| {
            if index == 0 {
                *value = Convergence::RealTime;
                return;
            }
            if *value == Convergence::RealTime {
                *value = Convergence::Full {
                    tolerance: 1e-6,
                    max_iterations: 50,
                };
            }
            if let Convergence::Full {
                tolerance,
                max_iterations,
            } = value
            {
                let about = "largest entry of the last step (mm, rad, mm/s, rad/s alike)";
                keys.number("tolerance", tolerance, Allowed::Above(0.0, 1.0), about);
                size(
                    keys,
                    "max_iterations",
                    max_iterations,
                    (1, 1000),
                    "steps at most",
                );
            }
        },
    });
}

fn linear(c: &mut LinearConfiguration, keys: &mut dyn Keys) {
    let stages = (1, LONGEST_HORIZON);
    size(
        keys,
        "horizon",
        &mut c.horizon,
        stages,
        "samples of the horizon",
    );
    tracking(&mut c.tracking, keys);
    terminal(&mut c.terminal, keys);
    survival(&mut c.survival, keys);
    let w = &mut c.weights;
    keys.table("weights", "weights of the cost", &mut |keys| {
        let about =
            "squared left-invariant error: three linear, 1/mm^2, and three angular, 1/rad^2";
        keys.numbers("error", &mut w.error, Allowed::NOT_NEGATIVE, about);
        positive(
            keys,
            &mut [
                (
                    "v",
                    &mut w.v,
                    "squared deviation from the path's speed, s^2/mm^2",
                ),
                (
                    "omega",
                    &mut w.omega,
                    "squared deviation from the path's spin, s^2/rad^2",
                ),
                (
                    "v_change",
                    &mut w.v_change,
                    "its squared change in a sample",
                ),
                (
                    "omega_change",
                    &mut w.omega_change,
                    "its squared change in a sample",
                ),
            ],
        );
    });
}

fn terminal(value: &mut TerminalChoice, keys: &mut dyn Keys) {
    const NAMES: &[&str] = &["auto", "helix_dare", "riccati_chain", "none", "periodic"];
    let simple = [
        TerminalChoice::Auto,
        TerminalChoice::HelixDare,
        TerminalChoice::RiccatiChain,
        TerminalChoice::None,
    ];
    let periodic = simple.len();
    keys.choice(Choice {
        key: "terminal",
        about: "terminal cost and set",
        names: NAMES,
        chosen: simple.iter().position(|t| t == value).unwrap_or(periodic),
        required: false,
        variant: &mut |index, keys| {
            if let Some(choice) = simple.get(index) {
                *value = *choice;
                return;
            }
            let mut period = match value {
                TerminalChoice::Periodic { period } => *period,
                _ => 1,
            };
            let about = "samples after which the path's inputs repeat";
            size(keys, "period", &mut period, (1, 10_000), about);
            *value = TerminalChoice::Periodic { period };
        },
    });
}

fn lateral(gains: &mut LateralGains, keys: &mut dyn Keys) {
    positive(
        keys,
        &mut [
            (
                "decay_mm",
                &mut gains.decay_mm,
                "insertion over which errors decay",
            ),
            (
                "integral_mm",
                &mut gains.integral_mm,
                "insertion over which the integral acts",
            ),
            (
                "preview_mm",
                &mut gains.preview_mm,
                "path ahead whose curvature is read",
            ),
        ],
    );
}

fn pid(gains: &mut PidGains, keys: &mut dyn Keys) {
    lateral(&mut gains.lateral, keys);
    positive(
        keys,
        &mut [
            (
                "turn_gain_per_s",
                &mut gains.turn_gain_per_s,
                "spin per turn that is left",
            ),
            (
                "slack",
                &mut gains.slack,
                "demand below which the spin slackens, in needle curvatures",
            ),
        ],
    );
}

fn duty_cycled(gains: &mut DutyCycledGains, keys: &mut dyn Keys) {
    lateral(&mut gains.lateral, keys);
    let about = "spin per turn that is left while the direction is held";
    positive(
        keys,
        &mut [("turn_gain_per_s", &mut gains.turn_gain_per_s, about)],
    );
    let about = "speed of whole turns as a fraction of the largest spin";
    let share = Allowed::Above(0.0, 1.0);
    keys.number("spin_fraction", &mut gains.spin_fraction, share, about);
}

fn sliding_mode(gains: &mut SlidingModeGains, keys: &mut dyn Keys) {
    positive(
        keys,
        &mut [
            (
                "lookahead_mm",
                &mut gains.lookahead_mm,
                "path between tip and target",
            ),
            (
                "boundary_rad",
                &mut gains.boundary_rad,
                "width of the boundary layer",
            ),
        ],
    );
    let about = "largest spin used, as a fraction of the limit";
    let share = Allowed::Above(0.0, 1.0);
    keys.number("spin_fraction", &mut gains.spin_fraction, share, about);
}

fn lqr(weights: &mut LqrWeights, keys: &mut dyn Keys) {
    let about = "squared left-invariant error: three linear, 1/mm^2, and three angular, 1/rad^2";
    keys.numbers(
        "error",
        weights.error.as_mut_slice(),
        Allowed::POSITIVE,
        about,
    );
    let about = "squared deviation of speed, s^2/mm^2, and spin, s^2/rad^2";
    keys.numbers(
        "input",
        weights.input.as_mut_slice(),
        Allowed::POSITIVE,
        about,
    );
    let about = "factor of the error's weights at the end of the path";
    keys.number("terminal", &mut weights.terminal, Allowed::POSITIVE, about);
}
