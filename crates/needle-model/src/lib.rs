#![doc = include_str!("../README.md")]

mod euler;
mod files;
mod geometry;
mod linearisation;
mod plant;
mod positions;
mod reference;

pub use euler::chart::{CHART_MARGIN, ChartError, EulerState};
pub use euler::euler_jacobian::EulerJacobians;
pub use euler::euler_plant::{EulerIntegrator, EulerPlant};
pub use euler::printed_linearisation::printed_linearisation;
pub use files::path_csv::PATH_CSV_HEADER;
pub use files::path_file::PathFileError;
pub use files::planner_poses::{PlannerFile, read_planner_poses, write_planner_poses};
pub use geometry::arc::{Arc, ArcError};
pub use geometry::pose::Pose;
pub use geometry::se3;
pub use linearisation::controllability::{
    ControllabilityError, ControllabilityReport, ControllabilityWarning, RANK_TOLERANCE,
};
pub use linearisation::error_direction::ErrorDirection;
pub use linearisation::residual::{
    LinearisedStep, PointResidual, PoseResidual, StepResidual, pose_residual, position_residual,
    tangent_residual,
};
pub use linearisation::step_jacobians::StepJacobians;
pub use plant::bevel_offset::BevelOffset;
pub use plant::curvature_profile::{CurvatureProfile, CurvatureProfileError};
pub use plant::duty_cycle::{DutyCycle, DutyCycleError};
pub use plant::lagged_needle::{LaggedJacobians, LaggedState};
pub use plant::needle::{Input, InvalidCurvature, Needle, StepError};
pub use plant::physical_needle::{PhysicalNeedle, PhysicalState};
pub use plant::torsion::{InvalidTorsion, StaticWindUp, Torsion, TorsionStep, TorsionalLag};
pub use positions::curvature_report::CurvatureExcess;
pub use positions::position_curve::{CurvePoint, MIN_POSITIONS, PositionCurve, PositionCurveError};
pub use positions::position_path::{PositionPathError, PositionPathProblem, PositionStage};
pub use positions::position_path_settings::PositionPathSettings;
pub use reference::paper_reference::{
    PAPER_CURVATURE_PER_MM, PAPER_DT_S, PaperReferenceError, paper_bevel_inputs,
    paper_straight_inputs,
};
pub use reference::path_progress::PathProgress;
pub use reference::reference_path::{ReferencePath, ReferencePathError};
pub use reference::reference_window::ReferenceWindow;
