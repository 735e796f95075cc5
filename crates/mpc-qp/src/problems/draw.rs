//! A small deterministic generator (SplitMix64, Steele et al. 2014), enough for test data.

use nalgebra::{SMatrix, SVector};

pub(super) struct Draw {
    state: u64,
}

impl Draw {
    pub(super) fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in [low, high).
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in low..=high.
    pub(super) fn integer(&mut self, low: usize, high: usize) -> usize {
        low + (self.bits() % (high - low + 1) as u64) as usize
    }

    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }

    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform(0.0, 1.0)).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }

    pub(super) fn power_of_ten(&mut self, low: f64, high: f64) -> f64 {
        10_f64.powf(self.uniform(low, high))
    }

    pub(super) fn matrix<const M: usize, const N: usize>(&mut self) -> SMatrix<f64, M, N> {
        SMatrix::from_fn(|_, _| self.normal())
    }

    /// A dense symmetric matrix with these eigenvalues: a random reflection of the diagonal.
    pub(super) fn with_spectrum<const N: usize>(
        &mut self,
        eigenvalues: &SVector<f64, N>,
    ) -> SMatrix<f64, N, N> {
        let normal: SVector<f64, N> = self.matrix();
        let reflection = SMatrix::identity()
            - normal * normal.transpose() * (2.0 / normal.norm_squared().max(1e-300));
        let full = reflection * SMatrix::from_diagonal(eigenvalues) * reflection;
        (full + full.transpose()) * 0.5
    }
}
