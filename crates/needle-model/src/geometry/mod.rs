//! Rigid motions: poses, their tangent space, and arcs in closed form.

pub(crate) mod arc;
pub(crate) mod pose;
pub mod se3;
pub(crate) mod stumpff;
