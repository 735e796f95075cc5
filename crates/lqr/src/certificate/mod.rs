//! Claims that cost, law and set fit together, and the record of their proof.

pub(crate) mod chain_claim;
pub(crate) mod checks;
pub(crate) mod polytope_claim;
pub(crate) mod polytope_proof;
pub(crate) mod record;
pub(crate) mod terminal_claim;
