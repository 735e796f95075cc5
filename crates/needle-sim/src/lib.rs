#![doc = include_str!("../README.md")]

mod log;
pub mod published;

pub use log::{LogRow, RunLog, RunMetrics};
