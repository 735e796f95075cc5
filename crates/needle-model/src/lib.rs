#![doc = include_str!("../README.md")]

mod chart;
mod euler_jacobian;
mod euler_plant;
mod linearisation;
mod needle;
mod pose;
mod printed_linearisation;
mod residual;
pub mod se3;
mod stumpff;

pub use chart::{CHART_MARGIN, ChartError, EulerState};
pub use euler_jacobian::EulerJacobians;
pub use euler_plant::{EulerIntegrator, EulerPlant};
pub use linearisation::StepJacobians;
pub use needle::{Input, InvalidCurvature, Needle, StepError};
pub use pose::Pose;
pub use printed_linearisation::printed_linearisation;
pub use residual::{
    PointResidual, PoseResidual, StepResidual, pose_residual, position_residual, tangent_residual,
};
