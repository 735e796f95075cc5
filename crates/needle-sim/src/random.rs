//! Random numbers by counter: each purpose of each run has a stream of its own, which follows from the scenario's seed and the run's
//! index alone. Runs can so be repeated alone, in any order, on any number of threads.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// What random numbers are for. Each purpose has its own key, so that, say, another sensor does not change the disturbances.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Purpose {
    Start = 1,
    Curvature = 2,
    Tissue = 3,
    Driver = 4,
    Sensors = 5,
    #[cfg(feature = "campaign")]
    Parameters = 6,
}

/// A stream of random numbers.
#[derive(Debug)]
pub(crate) struct Stream(ChaCha8Rng);

impl Stream {
    pub(crate) fn new(seed: u64, run_index: u64, purpose: Purpose) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8] = purpose as u8;
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(run_index);
        Self(generator)
    }

    /// A standard normal deviate, by Box and Muller: always two uniform ones, so that streams stay aligned.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// Three of them.
    pub(crate) fn normals(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// Uniform on [0, 1), in steps of 2^-53.
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }
}
