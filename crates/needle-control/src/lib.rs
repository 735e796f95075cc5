#![doc = include_str!("../README.md")]

mod configuration;
mod controller;
mod limits;
mod ltv;
mod nmpc;
mod reconstruction;
mod survival;
mod tracking;

pub use configuration::ConfigurationError;
pub use controller::{ControlStep, Controller, Measurement, Origin, SolverStatistics, StopReason};
pub use limits::{InputLimits, LimitsError};
pub use ltv::{
    LinearConfiguration, LinearController, LinearWeights, LtvController, StraightController,
    TerminalChoice, TerminalError,
};
pub use nmpc::{Convergence, NmpcConfiguration, NmpcController, NmpcWeights, SpinTarget};
pub use reconstruction::{ReconstructedPath, ReconstructionError, reconstruct_path};
pub use survival::Survival;
pub use tracking::Tracking;
