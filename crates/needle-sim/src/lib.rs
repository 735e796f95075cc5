#![doc = include_str!("../README.md")]

mod log;
pub mod published;

pub use log::{LogRow, RunLog, RunMetrics};
pub use mpc_qp::SolverSettings;
