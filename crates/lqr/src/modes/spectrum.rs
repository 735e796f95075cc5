//! Eigenvalues, spectral radius and the discrete Lyapunov equation.
//!
//! The Lyapunov equation X = A'XA + Q is summed by squaring, X_{j+1} = X_j + A_j'X_jA_j with
//! A_{j+1} = A_j^2 (squared Smith iteration): quadratic convergence, products only, and it
//! keeps X symmetric and, for Q >= 0, semidefinite. It leaves out unstable A, where the equation may
//! have a solution but not one that bounds a trajectory.

use crate::arithmetic::dense::{add_scaled, congruence, mul, norm};
use crate::arithmetic::fixed_size::{by_states, power_sum, smith_sum};
use crate::arithmetic::hessenberg_qr::{self, MAX_SIZE};
use crate::arithmetic::scaling::level;
use crate::input::{self, InputError};
use faer::{Mat, MatRef, c64};

/// Squarings after which a power of a matrix with spectral radius below `1 - 1e-14` has vanished.
pub(crate) const MAX_SQUARINGS: usize = 60;

/// Why a spectrum, or what rests on one, could not be had.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// The input is malformed.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The QR algorithm did not converge, or its entries overflow.
    #[error(
        "the eigenvalue iteration did not converge on a matrix of size {size} with norm {norm:e}"
    )]
    NoConvergence {
        /// Number of rows.
        size: usize,
        /// Frobenius norm of the matrix.
        norm: f64,
    },
    /// The Lyapunov sum diverges.
    #[error("spectral radius {spectral_radius} is not below one: the Lyapunov sum diverges")]
    Unstable {
        /// Spectral radius of the matrix.
        spectral_radius: f64,
    },
}

/// Eigenvalues of a square finite matrix, with an error of the order of rounding times the norm of the balanced matrix.
pub(crate) fn eigenvalues(a: &Mat<f64>) -> Result<Vec<c64>, SpectrumError> {
    let failed = || SpectrumError::NoConvergence {
        size: a.nrows(),
        norm: norm(a),
    };
    // Squares of the entries must not overflow inside the iteration.
    if !(norm(a) < 1e150) {
        return Err(failed());
    }
    if let Some(values) = small_eigenvalues(a) {
        return Ok(values);
    }
    let mut columns: Vec<Vec<f64>> = (0..a.ncols()).map(|j| a.col_as_slice(j).to_vec()).collect();
    level(&mut columns);
    let a = Mat::from_fn(a.nrows(), a.ncols(), |i, j| columns[j][i]);
    let values = a.eigenvalues().map_err(|_| failed())?;
    if values.iter().all(|z| z.re.is_finite() && z.im.is_finite()) {
        Ok(values)
    } else {
        Err(failed())
    }
}

/// By the small QR iteration, on the matrix scaled to norm one; `None` where it does not apply or gives up.
fn small_eigenvalues(a: &Mat<f64>) -> Option<Vec<c64>> {
    let n = a.nrows();
    let mut columns = [[0.0; MAX_SIZE]; MAX_SIZE];
    for (j, column) in columns.get_mut(..n)?.iter_mut().enumerate() {
        column[..n].copy_from_slice(a.col_as_slice(j));
    }
    level(&mut columns[..n]);
    let square: f64 = columns.as_flattened().iter().map(|x| x * x).sum();
    if !square.is_normal() {
        return None;
    }
    let size = square.sqrt();
    let mut values = hessenberg_qr::eigenvalues(columns, n, 1.0 / size)?;
    for value in &mut values {
        *value *= size;
    }
    Some(values)
}

pub(crate) fn largest_modulus(a: &Mat<f64>) -> Result<f64, SpectrumError> {
    Ok(eigenvalues(a)?
        .iter()
        .map(|z| z.re.hypot(z.im))
        .fold(0.0, f64::max))
}

/// Largest modulus of the eigenvalues of a square matrix.
///
/// # Errors
/// [`SpectrumError::Input`] for a matrix that is not square and finite,
/// [`SpectrumError::NoConvergence`] where the QR algorithm gives up.
pub fn spectral_radius(a: MatRef<'_, f64>) -> Result<f64, SpectrumError> {
    if a.nrows() == 0 {
        return Err(InputError::Empty { name: "A" }.into());
    }
    largest_modulus(&input::matrix("A", a, (a.nrows(), a.nrows()))?)
}

/// X = A'XA + Q by squaring. `None` where the powers of A do not vanish.
pub(crate) fn lyapunov_sum(a: &Mat<f64>, q: &Mat<f64>) -> Option<Mat<f64>> {
    if let Some(sum) = by_states!(a.nrows(), smith_sum(a, q, MAX_SQUARINGS)) {
        return sum;
    }
    let mut power = a.clone();
    let mut x = q.clone();
    for _ in 0..MAX_SQUARINGS {
        let size = norm(&power);
        if !size.is_finite() || size > 1e120 {
            return None;
        }
        x = add_scaled(&x, 1.0, &congruence(&power, &x));
        if size < 1e-9 {
            return norm(&x).is_finite().then_some(x);
        }
        power = mul(&power, &power);
    }
    None
}

/// The solution X of X = A'XA + Q for A with spectral radius below one.
///
/// X is symmetric; for Q >= 0 it is the cost sum of x'Qx along x+ = Ax.
///
/// # Errors
/// [`SpectrumError::Unstable`] with the spectral radius where the sum diverges, and the errors of
/// [`spectral_radius`].
pub fn discrete_lyapunov(
    a: MatRef<'_, f64>,
    q: MatRef<'_, f64>,
) -> Result<Mat<f64>, SpectrumError> {
    let n = a.nrows();
    if n == 0 {
        return Err(InputError::Empty { name: "A" }.into());
    }
    let a = input::matrix("A", a, (n, n))?;
    let q = input::symmetric("Q", q, n)?;
    let spectral_radius = largest_modulus(&a)?;
    let unstable = SpectrumError::Unstable { spectral_radius };
    if spectral_radius >= 1.0 {
        return Err(unstable);
    }
    let x = lyapunov_sum(&a, &q).ok_or(unstable)?;
    // One step of refinement: the sum has rounding of every squaring, its residual does not.
    let residual = add_scaled(&add_scaled(&congruence(&a, &x), -1.0, &x), 1.0, &q);
    Ok(match lyapunov_sum(&a, &residual) {
        Some(correction) => add_scaled(&x, 1.0, &correction),
        None => x,
    })
}

/// Bound on the sum of |A^j|, j >= 0, or infinity.
pub(crate) fn sum_of_powers(a: &Mat<f64>) -> f64 {
    if let Some(sum) = by_states!(a.nrows(), power_sum(a, MAX_SQUARINGS)) {
        return sum;
    }
    let (mut power, mut sum) = (a.clone(), 1.0);
    for _ in 0..MAX_SQUARINGS {
        let size = norm(&power);
        // The product of the remaining factors is below 1 / (1 - size).
        if size < 1e-3 {
            return sum / (1.0 - 2.0 * size);
        }
        sum *= 1.0 + size;
        power = mul(&power, &power);
    }
    f64::INFINITY
}
