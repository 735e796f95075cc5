//! Small dense kernels on column-major matrices: products, an LU and a Cholesky factorisation.
//!
//! Control problems have a handful of states. At that size a general library spends longer on
//! dispatch than on arithmetic (a 6-by-2 Riccati solution makes some hundred products), so the
//! products run over contiguous columns. Spectral work (eigenvalues, singular values) stays with faer.

use faer::{Mat, MatRef};

/// `y += s x`.
fn axpy(y: &mut [f64], s: f64, x: &[f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += s * x;
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Entries that fit the copy of a left factor on the stack: eight states.
const STACK: usize = 64;

/// Hands the columns of `a` to `product` as one slice: a column's view costs as much as a product with it.
fn with_columns<T>(a: &Mat<f64>, product: impl FnOnce(&[f64]) -> T) -> T {
    let (rows, size) = (a.nrows(), a.nrows() * a.ncols());
    let (mut stack, mut heap) = ([0.0; STACK], Vec::new());
    let copy = if size <= STACK {
        &mut stack[..size]
    } else {
        heap.resize(size, 0.0);
        &mut heap[..]
    };
    for k in 0..a.ncols() {
        copy[k * rows..(k + 1) * rows].copy_from_slice(a.col_as_slice(k));
    }
    product(copy)
}

/// `a b`.
pub(crate) fn mul(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    debug_assert_eq!(a.ncols(), b.nrows());
    let rows = a.nrows();
    let mut c = Mat::zeros(rows, b.ncols());
    with_columns(a, |columns| {
        for j in 0..b.ncols() {
            let y = c.col_as_slice_mut(j);
            for (column, &s) in columns.chunks_exact(rows).zip(b.col_as_slice(j)) {
                axpy(y, s, column);
            }
        }
    });
    c
}

/// `a' b`.
pub(crate) fn tr_mul(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    debug_assert_eq!(a.nrows(), b.nrows());
    let rows = a.nrows();
    let mut c = Mat::zeros(a.ncols(), b.ncols());
    with_columns(a, |columns| {
        for j in 0..b.ncols() {
            let x = b.col_as_slice(j);
            for (y, column) in c
                .col_as_slice_mut(j)
                .iter_mut()
                .zip(columns.chunks_exact(rows))
            {
                *y = dot(column, x);
            }
        }
    });
    c
}

/// `a b'`.
pub(crate) fn mul_tr(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    mul(a, &b.transpose().to_owned())
}

/// `a' w a` for symmetric `w`, symmetric to the last bit.
pub(crate) fn congruence(a: &Mat<f64>, w: &Mat<f64>) -> Mat<f64> {
    let wa = mul(w, a);
    let mut c = tr_mul(a, &wa);
    symmetrise(&mut c);
    c
}

/// Replaces `a` with `(a + a') / 2`.
pub(crate) fn symmetrise(a: &mut Mat<f64>) {
    for j in 0..a.ncols() {
        for i in 0..j {
            let mean = 0.5 * a[(i, j)] + 0.5 * a[(j, i)];
            a[(i, j)] = mean;
            a[(j, i)] = mean;
        }
    }
}

/// Frobenius norm of an owned matrix, scaled so that it neither overflows nor underflows.
pub(crate) fn norm(a: &Mat<f64>) -> f64 {
    let sum: f64 = (0..a.ncols())
        .map(|j| dot(a.col_as_slice(j), a.col_as_slice(j)))
        .sum();
    if sum.is_normal() && sum < 1e300 {
        return sum.sqrt();
    }
    let largest = max_abs(a.as_ref());
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let mut sum = 0.0;
    for j in 0..a.ncols() {
        sum += a
            .col_as_slice(j)
            .iter()
            .map(|x| (x / largest).powi(2))
            .sum::<f64>();
    }
    largest * sum.sqrt()
}

/// Largest absolute entry; NaN if an entry is NaN.
pub(crate) fn max_abs(a: MatRef<'_, f64>) -> f64 {
    let mut largest = 0.0_f64;
    for j in 0..a.ncols() {
        for i in 0..a.nrows() {
            let x = a[(i, j)].abs();
            if x > largest || x.is_nan() {
                largest = x;
            }
        }
    }
    largest
}

/// Largest absolute column sum.
pub(crate) fn norm_one(a: &Mat<f64>) -> f64 {
    (0..a.ncols())
        .map(|j| a.col_as_slice(j).iter().map(|x| x.abs()).sum::<f64>())
        .fold(0.0, f64::max)
}

/// Gaussian elimination with partial pivoting: overwrites `rhs` with `a^-1 rhs`.
///
/// `None` when a pivot is exactly zero or not finite.
pub(crate) fn solve(mut a: Mat<f64>, mut rhs: Mat<f64>) -> Option<Mat<f64>> {
    let n = a.nrows();
    for k in 0..n {
        let column = a.col_as_slice(k);
        let pivot = (k..n).max_by(|&i, &j| column[i].abs().total_cmp(&column[j].abs()))?;
        if column[pivot] == 0.0 || !column[pivot].is_finite() {
            return None;
        }
        let inverse = 1.0 / column[pivot];
        let swap = |m: &mut Mat<f64>, from: usize| {
            if pivot != k {
                for j in from..m.ncols() {
                    m.col_as_slice_mut(j).swap(k, pivot);
                }
            }
        };
        swap(&mut a, k);
        swap(&mut rhs, 0);
        let factors: Vec<f64> = a.col_as_slice(k)[k + 1..]
            .iter()
            .map(|x| x * inverse)
            .collect();
        for j in k + 1..n {
            let column = a.col_as_slice_mut(j);
            let s = column[k];
            axpy(&mut column[k + 1..], -s, &factors);
        }
        for j in 0..rhs.ncols() {
            let column = rhs.col_as_slice_mut(j);
            let s = column[k];
            axpy(&mut column[k + 1..], -s, &factors);
        }
    }
    for j in 0..rhs.ncols() {
        let x = rhs.col_as_slice_mut(j);
        for k in (0..n).rev() {
            x[k] /= a[(k, k)];
            let s = x[k];
            axpy(&mut x[..k], -s, &a.col_as_slice(k)[..k]);
        }
    }
    Some(rhs)
}

/// Lower Cholesky factor, or `None` where the matrix is not numerically positive definite.
pub(crate) fn cholesky(a: &Mat<f64>) -> Option<Mat<f64>> {
    let n = a.nrows();
    let mut l = Mat::<f64>::zeros(n, n);
    for j in 0..n {
        l.col_as_slice_mut(j)[j..].copy_from_slice(&a.col_as_slice(j)[j..]);
        for k in 0..j {
            let s = l[(j, k)];
            for i in j..n {
                l[(i, j)] -= s * l[(i, k)];
            }
        }
        // Written so that NaN is refused as well.
        let pivot = l[(j, j)];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let root = pivot.sqrt();
        for x in &mut l.col_as_slice_mut(j)[j..] {
            *x /= root;
        }
    }
    Some(l)
}

/// `rhs <- l^-1 rhs` for a lower factor.
pub(crate) fn forward_substitute(l: &Mat<f64>, rhs: &mut Mat<f64>) {
    for j in 0..rhs.ncols() {
        let x = rhs.col_as_slice_mut(j);
        for k in 0..l.nrows() {
            x[k] /= l[(k, k)];
            let s = x[k];
            axpy(&mut x[k + 1..], -s, &l.col_as_slice(k)[k + 1..]);
        }
    }
}

/// `rhs <- (l l')^-1 rhs`.
pub(crate) fn cholesky_solve(l: &Mat<f64>, mut rhs: Mat<f64>) -> Mat<f64> {
    forward_substitute(l, &mut rhs);
    for j in 0..rhs.ncols() {
        let x = rhs.col_as_slice_mut(j);
        for k in (0..l.nrows()).rev() {
            let tail = dot(&x[k + 1..], &l.col_as_slice(k)[k + 1..]);
            x[k] = (x[k] - tail) / l[(k, k)];
        }
    }
    rhs
}

pub(crate) fn identity(n: usize) -> Mat<f64> {
    Mat::identity(n, n)
}

/// `a + s b`.
pub(crate) fn add_scaled(a: &Mat<f64>, s: f64, b: &Mat<f64>) -> Mat<f64> {
    let mut c = a.clone();
    accumulate(&mut c, s, b);
    c
}

/// `a += s b`.
pub(crate) fn accumulate(a: &mut Mat<f64>, s: f64, b: &Mat<f64>) {
    for j in 0..a.ncols() {
        axpy(a.col_as_slice_mut(j), s, b.col_as_slice(j));
    }
}
