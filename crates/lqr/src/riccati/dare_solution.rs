//! What solving the discrete algebraic Riccati equation gives: P, the gain, and how far both are to be believed.

use crate::riccati::conditioning::Conditioning;
use faer::Mat;

/// The stabilising solution.
#[derive(Debug, Clone)]
pub struct DareSolution {
    /// Cost-to-go V(x) = x'Px, n x n, symmetric.
    pub p: Mat<f64>,
    /// Gain of u = Kx, m x n.
    pub k: Mat<f64>,
    /// Spectral radius of A + BK, below one.
    pub spectral_radius: f64,
    /// |right side - P| / max(|P|, |Q|), Frobenius norms, Joseph form.
    pub relative_residual: f64,
    /// Condition number of P in the one-norm; infinite for a singular P.
    pub condition: f64,
    /// Doubling and Newton steps together.
    pub iterations: usize,
    /// Present where something is nearly lost.
    pub warning: Option<Conditioning>,
}
