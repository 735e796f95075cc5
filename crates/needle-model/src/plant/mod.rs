//! The needle as it moves: the exact step, and the effects of a real shaft and tip around it.

pub(crate) mod bevel_offset;
pub(crate) mod curvature_profile;
pub(crate) mod duty_cycle;
pub(crate) mod lagged_needle;
pub(crate) mod needle;
pub(crate) mod physical_needle;
pub(crate) mod torsion;
