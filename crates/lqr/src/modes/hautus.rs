//! Hautus tests: which modes no input reaches, and which the weight does not see.
//!
//! A mode (lambda, w) with w*A = lambda w* is reached by no input iff w*B = 0. In floating point the question is
//! how far the pair is from having such a mode with |lambda| >= 1, so the measure is the smallest
//! singular value of [A - lambda I, B D], where D gives every non-zero column of B the norm of A:
//! units of an input then do not matter. It is taken at the eigenvalues of A, moved to a local minimum
//! by alternating w (smallest left singular vector) and the better of lambda = w*Aw and a Newton step, because a defective eigenvalue of multiplicity k is
//! computed with an error of rounding^(1/k) and the measure there is too large; a minimum inside the circle is then moved
//! out to it. Not searched: the whole region |lambda| >= 1 (only minima that start at eigenvalues).

use crate::arithmetic::dense;
use crate::input;
use crate::modes::mode::{Stabilisability, UncontrollableMode, UnobservableMode};
use crate::modes::spectrum::{self, SpectrumError};
use faer::{Mat, MatRef, c64};

/// Modes inside this radius are not searched: their measure on the circle cannot be near rounding.
const INNERMOST_MODULUS: f64 = 0.9;
const MAX_REFINEMENTS: usize = 12;

/// Relative distance below which a pair counts as one with an unreached mode: a thousand roundings a state.
pub(crate) fn tolerance(states: usize) -> f64 {
    1e3 * states as f64 * f64::EPSILON
}

/// Tests every mode of A (n x n) on or outside the unit circle for reachability through B (n x m).
///
/// # Errors
/// [`SpectrumError`] for a malformed input or an eigenvalue iteration that does not converge.
pub fn stabilisability(
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
) -> Result<Stabilisability, SpectrumError> {
    let (a, b) = input::pair(a, b)?;
    unreached_modes(&a, &b)
}

pub(crate) fn unreached_modes(
    a: &Mat<f64>,
    b: &Mat<f64>,
) -> Result<Stabilisability, SpectrumError> {
    let search = Search::new(a, b);
    let mut modes = Vec::new();
    for start in candidates(a)? {
        let mut mode = search.descend(start);
        let modulus = mode.eigenvalue.re.hypot(mode.eigenvalue.im);
        if modulus < 1.0 {
            mode = search.at(mode.eigenvalue * (1.0 / modulus));
        }
        insert(&mut modes, mode);
    }
    let weakest = modes
        .iter()
        .min_by(|x, y| x.measure.total_cmp(&y.measure))
        .cloned();
    modes.retain(|mode| mode.measure < mode.tolerance);
    for mode in &mut modes {
        mode.eigenvalue_shift = search.eigenvalue_shift(mode);
    }
    let (unreached, undecided) = modes.into_iter().partition(UncontrollableMode::is_certain);
    Ok(Stabilisability {
        unreached,
        undecided,
        weakest,
    })
}

pub(crate) fn unseen_modes(
    a: &Mat<f64>,
    q: &Mat<f64>,
) -> Result<Vec<UnobservableMode>, SpectrumError> {
    let transposed = a.transpose().to_owned();
    let search = Search::new(&transposed, q);
    let mut modes = Vec::new();
    for start in candidates(a)? {
        let found = search.descend(start);
        let modulus = found.eigenvalue.re.hypot(found.eigenvalue.im);
        if modulus > 0.5 {
            insert(&mut modes, search.at(found.eigenvalue * (1.0 / modulus)));
        }
    }
    modes.retain(|mode| mode.measure < mode.tolerance);
    Ok(modes
        .into_iter()
        .map(|mode| UnobservableMode {
            eigenvalue: mode.eigenvalue,
            right_eigenvector: mode.left_eigenvector.iter().map(c64::conj).collect(),
            measure: mode.measure,
            tolerance: mode.tolerance,
        })
        .collect())
}

/// Eigenvalues not well inside the circle, one of each conjugate pair.
fn candidates(a: &Mat<f64>) -> Result<Vec<c64>, SpectrumError> {
    let mut values = spectrum::eigenvalues(a)?;
    values.retain(|z| z.re.hypot(z.im) >= INNERMOST_MODULUS && z.im >= 0.0);
    Ok(values)
}

/// Keeps one entry a mode: refinement leads the members of a cluster to the same minimum.
fn insert(modes: &mut Vec<UncontrollableMode>, mode: UncontrollableMode) {
    let same = |other: &&mut UncontrollableMode| {
        let overlap: c64 = mode
            .left_eigenvector
            .iter()
            .zip(&other.left_eigenvector)
            .map(|(x, y)| x.conj() * y)
            .fold(c64::new(0.0, 0.0), |sum, z| sum + z);
        let gap = mode.eigenvalue - other.eigenvalue;
        gap.re.hypot(gap.im) < 1e-6 && overlap.re.hypot(overlap.im) > 0.999
    };
    match modes.iter_mut().find(same) {
        Some(other) if other.measure <= mode.measure => {}
        Some(other) => *other = mode,
        None => modes.push(mode),
    }
}

/// The pair with the columns of B scaled, ready to be measured at any lambda.
struct Search<'a> {
    a: &'a Mat<f64>,
    columns: Mat<f64>,
    scale: f64,
    tolerance: f64,
}

impl<'a> Search<'a> {
    fn new(a: &'a Mat<f64>, b: &Mat<f64>) -> Self {
        let scale = 1.0 + dense::norm(a);
        Self {
            a,
            columns: normalised_columns(b, scale),
            scale,
            tolerance: tolerance(a.nrows()),
        }
    }

