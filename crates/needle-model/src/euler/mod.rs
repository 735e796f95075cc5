//! The Euler chart of the literature: states, plant, derivatives, and what the paper printed.

pub(crate) mod chart;
pub(crate) mod euler_jacobian;
pub(crate) mod euler_plant;
pub(crate) mod printed_linearisation;
