//! Claims about the needle model, one a test, grouped by concern.

mod arcs;
mod chart;
mod effects;
mod finite_difference;
mod kinematics;
mod linearisation;
mod printed;
