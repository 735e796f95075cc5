//! Claims about the needle model, one a test, grouped by concern.

mod chart;
mod kinematics;
