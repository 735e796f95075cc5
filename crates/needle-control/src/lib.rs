#![doc = include_str!("../README.md")]

mod baseline;
mod configuration;
mod controller;
mod corridor;
mod estimator;
mod follower;
mod limits;
mod ltv;
mod nmpc;
mod plan_solver;
mod program;
mod reconstruction;
mod sample_clock;
mod survival;
mod terminal;
mod tracking;

pub use baseline::{
    BaselineError, BaselineSettings, DutyCycledGains, DutyCycledSteering, FeedForward,
    LateralGains, LawController, LqrWeights, PathSample, PidGains, SlidingMode, SlidingModeGains,
    SteeringLaw, SteeringPid, TimeVaryingLqr,
};
pub use configuration::ConfigurationError;
pub use controller::{
    ControlStep, Controller, Measurement, Origin, Softened, SolverStatistics, StopReason,
};
pub use estimator::{
    Belief, CURVATURE, ERROR_DIMENSION, FilterError, FilterSettings, LAG, NeedleFilter,
    Observation, ProcessNoise, ROLL, RollSearch, Verdict,
};
pub use limits::{InputLimits, LimitsError};
pub use ltv::{
    LinearConfiguration, LinearController, LinearWeights, LtvController, StraightController,
};
pub use nmpc::{Convergence, NmpcConfiguration, NmpcController, NmpcWeights, SpinTarget};
pub use plan_solver::PlanSolver;
pub use reconstruction::{ReconstructedPath, ReconstructionError, reconstruct_path};
pub use survival::Survival;
pub use terminal::{RefusedChoice, TerminalChoice, TerminalError, TerminalRegion};
pub use tracking::Tracking;
