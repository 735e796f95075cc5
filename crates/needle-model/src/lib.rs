#![doc = include_str!("../README.md")]

mod arc;
mod bevel_offset;
mod chart;
mod controllability;
mod curvature_profile;
mod curvature_report;
mod duty_cycle;
mod error_direction;
mod euler_jacobian;
mod euler_plant;
mod lagged_needle;
mod linearisation;
mod needle;
mod paper_reference;
mod path_csv;
mod path_file;
mod path_progress;
mod physical_needle;
mod planner_poses;
mod pose;
mod position_curve;
mod position_path;
mod position_path_settings;
mod printed_linearisation;
mod reference_path;
mod reference_window;
mod residual;
pub mod se3;
mod spin_guess;
mod spline;
mod stumpff;
mod torsion;

pub use arc::{Arc, ArcError};
pub use bevel_offset::BevelOffset;
pub use chart::{CHART_MARGIN, ChartError, EulerState};
pub use controllability::{
    ControllabilityError, ControllabilityReport, ControllabilityWarning, RANK_TOLERANCE,
};
pub use curvature_profile::{CurvatureProfile, CurvatureProfileError};
pub use curvature_report::CurvatureExcess;
pub use duty_cycle::{DutyCycle, DutyCycleError};
pub use error_direction::ErrorDirection;
pub use euler_jacobian::EulerJacobians;
pub use euler_plant::{EulerIntegrator, EulerPlant};
pub use lagged_needle::{LaggedJacobians, LaggedState};
pub use linearisation::StepJacobians;
pub use needle::{Input, InvalidCurvature, Needle, StepError};
pub use paper_reference::{
    PAPER_CURVATURE_PER_MM, PAPER_DT_S, paper_bevel_inputs, paper_straight_inputs,
};
pub use path_csv::PATH_CSV_HEADER;
pub use path_file::PathFileError;
pub use path_progress::PathProgress;
pub use physical_needle::{PhysicalNeedle, PhysicalState};
pub use planner_poses::{PlannerFile, read_planner_poses, write_planner_poses};
pub use pose::Pose;
pub use position_curve::{CurvePoint, MIN_POSITIONS, PositionCurve, PositionCurveError};
pub use position_path::{PositionPathError, PositionPathProblem, PositionStage};
pub use position_path_settings::PositionPathSettings;
pub use printed_linearisation::printed_linearisation;
pub use reference_path::{ReferencePath, ReferencePathError};
pub use reference_window::ReferenceWindow;
pub use residual::{
    LinearisedStep, PointResidual, PoseResidual, StepResidual, pose_residual, position_residual,
    tangent_residual,
};
pub use torsion::{InvalidTorsion, StaticWindUp, Torsion, TorsionStep, TorsionalLag};
