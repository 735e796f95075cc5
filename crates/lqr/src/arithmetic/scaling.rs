//! Diagonal scaling by powers of two, so that no digit changes.

use faer::Mat;

const MAX_SWEEPS: usize = 30;

/// diag(rows) w diag(cols).
pub(crate) fn scaled(w: &Mat<f64>, rows: &[f64], cols: &[f64]) -> Mat<f64> {
    let mut w = w.clone();
    for (j, col) in cols.iter().enumerate() {
        for (x, row) in w.col_as_slice_mut(j).iter_mut().zip(rows) {
            *x *= row * col;
        }
    }
    w
}

/// The power of two next to `x`; 1 where `x` has none in range.
pub(crate) fn power_of_two(x: f64) -> f64 {
    let exponent = x.log2().round();
    if exponent.is_finite() && exponent.abs() <= 160.0 {
        exponent.exp2()
    } else {
        1.0
    }
}

/// `a` in coordinates where each state's row and column have the same sum of moduli (Parlett and Reinsch): computed eigenvalues then carry rounding
/// of *that* matrix, not of the largest entry that the units make.
pub(crate) fn level(a: &Mat<f64>) -> Mat<f64> {
    let (n, mut level) = (a.nrows(), a.clone());
    for _ in 0..MAX_SWEEPS {
        let mut settled = true;
        for i in 0..n {
            let others = || (0..n).filter(|&j| j != i);
            let enters: f64 = others().map(|j| level[(i, j)].abs()).sum();
            let leaves: f64 = others().map(|j| level[(j, i)].abs()).sum();
            // A factor that gains less than this is not worth another sweep.
            if enters == 0.0 || leaves == 0.0 || (0.25..=4.0).contains(&(enters / leaves)) {
                continue;
            }
            let factor = power_of_two((enters / leaves).sqrt());
            settled &= factor == 1.0;
            for j in others() {
                level[(i, j)] /= factor;
                level[(j, i)] *= factor;
            }
        }
        if settled {
            break;
        }
    }
    level
}
