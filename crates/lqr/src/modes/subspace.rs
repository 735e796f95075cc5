//! The controllable subspace by a staircase.
//!
//! The Krylov blocks B, AB, A^2 B, ... are orthogonalised as they arise (block Arnoldi with a
//! rank decision by singular values), which never forms the controllability matrix, whose columns
//! become parallel. A is replaced by A - sigma I with sigma = tr A / n and scaled to norm one: the subspace is the same, and
//! for a finely sampled system, A close to I, the new directions are not drowned by the old ones.

use crate::arithmetic::dense::{add_scaled, identity, mul, norm, tr_mul};
use crate::input::{self, InputError};
use crate::modes::hautus::normalised_columns;
use faer::{Mat, MatRef};

/// The directions that some input sequence reaches from the origin.
#[derive(Debug, Clone)]
pub struct ControllableSubspace {
    /// Its dimension.
    pub dimension: usize,
    /// Orthonormal basis, n x dimension.
    pub basis: Mat<f64>,
    /// Smallest singular value that counted as a direction; infinite where there was none.
    pub smallest_kept: f64,
    /// Largest singular value that counted as zero.
    pub largest_dropped: f64,
}

/// The controllable subspace of (A, B), A n x n, B n x m.
///
/// `tolerance` separates directions from rounding, relative to the scaled blocks (their norm is at most one);
/// `1e-9` suits data with full double accuracy. `smallest_kept` and `largest_dropped` show how clear the decision was.
///
/// # Errors
/// [`InputError`] for malformed matrices or a tolerance that is negative or not finite.
pub fn controllable_subspace(
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
    tolerance: f64,
) -> Result<ControllableSubspace, InputError> {
    let (a, b) = input::pair(a, b)?;
    input::finite_not_negative("tolerance", tolerance)?;
    let n = a.nrows();
    let mean = (0..n).map(|i| a[(i, i)] / n as f64).sum::<f64>();
    let mut shifted = add_scaled(&a, -mean, &identity(n));
    let size = norm(&shifted);
    if size > 0.0 {
        shifted = add_scaled(&Mat::zeros(n, n), 1.0 / size, &shifted);
    }
    let mut found = ControllableSubspace {
        dimension: 0,
        basis: Mat::zeros(n, 0),
        smallest_kept: f64::INFINITY,
        largest_dropped: 0.0,
    };
    let mut block = normalised_columns(&b, 1.0);
    while found.dimension < n {
        let fresh = found.extend(block, tolerance);
        if fresh.ncols() == 0 {
            break;
        }
        block = mul(&shifted, &fresh);
    }
    Ok(found)
}

impl ControllableSubspace {
    /// Adds what `block` has outside the basis; returns the new directions.
    fn extend(&mut self, mut block: Mat<f64>, tolerance: f64) -> Mat<f64> {
        let n = block.nrows();
        // Twice: one pass of Gram-Schmidt leaves rounding of the removed part.
        for _ in 0..2 {
            let inside = mul(&self.basis, &tr_mul(&self.basis, &block));
            block = add_scaled(&block, -1.0, &inside);
        }
        let Ok(svd) = block.thin_svd() else {
            return Mat::zeros(n, 0);
        };
        let sigma: Vec<f64> = (0..n.min(block.ncols()))
            .map(|i| svd.S().column_vector()[i])
            .collect();
        let rank = sigma
            .iter()
            .filter(|&&s| s > tolerance)
            .count()
            .min(n - self.dimension);
        if rank > 0 {
            self.smallest_kept = self.smallest_kept.min(sigma[rank - 1]);
        }
        if let Some(&dropped) = sigma.get(rank) {
            self.largest_dropped = self.largest_dropped.max(dropped);
        }
        let fresh = svd.U().get(.., ..rank).to_owned();
        // A direction of a small singular value carries the block's rounding enlarged by its inverse.
        let inside = mul(&self.basis, &tr_mul(&self.basis, &fresh));
        let fresh = add_scaled(&fresh, -1.0, &inside);
        let old = self.basis.clone();
        let kept = self.dimension;
        self.basis = Mat::from_fn(n, kept + rank, |i, j| {
            if j < kept {
                old[(i, j)]
            } else {
                fresh[(i, j - kept)]
            }
        });
        self.dimension += rank;
        fresh
    }
}
