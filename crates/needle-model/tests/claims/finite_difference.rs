//! Central differences with one Richardson extrapolation: fourth order, truth independent of any
//! analytic derivative.

use nalgebra::SVector;

/// Derivative at 0 of `f` along a scalar, from steps `h` and `h / 2`.
pub(crate) fn derivative<const R: usize>(
    h: f64,
    f: impl Fn(f64) -> SVector<f64, R>,
) -> SVector<f64, R> {
    let central = |h: f64| (f(h) - f(-h)) / (2.0 * h);
    (central(0.5 * h) * 4.0 - central(h)) / 3.0
}
