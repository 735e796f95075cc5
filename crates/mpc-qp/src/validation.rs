//! Checks of matrices and bounds, made once where data enters a problem.
//!
//! Halves of a weight may differ by rounding of the largest entry, which is much beside small ones: judged and kept is the symmetric
//! part.

use crate::error::{Place, ProblemError};
use nalgebra::{SMatrix, SVector};

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
