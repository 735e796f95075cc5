#![doc = include_str!("../README.md")]

mod baseline;
mod controller;
mod estimator;
mod limits;
mod sample_clock;

pub use baseline::{
    BaselineError, BaselineSettings, DutyCycledGains, DutyCycledSteering, FeedForward,
    LateralGains, LawController, LqrWeights, PathSample, PidGains, SlidingMode, SlidingModeGains,
    SteeringLaw, SteeringPid, TimeVaryingLqr,
};
pub use controller::{ControlStep, Controller, Measurement, Origin, SolverStatistics, StopReason};
pub use estimator::{
    Belief, CURVATURE, ERROR_DIMENSION, FilterError, FilterSettings, LAG, NeedleFilter,
    Observation, ProcessNoise, ROLL, RollSearch, Verdict,
};
pub use limits::{InputLimits, LimitsError};
