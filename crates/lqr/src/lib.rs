#![doc = include_str!("../README.md")]

mod arithmetic;
mod certificate;
mod chain;
mod input;
mod modes;
mod riccati;
mod terminal_set;

pub use certificate::chain_claim::{ChainClaim, ChainClaimError};
pub use certificate::polytope_claim::PolytopeClaim;
pub use certificate::record::{Certificate, Check, Rigour, Witness};
pub use certificate::terminal_claim::TerminalClaim;
pub use chain::backward::{BackwardChain, Stage};
pub use chain::error::ChainError;
pub use chain::periodic::PeriodicSolution;
pub use input::InputError;
pub use modes::hautus::stabilisability;
pub use modes::mode::{Stabilisability, UncontrollableMode, UnobservableMode};
pub use modes::spectrum::{SpectrumError, discrete_lyapunov, spectral_radius};
pub use modes::subspace::{ControllableSubspace, controllable_subspace};
pub use riccati::conditioning::{Conditioning, NearLoss};
pub use riccati::dare::Dare;
pub use riccati::dare_error::DareError;
pub use riccati::dare_solution::DareSolution;
pub use terminal_set::constraints::{
    Constraint, ConstraintError, ConstraintKind, Constraints, LawRow,
};
pub use terminal_set::ellipsoid::{Ellipsoid, LevelReason, TerminalSetError, chain_levels};
pub use terminal_set::max_volume::largest_volume_ellipsoid;
pub use terminal_set::polytope::{AdmissibleSet, Caps, Determination, SetRow};
pub use terminal_set::rate_augmented::RateAugmented;
