//! Checks of matrices and bounds, made once where data enters a problem.
//!
//! Semidefiniteness is decided by a Cholesky factorisation after each diagonal entry has been raised by
//! [`DIAGONAL_SLACK`] of itself: invariant under diagonal scaling, so weights from 1e-6 to 1e6 in one matrix are
//! judged alike, and singular matrices computed in floating point pass. Where that refuses, rounding of the largest entry is
//! granted to every diagonal entry: a projector tilted off an axis has small diagonal entries that are mostly cancellation. Halves
//! may differ by rounding of the largest entry, which is much beside small ones: judged and kept is the symmetric part.

use crate::error::{Place, ProblemError};
use nalgebra::{SMatrix, SVector};

/// Relative rise of the diagonal before the definiteness test: far above rounding, far below any weight with a meaning.
const DIAGONAL_SLACK: f64 = 1e-10;

/// Roundings of the largest entry, times the size of the matrix, that a diagonal entry may be short of: what forming the matrix
/// and factorising it leave.
const ROUNDING_STEPS: f64 = 4.0;

/// Largest difference of mirrored entries, relative to the largest entry, that counts as rounding.
const SYMMETRY_TOLERANCE: f64 = 1e-9;

pub(crate) fn finite<const M: usize, const N: usize>(
    place: Place,
    field: &'static str,
    matrix: &SMatrix<f64, M, N>,
) -> Result<(), ProblemError> {
    // One pass without branches.
    let each = matrix.as_slice().iter().map(|value| value.is_finite());
    if each.fold(true, |all, this| all & this) {
        return Ok(());
    }
    for column in 0..N {
        for row in 0..M {
            let found = matrix[(row, column)];
            if !found.is_finite() {
                return Err(not_finite(place, field, (row, column), found));
            }
        }
    }
    Ok(())
}

/// Checks the coefficients of row `row` of a matrix that is kept row by row.
pub(crate) fn finite_row<const N: usize>(
    place: Place,
    field: &'static str,
    row: usize,
    coefficients: &SVector<f64, N>,
) -> Result<(), ProblemError> {
    match coefficients.iter().position(|value| !value.is_finite()) {
        Some(column) => Err(not_finite(
            place,
            field,
            (row, column),
            coefficients[column],
        )),
        None => Ok(()),
    }
}

fn not_finite(
    place: Place,
    field: &'static str,
    (row, column): (usize, usize),
    found: f64,
) -> ProblemError {
    ProblemError::NotFinite {
        place,
        field,
        row,
        column,
        expected: "a finite number",
        found,
    }
}

pub(crate) fn upper_limit(
    place: Place,
    field: &'static str,
    row: usize,
    found: f64,
) -> Result<(), ProblemError> {
    if found.is_nan() || found == f64::NEG_INFINITY {
        let expected = "a number or +inf";
        return Err(ProblemError::NotFinite {
            place,
            field,
            row,
            column: 0,
            expected,
            found,
        });
    }
    Ok(())
}

/// Bounds of this size and beyond mean none.
const ABSENT: f64 = 1e20;

pub(crate) fn absent_limit(upper: &mut f64) {
    if *upper >= ABSENT {
        *upper = f64::INFINITY;
    }
}

pub(crate) fn absent_bounds<const N: usize>(
    lower: &mut SVector<f64, N>,
    upper: &mut SVector<f64, N>,
) {
    upper.iter_mut().for_each(absent_limit);
    for low in lower.iter_mut() {
        if *low <= -ABSENT {
            *low = f64::NEG_INFINITY;
        }
    }
}

/// Distance of two bounds, relative to their size, up to which nothing but rounding is between them.
const COINCIDENT: f64 = 1e-11;

/// Whether bounds of numbers of this size leave no interior; a size of zero asks whether they differ by their own rounding.
pub(crate) fn coincide(lower: f64, upper: f64, size: f64) -> bool {
    let distance = upper - lower;
    distance.is_finite() && distance <= COINCIDENT * (size + lower.abs())
}

/// Names: of the pair, of the lower and of the upper bound.
pub(crate) fn bounds<const N: usize>(
    place: Place,
    [pair, lower_name, upper_name]: [&'static str; 3],
    lower: &SVector<f64, N>,
    upper: &SVector<f64, N>,
) -> Result<(), ProblemError> {
    for component in 0..N {
        let (low, high) = (lower[component], upper[component]);
        if low.is_nan() || low == f64::INFINITY {
            let expected = "a number or -inf";
            return Err(ProblemError::NotFinite {
                place,
                field: lower_name,
                row: component,
                column: 0,
                expected,
                found: low,
            });
        }
        upper_limit(place, upper_name, component, high)?;
        if low > high {
            return Err(ProblemError::BoundsCrossed {
                place,
                field: pair,
                component,
                lower: low,
                upper: high,
            });
        }
    }
    Ok(())
}

/// Checks finiteness and symmetry; the symmetric part.
pub(crate) fn symmetric<const N: usize>(
    place: Place,
    field: &'static str,
    matrix: &SMatrix<f64, N, N>,
) -> Result<SMatrix<f64, N, N>, ProblemError> {
    finite(place, field, matrix)?;
    let tolerance = SYMMETRY_TOLERANCE * matrix.amax();
    for column in 0..N {
        for row in 0..column {
            let (found, expected) = (matrix[(row, column)], matrix[(column, row)]);
            if (found - expected).abs() > tolerance {
                return Err(ProblemError::NotSymmetric {
                    place,
                    field,
                    row,
                    column,
                    expected,
                    found,
                });
            }
        }
    }
    let mut part = *matrix;
    symmetrise(&mut part);
    Ok(part)
}

/// Puts the mean of mirrored entries in both places.
pub(crate) fn symmetrise<const N: usize>(matrix: &mut SMatrix<f64, N, N>) {
    for column in 0..N {
        for row in 0..column {
            let (upper, lower) = (matrix[(row, column)], matrix[(column, row)]);
            let mean = upper + 0.5 * (lower - upper);
            (matrix[(row, column)], matrix[(column, row)]) = (mean, mean);
        }
    }
}

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
