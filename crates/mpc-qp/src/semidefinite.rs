//! Whether weights are positive semidefinite.
//!
//! Decided by a Cholesky factorisation after each diagonal entry has been raised by [`DIAGONAL_SLACK`] of itself: invariant under
//! diagonal scaling, so weights from 1e-6 to 1e6 in one matrix are judged alike, and singular matrices computed in floating point
//! pass. Where that refuses, rounding of the largest entry is granted to every diagonal entry: a projector tilted off an axis has small
//! diagonal entries that are mostly cancellation.

use crate::error::{Place, ProblemError};
use nalgebra::{SMatrix, SVector};

/// Relative rise of the diagonal before the definiteness test: far above rounding, far below any weight with a meaning.
const DIAGONAL_SLACK: f64 = 1e-10;

/// Roundings of the largest entry, times the size of the matrix, that a diagonal entry may be short of: what forming the matrix
/// and factorising it leave.
const ROUNDING_STEPS: f64 = 4.0;

/// Lower triangular L with `L L' = matrix + rise * diag(reference)`, or the row where none exists.
///
/// A zero reference entry asks for a zero row, and gets a zero row in L.
fn cholesky<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    reference: &SVector<f64, N>,
    rise: f64,
) -> Result<SMatrix<f64, N, N>, (usize, f64)> {
    let mut l = SMatrix::<f64, N, N>::zeros();
    for j in 0..N {
        let diagonal = reference[j];
        let mut pivot = matrix[(j, j)] + rise * diagonal;
        for k in 0..j {
            pivot -= l[(j, k)] * l[(j, k)];
        }
        if diagonal < 0.0 || (diagonal > 0.0 && pivot <= 0.0) {
            return Err((j, pivot / diagonal.abs()));
        }
        if diagonal == 0.0 && pivot < 0.0 {
            return Err((j, pivot));
        }
        let root = pivot.max(0.0).sqrt();
        for i in j + 1..N {
            let mut entry = matrix[(i, j)];
            for k in 0..j {
                entry -= l[(i, k)] * l[(j, k)];
            }
            if diagonal > 0.0 {
                l[(i, j)] = entry / root;
            } else if entry != 0.0 {
                return Err((j, 0.0));
            }
        }
        l[(j, j)] = root;
    }
    Ok(l)
}

/// [`cholesky`] with the diagonal raised by a part of itself, or else by the rounding of the largest entry of the data.
fn semidefinite<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    reference: &SVector<f64, N>,
    largest: f64,
) -> Result<SMatrix<f64, N, N>, (usize, f64)> {
    cholesky(matrix, reference, DIAGONAL_SLACK).or_else(|refusal| {
        let rounding = ROUNDING_STEPS * N as f64 * f64::EPSILON * largest;
        let raised = matrix + SMatrix::from_diagonal_element(rounding);
        cholesky(&raised, &raised.diagonal(), 0.0).map_err(|_| refusal)
    })
}

/// The factor L of a positive semidefinite matrix, `L L' = matrix`; if singular, `L L'` has a diagonal larger by 1e-10 of itself
/// or by the rounding of the largest entry.
pub(crate) fn factor<const N: usize>(
    place: Place,
    field: &'static str,
    matrix: &SMatrix<f64, N, N>,
) -> Result<SMatrix<f64, N, N>, ProblemError> {
    let diagonal = matrix.diagonal();
    let attempt = cholesky(matrix, &diagonal, 0.0)
        .or_else(|_| semidefinite(matrix, &diagonal, matrix.amax()));
    attempt.map_err(|(row, pivot)| ProblemError::NotPositiveSemidefinite {
        place,
        field,
        row,
        pivot,
    })
}

/// Whether no diagonal entry is less than the sum of the sizes of the others in its column: a symmetric matrix is positive semidefinite
/// then (Gershgorin), without a root or a division.
fn is_diagonally_dominant<const N: usize>(matrix: &SMatrix<f64, N, N>) -> bool {
    let dominates = |i: usize| {
        2.0 * matrix[(i, i)]
            >= matrix
                .column(i)
                .iter()
                .map(|entry| entry.abs())
                .sum::<f64>()
    };
    (0..N).all(dominates)
}

/// Checks `[Q S; S' R] >= 0` through the Schur complement of R.
pub(crate) fn joint_positive_semidefinite<const NX: usize, const NU: usize>(
    place: Place,
    q: &SMatrix<f64, NX, NX>,
    r: &SMatrix<f64, NU, NU>,
    s: &SMatrix<f64, NX, NU>,
) -> Result<(), ProblemError> {
    let l = factor(place, "r", r)?;
    let mut complement = *q;
    // Row i of W solves L w_i = (row i of S)'; then S R^-1 S' = W W'.
    let mut w = SMatrix::<f64, NX, NU>::zeros();
    for j in 0..NU {
        for i in 0..NX {
            let mut entry = s[(i, j)];
            for k in 0..j {
                entry -= w[(i, k)] * l[(j, k)];
            }
            if l[(j, j)] > 0.0 {
                w[(i, j)] = entry / l[(j, j)];
            } else if entry != 0.0 {
                return Err(ProblemError::NotPositiveSemidefinite {
                    place,
                    field: "q, r, s",
                    row: NX + j,
                    pivot: 0.0,
                });
            }
        }
    }
    if s.iter().any(|&entry| entry != 0.0) {
        complement -= w * w.transpose();
    } else if is_diagonally_dominant(q) {
        return Ok(());
    }
    semidefinite(&complement, &q.diagonal(), q.amax()).map_err(|(row, pivot)| {
        ProblemError::NotPositiveSemidefinite {
            place,
            field: "q, r, s",
            row,
            pivot,
        }
    })?;
    Ok(())
}
