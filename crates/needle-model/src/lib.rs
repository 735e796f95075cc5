#![doc = include_str!("../README.md")]

mod arc;
mod bevel_offset;
mod chart;
mod controllability;
mod curvature_profile;
mod duty_cycle;
mod error_direction;
mod euler_jacobian;
mod euler_plant;
mod lagged_needle;
mod linearisation;
mod needle;
mod physical_needle;
mod pose;
mod printed_linearisation;
mod residual;
pub mod se3;
mod stumpff;
mod torsion;

pub use arc::{Arc, ArcError};
pub use bevel_offset::BevelOffset;
pub use chart::{CHART_MARGIN, ChartError, EulerState};
pub use controllability::{
    ControllabilityError, ControllabilityReport, ControllabilityWarning, RANK_TOLERANCE,
};
pub use curvature_profile::{CurvatureProfile, CurvatureProfileError};
pub use duty_cycle::{DutyCycle, DutyCycleError};
pub use error_direction::ErrorDirection;
pub use euler_jacobian::EulerJacobians;
pub use euler_plant::{EulerIntegrator, EulerPlant};
pub use lagged_needle::{LaggedJacobians, LaggedState};
pub use linearisation::StepJacobians;
pub use needle::{Input, InvalidCurvature, Needle, StepError};
pub use physical_needle::{PhysicalNeedle, PhysicalState};
pub use pose::Pose;
pub use printed_linearisation::printed_linearisation;
pub use residual::{
    PointResidual, PoseResidual, StepResidual, pose_residual, position_residual, tangent_residual,
};
pub use torsion::{InvalidTorsion, StaticWindUp, Torsion, TorsionStep, TorsionalLag};