    fn at(&self, eigenvalue: c64) -> UncontrollableMode {
        let (n, m) = (self.a.nrows(), self.columns.ncols());
        let pencil = Mat::<c64>::from_fn(n, n + m, |i, j| {
            if j >= n {
                return c64::new(self.columns[(i, j - n)], 0.0);
            }
            let entry = c64::new(self.a[(i, j)], 0.0);
            if i == j { entry - eigenvalue } else { entry }
        });
        let (measure, left_eigenvector) = match pencil.thin_svd() {
            Ok(svd) => {
                let u = svd.U();
                let sigma = svd.S().column_vector()[n - 1].re;
                (sigma / self.scale, (0..n).map(|i| u[(i, n - 1)]).collect())
            }
            // Not a finding: a measure that never counts as zero.
            Err(_) => (f64::INFINITY, vec![c64::new(0.0, 0.0); n]),
        };
        UncontrollableMode {
            eigenvalue,
            column_change: self.column_change(eigenvalue, &left_eigenvector),
            left_eigenvector,
            measure,
            tolerance: self.tolerance,
            eigenvalue_shift: 0.0,
        }
    }

    /// eps |A| / |V*w|, V an orthonormal basis of the right eigenspace: of a multiple eigenvalue some vector of it must meet w.
    fn eigenvalue_shift(&self, mode: &UncontrollableMode) -> f64 {
        let n = self.a.nrows();
        let shifted = Mat::<c64>::from_fn(n, n, |i, j| {
            let entry = c64::new(self.a[(i, j)], 0.0);
            if i == j {
                entry - mode.eigenvalue
            } else {
                entry
            }
        });
        let Ok(svd) = shifted.svd() else {
            return f64::INFINITY;
        };
        let (v, sigma) = (svd.V(), svd.S().column_vector());
        let null = |&j: &usize| j + 1 == n || sigma[j].re < self.tolerance * self.scale;
        let square: f64 = (0..n)
            .filter(null)
            .map(|j| {
                let overlap = (0..n).fold(c64::new(0.0, 0.0), |sum, i| {
                    sum + v[(i, j)].conj() * mode.left_eigenvector[i]
                });
                overlap.re * overlap.re + overlap.im * overlap.im
            })
            .sum();
        f64::EPSILON * self.scale / square.sqrt()
    }

    fn column_change(&self, eigenvalue: c64, w: &[c64]) -> f64 {
        let mut largest = 0.0_f64;
        for (matrix, moved) in [(self.a, true), (&self.columns, false)] {
            for j in 0..matrix.ncols() {
                let column = matrix.col_as_slice(j);
                let mut sum = c64::new(0.0, 0.0);
                let mut length = column.iter().map(|x| x * x).sum::<f64>().sqrt();
                for (w, &x) in w.iter().zip(column) {
                    sum += w.conj() * x;
                }
                if moved {
                    sum -= w[j].conj() * eigenvalue;
                    length += eigenvalue.re.hypot(eigenvalue.im);
                }
                let size = sum.re.hypot(sum.im);
                if size > 0.0 {
                    largest = largest.max(size / length);
                }
            }
        }
        largest
    }

    fn descend(&self, start: c64) -> UncontrollableMode {
        let mut best = self.at(start);
        for _ in 0..MAX_REFINEMENTS {
            let by_quotient = self.at(self.quotient(&best.left_eigenvector));
            let by_newton = self.at(self.newton(&best));
            let next = if by_newton.measure < by_quotient.measure {
                by_newton
            } else {
                by_quotient
            };
            if !(next.measure < 0.99 * best.measure) {
                break;
            }
            best = next;
        }
        best
    }

    /// The zero of the tangent to w*[A - lambda I, B]v, v the right singular vector to w: where w is skewed against the eigenvector, w*Aw
    /// is off by its first-order error and this is not.
    fn newton(&self, mode: &UncontrollableMode) -> c64 {
        let w = &mode.left_eigenvector;
        // v = [A - lambda I, B]*w / sigma, so w*v = sum of |w*..|^2 over sigma: only its part on the states moves with lambda.
        let on_states = (0..self.a.ncols()).map(|j| {
            let sum = (0..w.len()).fold(-(w[j].conj() * mode.eigenvalue), |sum, i| {
                sum + w[i].conj() * self.a[(i, j)]
            });
            (w[j], sum)
        });
        let overlap = on_states.fold(c64::new(0.0, 0.0), |total, (w, v)| {
            total + w.conj() * v.conj()
        });
        let square = overlap.re * overlap.re + overlap.im * overlap.im;
        let sigma = mode.measure * self.scale;
        if square > 0.0 {
            mode.eigenvalue + overlap.conj() * (sigma * sigma / square)
        } else {
            mode.eigenvalue
        }
    }

    /// w*Aw, the lambda with the least |w*(A - lambda I)|.
    fn quotient(&self, w: &[c64]) -> c64 {
        let mut sum = c64::new(0.0, 0.0);
        for (j, wj) in w.iter().enumerate() {
            for (i, wi) in w.iter().enumerate() {
                sum += wi.conj() * wj * self.a[(i, j)];
            }
        }
        sum
    }
}

/// B with each non-zero column scaled to the given norm.
pub(crate) fn normalised_columns(b: &Mat<f64>, target: f64) -> Mat<f64> {
    let mut scaled = b.clone();
    for j in 0..b.ncols() {
        let column = Mat::from_fn(b.nrows(), 1, |i, _| b[(i, j)]);
        let length = dense::norm(&column);
        if length > 0.0 {
            for x in scaled.col_as_slice_mut(j) {
                *x = *x / length * target;
            }
        }
    }
    scaled
}
