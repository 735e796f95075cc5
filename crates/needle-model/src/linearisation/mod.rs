//! First order around a motion: derivatives of the step, residuals, and what inputs can correct.

pub(crate) mod controllability;
pub(crate) mod error_direction;
pub(crate) mod residual;
pub(crate) mod step_jacobians;
