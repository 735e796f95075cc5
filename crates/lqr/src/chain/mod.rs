//! Riccati equations of time-varying systems: backward over a finite horizon, and around a period.

pub(crate) mod backward;
pub(crate) mod error;
pub(crate) mod periodic;
