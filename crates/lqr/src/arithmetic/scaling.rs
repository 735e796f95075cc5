//! Diagonal scaling by powers of two, so that no digit changes.

use faer::Mat;

const MAX_SWEEPS: usize = 30;

/// w <- diag(rows) w diag(cols).
pub(crate) fn scale(w: &mut Mat<f64>, rows: &[f64], cols: &[f64]) {
    for (j, col) in cols.iter().enumerate() {
        for (x, row) in w.col_as_slice_mut(j).iter_mut().zip(rows) {
            *x *= row * col;
        }
    }
}

/// diag(rows) w diag(cols).
pub(crate) fn scaled(w: &Mat<f64>, rows: &[f64], cols: &[f64]) -> Mat<f64> {
    let mut w = w.clone();
    scale(&mut w, rows, cols);
    w
}

/// The power of two next to `x`; 1 where `x` has none in range.
pub(crate) fn power_of_two(x: f64) -> f64 {
    const BIAS: u64 = 1023;
    // The power next to x is the one below x sqrt(2). A sign, NaN and infinity make an exponent that is out of range.
    let exponent = (x * std::f64::consts::SQRT_2).to_bits() >> 52;
    if exponent.abs_diff(BIAS) <= 160 {
        f64::from_bits(exponent << 52)
    } else {
        1.0
    }
}

/// Brings the n x n matrix in `columns` to coordinates where each state's row and column have the same sum of moduli (Parlett and Reinsch): computed
/// eigenvalues then carry rounding of *that* matrix, not of the largest entry that the units make.
pub(crate) fn level<C: AsMut<[f64]> + AsRef<[f64]>>(columns: &mut [C]) {
    let n = columns.len();
    for _ in 0..MAX_SWEEPS {
        let mut settled = true;
        for i in 0..n {
            let (mut enters, mut leaves) = (0.0, 0.0);
            for (j, column) in columns.iter().enumerate().filter(|&(j, _)| j != i) {
                enters += column.as_ref()[i].abs();
                leaves += columns[i].as_ref()[j].abs();
            }
            // A factor that gains less than this is not worth another sweep.
            if enters == 0.0 || leaves == 0.0 || (0.25..=4.0).contains(&(enters / leaves)) {
                continue;
            }
            let factor = power_of_two((enters / leaves).sqrt());
            settled &= factor == 1.0;
            for (j, column) in columns.iter_mut().enumerate() {
                let column = column.as_mut();
                if j == i {
                    let own = column[i];
                    column[..n].iter_mut().for_each(|x| *x *= factor);
                    column[i] = own;
                } else {
                    column[i] /= factor;
                }
            }
        }
        if settled {
            break;
        }
    }
}
