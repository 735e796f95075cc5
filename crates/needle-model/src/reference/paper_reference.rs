//! The paper's two reference motions as inputs, in mm and rad: what its program used, which the text
//! does not say. The paths follow by rolling them out, on SE(3) or in the chart.

use thiserror::Error;

use crate::euler::chart::{ChartError, EulerState};
use crate::euler::euler_plant::{EulerIntegrator, EulerPlant};
use crate::geometry::pose::Pose;
use crate::plant::needle::{Input, InvalidCurvature, Needle};
use crate::reference::reference_path::{ReferencePath, ReferencePathError};

/// Time step of every run of the paper, s.
pub const PAPER_DT_S: f64 = 0.1;

/// Curvature of the paper's bevel-tip needle, 1/mm.
pub const PAPER_CURVATURE_PER_MM: f64 = 1.0 / 150.0;

/// Why a path of the paper could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PaperReferenceError {
    /// The needle.
    #[error(transparent)]
    Needle(#[from] InvalidCurvature),
    /// A step in the chart.
    #[error(transparent)]
    Chart(#[from] ChartError),
    /// The path.
    #[error(transparent)]
    Path(#[from] ReferencePathError),
}

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
    /// poses. The authors' own path is [`ReferencePath::paper_euler_path`].
    ///
    /// # Errors
    /// As [`ReferencePath::from_inputs`].
    pub fn paper_recipe(needle: Needle) -> Result<Self, ReferencePathError> {
        Self::from_inputs(needle, Pose::identity(), paper_bevel_inputs(), PAPER_DT_S)
    }

    /// The path that the authors' program made of their bevel-tip recipe: 61 poses of the needle of
    /// [`PAPER_CURVATURE_PER_MM`] under [`EulerIntegrator::PaperOrder`], from the identity. Its steps
    /// have defects against the exact kinematics: forward Euler lags by half a step of bending.
    ///
    /// # Errors
    /// None in fact: the recipe is fixed and stays away from the chart's singularity.
    pub fn paper_euler_path() -> Result<Self, PaperReferenceError> {
        let plant = EulerPlant {
            needle: Needle::new(PAPER_CURVATURE_PER_MM)?,
            integrator: EulerIntegrator::PaperOrder,
        };
        let inputs = paper_bevel_inputs();
        let mut state = EulerState::default();
        let mut poses = vec![state.to_pose()];
        for &input in &inputs {
            state = plant.step(&state, input, PAPER_DT_S)?;
            poses.push(state.to_pose());
        }
        Ok(Self::from_samples(poses, inputs, PAPER_DT_S)?)
    }

    /// The paper's straight-needle recipe, exact on SE(3) from the identity: 101 poses along z. For a
    /// straight needle forward Euler is exact, too.
    ///
    /// # Errors
    /// None in fact: the recipe is fixed.
    pub fn paper_straight_path() -> Result<Self, PaperReferenceError> {
        let straight = Needle::new(0.0)?;
        let inputs = paper_straight_inputs();
        Ok(Self::from_inputs(
            straight,
            Pose::identity(),
            inputs,
            PAPER_DT_S,
        )?)
    }
}
