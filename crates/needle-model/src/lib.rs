#![doc = include_str!("../README.md")]

mod chart;
mod euler_plant;
mod needle;
mod pose;
pub mod se3;
mod stumpff;

pub use chart::{CHART_MARGIN, ChartError, EulerState};
pub use euler_plant::{EulerIntegrator, EulerPlant};
pub use needle::{Input, InvalidCurvature, Needle, StepError};
pub use pose::Pose;
