//! Modes of a pair (A, B) or (A, Q): eigenvalues, Hautus tests, the controllable subspace.

pub(crate) mod hautus;
pub(crate) mod mode;
pub(crate) mod spectrum;
pub(crate) mod subspace;
