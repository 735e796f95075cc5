//! The turn that brings the bevel into a wanted direction of bending. An unturned needle bends toward body -y, so a
//! direction (x, y) of the body frame asks for the turn atan2(x, -y): the same angle as [`needle_model::Arc`]'s.

use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// From this much of half a turn on, both ways round are equally long: the one under way is kept.
const UNDECIDED: f64 = 0.9;

/// Turn in rad toward `direction`, given in the body frame; in (-pi, pi] but for a turn under way with the sign of
/// `omega_rad_s`.
pub(crate) fn turn_rad(direction: &Vector3<f64>, omega_rad_s: f64) -> f64 {
    let turn = direction.x.atan2(-direction.y);
    if turn.abs() > UNDECIDED * PI && turn * omega_rad_s < 0.0 {
        turn - TAU.copysign(turn)
    } else {
        turn
    }
}
