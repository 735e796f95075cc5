//! Claims about the needle model, one a test, grouped by concern.

mod chart;
mod finite_difference;
mod kinematics;
mod linearisation;
mod printed;
