//! Keys of the explicit laws.

use super::positive;
use crate::scenario::keys::{Allowed, Keys};
use needle_control::{DutyCycledGains, LateralGains, LqrWeights, PidGains, SlidingModeGains};

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

pub(super) fn pid(gains: &mut PidGains, keys: &mut dyn Keys) {
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

pub(super) fn duty_cycled(gains: &mut DutyCycledGains, keys: &mut dyn Keys) {
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

pub(super) fn sliding_mode(gains: &mut SlidingModeGains, keys: &mut dyn Keys) {
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

pub(super) fn lqr(weights: &mut LqrWeights, keys: &mut dyn Keys) {
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
