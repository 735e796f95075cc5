//! The paper's two reference motions as inputs, in mm and rad: what its program used, which the text
//! does not say. The paths follow by rolling them out, on SE(3) or in the chart.

use crate::needle::{Input, Needle};
use crate::pose::Pose;
use crate::reference_path::{ReferencePath, ReferencePathError};

/// Time step of every run of the paper, s.
pub const PAPER_DT_S: f64 = 0.1;

/// Curvature of the paper's bevel-tip needle, 1/mm.
pub const PAPER_CURVATURE_PER_MM: f64 = 1.0 / 150.0;

/// Inputs of the bevel-tip reference: 50 steps of 10 mm/s and 0.05 deg/s, then 10 steps that slow
/// down by 1 mm/s each, from 9 to 0.
#[must_use]
pub fn paper_bevel_inputs() -> Vec<Input> {
    slowing(50, 10.0, 0.05)
}

/// Inputs of the straight-needle reference: 90 steps of 100 mm/s and 0.1 deg/s, then 10 steps that
/// slow down by 10 mm/s each, from 90 to 0.
#[must_use]
pub fn paper_straight_inputs() -> Vec<Input> {
    slowing(90, 100.0, 0.1)
}

fn slowing(steady_steps: u32, v_mm_s: f64, omega_deg_s: f64) -> Vec<Input> {
    let omega_rad_s = omega_deg_s.to_radians();
    let steady = (0..steady_steps).map(|_| v_mm_s);
    let slower = (0..10).map(|i| v_mm_s * (0.9 - 0.1 * f64::from(i)));
    steady
        .chain(slower)
        .map(|v_mm_s| Input {
            // 0.9 - 0.1 * 9 is not exactly zero.
            v_mm_s: if v_mm_s.abs() < 1e-12 { 0.0 } else { v_mm_s },
            omega_rad_s,
        })
        .collect()
}

impl ReferencePath {
    /// The paper's bevel-tip recipe executed exactly on SE(3) by `needle`, from the identity: 61
    /// poses. The authors' own path is the same inputs in
    /// [`EulerIntegrator::PaperOrder`](crate::EulerIntegrator).
    ///
    /// # Errors
    /// As [`ReferencePath::from_inputs`].
    pub fn paper_recipe(needle: Needle) -> Result<Self, ReferencePathError> {
        Self::from_inputs(needle, Pose::identity(), paper_bevel_inputs(), PAPER_DT_S)
    }
}
