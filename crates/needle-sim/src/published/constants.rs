//! What no setting of the published program changes, in the program's own units.

use super::DT_S;
use serde::Serialize;

/// The program's fixed numbers, for the record.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Constants {
    /// Step of plant, prediction and loop.
    pub dt_s: f64,
    /// Upper bound of v; there is no lower one.
    pub v_max_m_s: f64,
    /// Bound of |omega|.
    pub omega_max_rad_s: f64,
    /// Least change of v from one input to the next.
    pub dv_min_m_s: f64,
    /// Largest change of v from one input to the next.
    pub dv_max_m_s: f64,
    /// Bound of the change of omega from one input to the next.
    pub domega_max_rad_s: f64,
    /// Level c of the terminal set.
    pub terminal_level: f64,
    /// The straight needle.
    pub straight: NeedleConstants,
    /// The bevelled needle.
    pub bevel: NeedleConstants,
}

/// The fixed numbers of one of the two needles. Every run starts from rest at the origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NeedleConstants {
    /// kappa.
    pub curvature_per_m: f64,
    /// Steps of the reference at its full speed.
    pub cruise_steps: usize,
    /// Steps of the reference that follow, each slower than the last by a tenth of the full speed.
    pub brake_steps: usize,
    /// Full speed of the reference.
    pub cruise_v_m_s: f64,
    /// Spin of the reference.
    pub cruise_omega_rad_s: f64,
    /// Steps of the closed loop.
    pub closed_loop_steps: usize,
}

impl NeedleConstants {
    pub(super) const fn reference_steps(&self) -> usize {
        self.cruise_steps + self.brake_steps
    }
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// The published numbers.
pub const CONSTANTS: Constants = Constants {
    dt_s: DT_S,
    v_max_m_s: 0.2,
    omega_max_rad_s: 2.0 * DEGREE,
    dv_min_m_s: -DT_S,
    dv_max_m_s: 3.0 * DT_S,
    domega_max_rad_s: DEGREE * DT_S,
    terminal_level: 10.0,
    straight: NeedleConstants {
        curvature_per_m: 0.0,
        cruise_steps: 90,
        brake_steps: 10,
        cruise_v_m_s: 0.1,
        cruise_omega_rad_s: 0.1 * DEGREE,
        closed_loop_steps: 101,
    },
    bevel: NeedleConstants {
        curvature_per_m: 100.0 / 15.0,
        cruise_steps: 50,
        brake_steps: 10,
        cruise_v_m_s: 0.01,
        cruise_omega_rad_s: 0.05 * DEGREE,
        closed_loop_steps: 71,
    },
};
