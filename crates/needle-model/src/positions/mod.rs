//! From positions alone: a smooth curve, and the problem of the states and inputs that follow it.

pub(crate) mod curvature_report;
pub(crate) mod position_curve;
pub(crate) mod position_path;
pub(crate) mod position_path_settings;
pub(crate) mod spin_guess;
pub(crate) mod spline;
