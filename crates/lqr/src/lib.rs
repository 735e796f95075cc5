#![doc = include_str!("../README.md")]

mod dare;
mod dense;
mod hautus;
mod input;
mod riccati;
mod spectrum;

pub use dare::{Conditioning, Dare, DareError, DareSolution, NearLoss};
pub use hautus::{
    Stabilisability, UncontrollableMode, UnobservableMode, stabilisability, unobservable_on_circle,
};
pub use input::InputError;
pub use spectrum::{SpectrumError, discrete_lyapunov, spectral_radius};
