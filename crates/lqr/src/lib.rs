#![doc = include_str!("../README.md")]

mod chain;
mod constraints;
mod dare;
mod dense;
mod doubling;
mod ellipsoid;
mod hautus;
mod input;
mod max_volume;
mod riccati;
mod spectrum;
mod subspace;

pub use chain::{BackwardChain, ChainError, PeriodicSolution, Stage};
pub use constraints::{
    Constraint, ConstraintError, ConstraintKind, Constraints, LawRow, RateAugmented,
};
pub use dare::{Conditioning, Dare, DareError, DareSolution, NearLoss};
pub use ellipsoid::{Ellipsoid, LevelReason, TerminalSetError, chain_levels};
pub use hautus::{
    Stabilisability, UncontrollableMode, UnobservableMode, stabilisability, unobservable_on_circle,
};
pub use input::InputError;
pub use max_volume::largest_volume_ellipsoid;
pub use spectrum::{SpectrumError, discrete_lyapunov, spectral_radius};
pub use subspace::{ControllableSubspace, controllable_subspace};
