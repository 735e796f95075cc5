//! The discrete algebraic Riccati equation: the problem and its map, routes to a candidate, the verdict on it.

pub(crate) mod balance;
pub(crate) mod conditioning;
pub(crate) mod dare;
pub(crate) mod dare_error;
pub(crate) mod dare_solution;
pub(crate) mod doubling;
pub(crate) mod extended_solution;
pub(crate) mod padded;
pub(crate) mod problem;
pub(crate) mod proved_measure;
pub(crate) mod routes;
pub(crate) mod verdict;
pub(crate) mod zeros;
