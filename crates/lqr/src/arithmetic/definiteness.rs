//! Positive semidefinite up to rounding, of given weights and of computed matrices.
//!
//! A *given* weight is judged entry by entry: with T = diag, powers of two, next to the roots of its diagonal, T^-1 W T^-1 has ones there,
//! whatever the units. A weight that was itself computed, Q - SR^-1S' say, carries some roundings of its
//! largest entry: two ulps of it are forgiven on the diagonal, and rounding of the scaled matrix. A *computed* matrix
//! has rounding of the size of its largest entry in each of them, and is judged by that.

use crate::arithmetic::dense::{add_scaled, cholesky, congruence, identity, max_abs, norm};
use crate::arithmetic::fixed_size::{by_states, is_definite};
use crate::arithmetic::scaling::scaled;
use faer::{Mat, Side};

/// Rounding a row, relative to the diagonal.
const ROUNDING: f64 = 1e-12;
/// Of the largest entry of a weight.
const COMPUTED_BY_HAND: f64 = 2.0 * f64::EPSILON;
/// Of the largest entry of P: nothing, in double-double.
const VANISHING: f64 = 1e-24;

/// The least eigenvalue and the tolerance if the computed matrix `w` is indefinite beyond rounding, else `None`.
pub(crate) fn indefinite(w: &Mat<f64>) -> Option<(f64, f64)> {
    let tolerance = ROUNDING * w.nrows() as f64 * max_abs(w.as_ref());
    if tolerance == 0.0 || is_definite_above(w, tolerance) {
        return None;
    }
    let least = least_eigenvalue(w);
    (!(least >= -tolerance)).then_some((least, tolerance))
}

/// The least eigenvalue and what was allowed for rounding if the given weight `w` is indefinite, in whatever units, else `None`.
pub(crate) fn indefinite_weight(w: &Mat<f64>) -> Option<(f64, f64)> {
    indefinite_at_unit_diagonal(w, COMPUTED_BY_HAND, ROUNDING)
}

/// Whether a computed P is indefinite where it is small, in whatever units: the rounding of its large entries may hide the sign there.
pub(crate) fn loses_its_sign(p: &Mat<f64>) -> bool {
    indefinite_at_unit_diagonal(p, VANISHING, 1e3 * ROUNDING).is_some()
}

/// The least eigenvalue and what was allowed if a P, given or computed, is indefinite in whatever units, else `None`: every P that
/// `Dare` returns passes, and so does a given one that rounding made negative.
pub(crate) fn indefinite_cost(p: &Mat<f64>) -> Option<(f64, f64)> {
    indefinite(p).or_else(|| indefinite_weight(p).filter(|_| loses_its_sign(p)))
}

/// With `allowed` of the largest entry added to the diagonal, and the diagonal then scaled to one, up to `rounding` a row.
fn indefinite_at_unit_diagonal(w: &Mat<f64>, allowed: f64, rounding: f64) -> Option<(f64, f64)> {
    // A factor settles it in whatever units: its rounding is relative to the diagonal entries of each pair.
    if is_definite_above(w, 0.0) {
        return None;
    }
    let n = w.nrows();
    let largest = max_abs(w.as_ref());
    let allowed = allowed * largest;
    let shifted = add_scaled(w, allowed, &identity(n));
    let down: Vec<f64> = (0..n).map(|i| unit_of(shifted[(i, i)].abs())).collect();
    let unit = scaled(&shifted, &down, &down);
    if largest == 0.0 || is_definite_above(&unit, rounding * n as f64) {
        return None;
    }
    // A direction that the units hide from the eigenvalues of W shows in the scaled matrix.
    let hidden = scaled(w, &down, &down)
        .self_adjoint_eigen(Side::Lower)
        .map_or(f64::NAN, |eigen| {
            let x = Mat::from_fn(n, 1, |i, _| down[i] * eigen.U()[(i, 0)]);
            congruence(&x, w)[(0, 0)] / norm(&x).powi(2)
        });
    Some((least_eigenvalue(w).min(hidden), allowed))
}

/// The power of two next to 1 / sqrt(x), within the range whose squares are finite.
fn unit_of(x: f64) -> f64 {
    (-0.5 * x.log2()).round().clamp(-500.0, 500.0).exp2()
}

/// Whether w + shift I has a Cholesky factor.
fn is_definite_above(w: &Mat<f64>, shift: f64) -> bool {
    match by_states!(w.nrows(), is_definite(w, shift)) {
        Some(definite) => definite,
        None => cholesky(&add_scaled(w, shift, &identity(w.nrows()))).is_some(),
    }
}

fn least_eigenvalue(w: &Mat<f64>) -> f64 {
    w.self_adjoint_eigenvalues(Side::Lower)
        .ok()
        .and_then(|values| values.into_iter().reduce(f64::min))
        .unwrap_or(f64::NAN)
}
