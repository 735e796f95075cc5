//! Checks of what a caller hands in: shapes, finiteness, symmetry.
//!
//! Every public entry validates here once; the code behind assumes validity.

use crate::arithmetic::dense;
use faer::{Mat, MatRef};

/// An input that is not a problem at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A matrix has the wrong shape.
    #[error("{name} is {}x{}, expected {}x{}", found.0, found.1, expected.0, expected.1)]
    Shape {
        /// Name of the matrix in the documentation of the call.
        name: &'static str,
        /// Rows and columns that the other arguments imply.
        expected: (usize, usize),
        /// Rows and columns that were given.
        found: (usize, usize),
    },
    /// A system without a state, an input, or a stage.
    #[error("{name} is empty")]
    Empty {
        /// Name of the argument.
        name: &'static str,
    },
    /// An entry is NaN or infinite.
    #[error("{name}[{row}, {col}] is {value}, not a finite number")]
    NotFinite {
        /// Name of the matrix.
        name: &'static str,
        /// Row of the first such entry.
        row: usize,
        /// Column of the first such entry.
        col: usize,
        /// The entry.
        value: f64,
    },
    /// A number that must not be negative is.
    #[error("{name} is {value}, below zero")]
    Negative {
        /// Name of the argument.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A number that must not be zero is.
    #[error("{name} is zero")]
    Zero {
        /// Name of the argument.
        name: &'static str,
    },
    /// A weight differs from its transpose by more than rounding.
    #[error("{name} is not symmetric: largest difference {difference:e}, tolerance {tolerance:e}")]
    NotSymmetric {
        /// Name of the matrix.
        name: &'static str,
        /// Largest difference between an entry and its mirror.
        difference: f64,
        /// What was allowed.
        tolerance: f64,
    },
}

/// A copy of `a` if it has the expected shape and finite entries.
pub(crate) fn matrix(
    name: &'static str,
    a: MatRef<'_, f64>,
    expected: (usize, usize),
) -> Result<Mat<f64>, InputError> {
    let found = (a.nrows(), a.ncols());
    if found != expected {
        return Err(InputError::Shape {
            name,
            expected,
            found,
        });
    }
    let a = a.to_owned();
    for col in 0..found.1 {
        let column = a.col_as_slice(col);
        if let Some(row) = column.iter().position(|x| !x.is_finite()) {
            return Err(InputError::NotFinite {
                name,
                row,
                col,
                value: column[row],
            });
        }
    }
    Ok(a)
}

/// A number that is neither NaN nor negative; infinity passes.
pub(crate) fn not_negative(name: &'static str, value: f64) -> Result<f64, InputError> {
    if value.is_nan() {
        return Err(InputError::NotFinite {
            name,
            row: 0,
            col: 0,
            value,
        });
    }
    if value < 0.0 {
        return Err(InputError::Negative { name, value });
    }
    Ok(value)
}

/// A number that is finite and not negative.
pub(crate) fn finite_not_negative(name: &'static str, value: f64) -> Result<f64, InputError> {
    matrix(
        name,
        MatRef::from_column_major_slice(&[value], 1, 1),
        (1, 1),
    )?;
    not_negative(name, value)
}

/// A symmetrised copy of `a`, refused where it differs from its transpose by more than
/// `1e-12` of its largest entry: what summation in another order can cause, and no more.
pub(crate) fn symmetric(
    name: &'static str,
    a: MatRef<'_, f64>,
    size: usize,
) -> Result<Mat<f64>, InputError> {
    let mut a = matrix(name, a, (size, size))?;
    let tolerance = 1e-12 * dense::max_abs(a.as_ref());
    let mut difference = 0.0_f64;
    for j in 0..size {
        for i in 0..j {
            difference = difference.max((a[(i, j)] - a[(j, i)]).abs());
        }
    }
    if difference > tolerance {
        return Err(InputError::NotSymmetric {
            name,
            difference,
            tolerance,
        });
    }
    if difference > 0.0 {
        dense::symmetrise(&mut a);
    }
    Ok(a)
}

/// A pair (A, B): A square and not empty, B with as many rows and at least one column.
pub(crate) fn pair(
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
) -> Result<(Mat<f64>, Mat<f64>), InputError> {
    let n = a.nrows();
    if n == 0 {
        return Err(InputError::Empty { name: "A" });
    }
    if b.ncols() == 0 {
        return Err(InputError::Empty { name: "B" });
    }
    let a = matrix("A", a, (n, n))?;
    let b = matrix("B", b, (n, b.ncols()))?;
    Ok((a, b))
}
