//! Keys of the predictive controllers.

use super::{not_negative, positive};
use crate::published::BevelSettings;
use crate::scenario::keys::{Allowed, Choice, Keys, one_of, size};
use needle_control::{
    Convergence, LinearConfiguration, NmpcConfiguration, SpinTarget, Survival, TerminalChoice,
    Tracking,
};
use std::time::Duration;

/// Longest horizon of a scenario: beyond it a run takes hours.
const LONGEST_HORIZON: u64 = 1000;

fn horizon(value: &mut usize, keys: &mut dyn Keys) {
    let stages = (1, LONGEST_HORIZON);
    size(keys, "horizon", value, stages, "samples of the horizon");
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
    let about = "outliers in a row after which the next one is believed";
    size(
        keys,
        "max_outliers",
        &mut survival.max_outliers,
        (1, 1000),
        about,
    );
}

pub(super) fn corridor(half_width_mm: &mut Option<f64>, keys: &mut dyn Keys) {
    let about = "half-width of the corridor about the path, along each cross axis of its frame, that plans keep or say that they leave";
    keys.optional("corridor_mm", half_width_mm, Allowed::POSITIVE, about);
}

pub(super) fn nmpc(c: &mut NmpcConfiguration, keys: &mut dyn Keys) {
    corridor(&mut c.corridor_mm, keys);
    horizon(&mut c.horizon, keys);
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
        (1, 100),
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

pub(super) fn linear(c: &mut LinearConfiguration, keys: &mut dyn Keys) {
    horizon(&mut c.horizon, keys);
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

pub(super) fn published(settings: &mut BevelSettings, keys: &mut dyn Keys) {
    let weight = Allowed::NOT_NEGATIVE;
    let about = "diagonal of Q, for x in mm, y and z in cm, angles in rad";
    keys.numbers("q_diagonal", &mut settings.q_diagonal, weight, about);
    let about = "diagonal of R, for v in m/s and omega in rad/s";
    keys.numbers(
        "r_diagonal",
        &mut settings.r_diagonal,
        Allowed::POSITIVE,
        about,
    );
    let about = "samples of the horizon, no more than the path has";
    size(
        keys,
        "horizon",
        &mut settings.horizon,
        (1, LONGEST_HORIZON),
        about,
    );
    let about = "tolerance of the solver";
    keys.number(
        "tolerance",
        &mut settings.tolerance,
        Allowed::From(1e-12, 1e-2),
        about,
    );
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
