#![doc = include_str!("../README.md")]

mod controller;
mod limits;

pub use controller::{ControlStep, Controller, Measurement, Origin, SolverStatistics, StopReason};
pub use limits::{InputLimits, LimitsError};
