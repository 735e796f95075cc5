//! Zeros on the unit circle that the stage cost does not see, also where R is singular.
//!
//! z with [A - zI, B; Q, S; S', R] (x, u) = 0 is a trajectory x_k = z^k x that costs nothing. With |z| = 1 no stabilising solution exists.
//! For an invertible R it is an unseen mode of A - BR^-1S' (`hautus::unseen_modes`); for a singular one it is no eigenvalue
//! of the data, so the search starts at the slow eigenvalues of a closed loop, which tend to it, and alternates (x, u), the
//! smallest right singular vector, with z = x*(Ax + Bu) / x*x on the circle. Every column is scaled to one length, so units do not matter.

use crate::arithmetic::dense::norm;
use crate::modes::hautus::tolerance;
use crate::modes::mode::UnobservableMode;
use crate::modes::spectrum::{self, SpectrumError};
use crate::riccati::problem::Problem;
use faer::{Mat, c64};

/// Closed-loop eigenvalues inside this radius are far from a zero on the circle.
const INNERMOST_MODULUS: f64 = 0.99;
const MAX_REFINEMENTS: usize = 20;

/// A zero on the unit circle next to a slow eigenvalue of `closed_loop`, if there is one.
pub(crate) fn free_zero_on_circle(
    problem: &Problem,
    closed_loop: &Mat<f64>,
) -> Result<Option<UnobservableMode>, SpectrumError> {
    let pencil = Pencil::of(problem);
    for start in spectrum::eigenvalues(closed_loop)? {
        let modulus = start.re.hypot(start.im);
        if modulus < INNERMOST_MODULUS || start.im < 0.0 {
            continue;
        }
        let mut best = pencil.at(start * (1.0 / modulus));
        for _ in 0..MAX_REFINEMENTS {
            let Some(next) = best.as_ref().and_then(|(mode, input)| {
                pencil.at(pencil.quotient(&mode.right_eigenvector, input)?)
            }) else {
                break;
            };
            if !best
                .as_ref()
                .is_some_and(|(mode, _)| next.0.measure < 0.99 * mode.measure)
            {
                break;
            }
            best = Some(next);
        }
        if let Some((mode, _)) = best.filter(|(mode, _)| mode.measure < mode.tolerance) {
            return Ok(Some(mode));
        }
    }
    Ok(None)
}

/// [A, B; Q, S; S', R] with the weights of norm 1 + |A| and each input in its own unit.
struct Pencil {
    states: usize,
    scale: f64,
    data: Mat<f64>,
}

impl Pencil {
    fn of(problem: &Problem) -> Self {
        let (n, m) = (problem.states(), problem.b.ncols());
        let scale = 1.0 + norm(&problem.a);
        let mut data = Mat::from_fn(2 * n + m, n + m, |i, j| match (i, j < n) {
            (i, true) if i < n => problem.a[(i, j)],
            (i, false) if i < n => problem.b[(i, j - n)],
            (i, true) if i < 2 * n => problem.q[(i - n, j)],
            (i, false) if i < 2 * n => problem.s.as_ref().map_or(0.0, |s| s[(i - n, j - n)]),
            (i, true) => problem.s.as_ref().map_or(0.0, |s| s[(j, i - 2 * n)]),
            (i, false) => problem.r[(i - 2 * n, j - n)],
        });
        // A row of the weights is an equation: its length is free. So is the unit of an input.
        for i in n..2 * n + m {
            let length = (0..n + m).map(|j| data[(i, j)].powi(2)).sum::<f64>().sqrt();
            for j in 0..n + m {
                data[(i, j)] *= if length > 0.0 { scale / length } else { 1.0 };
            }
        }
        for j in n..n + m {
            let length = (0..2 * n + m)
                .map(|i| data[(i, j)].powi(2))
                .sum::<f64>()
                .sqrt();
            for x in data.col_as_slice_mut(j) {
                *x *= if length > 0.0 { scale / length } else { 1.0 };
            }
        }
        Self {
            states: n,
            scale,
            data,
        }
    }

    /// The mode at z and its input; `None` where the singular values cannot be computed or no state moves.
    fn at(&self, z: c64) -> Option<(UnobservableMode, Vec<c64>)> {
        let (n, width) = (self.states, self.data.ncols());
        let shifted = Mat::<c64>::from_fn(self.data.nrows(), width, |i, j| {
            let entry = c64::new(self.data[(i, j)], 0.0);
            if i == j && i < n { entry - z } else { entry }
        });
        let svd = shifted.thin_svd().ok()?;
        let measure = svd.S().column_vector()[width - 1].re / self.scale;
        let vector: Vec<c64> = (0..width).map(|i| svd.V()[(i, width - 1)]).collect();
        let length = vector[..n]
            .iter()
            .map(|x| x.re * x.re + x.im * x.im)
            .sum::<f64>()
            .sqrt();
        // An input without effect and cost is another defect, told by R + B'PB.
        if !(length > 1e-6) {
            return None;
        }
        let unit = |part: &[c64]| part.iter().map(|x| *x * (1.0 / length)).collect();
        let mode = UnobservableMode {
            eigenvalue: z,
            right_eigenvector: unit(&vector[..n]),
            measure,
            tolerance: tolerance(n),
        };
        Some((mode, unit(&vector[n..])))
    }

    /// x*(Ax + Bu) for a unit x, moved to the circle.
    fn quotient(&self, x: &[c64], u: &[c64]) -> Option<c64> {
        let mut sum = c64::new(0.0, 0.0);
        for (i, xi) in x.iter().enumerate() {
            for (j, v) in x.iter().chain(u).enumerate() {
                sum += xi.conj() * v * self.data[(i, j)];
            }
        }
        let modulus = sum.re.hypot(sum.im);
        (modulus > 0.5).then(|| sum * (1.0 / modulus))
    }
}
