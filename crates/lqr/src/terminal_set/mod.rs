//! Constraints under a law, and the sets of states that keep them for ever: ellipsoids and polytopes.

pub(crate) mod constraints;
pub(crate) mod ellipsoid;
pub(crate) mod max_volume;
pub(crate) mod polytope;
pub(crate) mod rate_augmented;
pub(crate) mod simplex;
