//! Deterministic random numbers for tests: SplitMix64, and normal deviates by the Box-Muller transform.
#![allow(dead_code, reason = "each of the test binaries uses a part")]

use nalgebra::Vector3;

/// A sequence that its seed determines.
#[derive(Debug, Clone)]
pub(crate) struct Deviates(u64);

impl Deviates {
    pub(crate) fn seeded(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform on [0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform on [-1, 1).
    pub(crate) fn either_way(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub(crate) fn normals(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }
}
