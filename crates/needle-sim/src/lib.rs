#![doc = include_str!("../README.md")]

#[cfg(feature = "campaign")]
pub mod campaign;
pub mod check;
mod estimation;
mod experiment;
mod imaging;
mod log;
pub mod output;
mod path_distance;
mod path_source;
pub mod published;
mod random;
pub mod record;
#[cfg(feature = "report")]
pub mod report;
pub mod scenario;
mod simulated_needle;
mod steering;
mod summary;

pub use estimation::EstimatorError;
pub use experiment::{Experiment, RunError, run};
pub use log::{LogRow, RunLog, RunMetrics};
pub use mpc_qp::SolverSettings;
pub use path_source::{PathSourceError, path_through, read_positions};
pub use record::{RunRecord, RunSummary, StepRecord};
pub use scenario::{Scenario, ScenarioError};
pub use simulated_needle::PlantError;
pub use steering::ControllerError;
pub use summary::SUCCESS_MM;
