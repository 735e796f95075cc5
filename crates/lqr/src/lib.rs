#![doc = include_str!("../README.md")]

mod certificate;
mod chain;
mod chain_claim;
mod checks;
mod constraints;
mod dare;
mod dare_error;
mod dense;
mod double_double;
mod doubling;
mod ellipsoid;
mod exact;
mod extended_solution;
mod fixed_block;
mod fixed_size;
mod hautus;
mod hessenberg_qr;
mod input;
mod max_volume;
mod polytope;
mod proved_measure;
mod rate_augmented;
mod riccati;
mod routes;
mod simplex;
mod spectrum;
mod subspace;
mod terminal_claim;
mod verdict;
mod zeros;

pub use certificate::{Certificate, Check, Rigour, Witness};
pub use chain::{BackwardChain, ChainError, PeriodicSolution, Stage};
pub use chain_claim::{ChainClaim, ChainClaimError};
pub use constraints::{Constraint, ConstraintError, ConstraintKind, Constraints, LawRow};
pub use dare::{Conditioning, Dare, DareSolution, NearLoss};
pub use dare_error::DareError;
pub use ellipsoid::{Ellipsoid, LevelReason, TerminalSetError, chain_levels};
pub use hautus::{
    Stabilisability, UncontrollableMode, UnobservableMode, stabilisability, unobservable_on_circle,
};
pub use input::InputError;
pub use max_volume::largest_volume_ellipsoid;
pub use polytope::{AdmissibleSet, Determination, SetRow};
pub use rate_augmented::RateAugmented;
pub use spectrum::{SpectrumError, discrete_lyapunov, spectral_radius};
pub use subspace::{ControllableSubspace, controllable_subspace};
pub use terminal_claim::TerminalClaim;
