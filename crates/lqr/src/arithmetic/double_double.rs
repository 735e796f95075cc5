//! Double-double arithmetic, 106 bits: a number is the unevaluated sum of two doubles, the second below half an ulp of the first.
//!
//! Sums and products are error-free transformations (Dekker 1971; Knuth, TAOCP 2, 4.2.2; Hida, Li and Bailey 2001), so the relative error of
//! an operation is about 2^-104. Only what the Riccati equation needs: matrix products, elimination, a Cholesky
//! factor. Left out: range beyond that of a double; an overflow ends as NaN, which the callers refuse.

use faer::Mat;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// hi + lo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wide {
    hi: f64,
    lo: f64,
}

fn two_sum(x: f64, y: f64) -> Wide {
    let hi = x + y;
    let of_y = hi - x;
    Wide {
        hi,
        lo: (x - (hi - of_y)) + (y - of_y),
    }
}

/// As `two_sum` for |x| >= |y|.
fn quick_two_sum(x: f64, y: f64) -> Wide {
    let hi = x + y;
    Wide {
        hi,
        lo: y - (hi - x),
    }
}

impl Wide {
    pub(crate) const ZERO: Self = Self { hi: 0.0, lo: 0.0 };
    pub(crate) const ONE: Self = Self { hi: 1.0, lo: 0.0 };

    /// The nearest double.
    pub(crate) fn rounded(self) -> f64 {
        self.hi
    }

    fn sqrt(self) -> Self {
        let root = self.hi.sqrt();
        let rest = self - Self::from(root) * Self::from(root);
        quick_two_sum(root, rest.hi / (2.0 * root))
    }
}

impl From<f64> for Wide {
    fn from(hi: f64) -> Self {
        Self { hi, lo: 0.0 }
    }
}

impl Neg for Wide {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            hi: -self.hi,
            lo: -self.lo,
        }
    }
}

impl Add for Wide {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, low) = (two_sum(self.hi, other.hi), two_sum(self.lo, other.lo));
        let sum = quick_two_sum(high.hi, high.lo + low.hi);
        quick_two_sum(sum.hi, sum.lo + low.lo)
    }
}

impl Sub for Wide {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Wide {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = self.hi * other.hi;
        let error = self.hi.mul_add(other.hi, -product);
        quick_two_sum(product, error + (self.hi * other.lo + self.lo * other.hi))
    }
}

impl Div for Wide {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.hi / other.hi;
        let rest = self - other * Self::from(first);
        let second = rest.hi / other.hi;
        let rest = rest - other * Self::from(second);
        quick_two_sum(first, second) + Self::from(rest.hi / other.hi)
    }
}

/// A column-major matrix of double-doubles.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WideMat {
    rows: usize,
    cols: usize,
    entries: Vec<Wide>,
}

impl WideMat {
    pub(crate) fn from_fn(rows: usize, cols: usize, f: impl Fn(usize, usize) -> Wide) -> Self {
        let entries = (0..cols)
            .flat_map(|j| (0..rows).map(move |i| (i, j)))
            .map(|(i, j)| f(i, j))
            .collect();
        Self {
            rows,
            cols,
            entries,
        }
    }

    pub(crate) fn of(a: &Mat<f64>) -> Self {
        Self::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)].into())
    }

    pub(crate) fn identity(n: usize) -> Self {
        Self::from_fn(n, n, |i, j| if i == j { Wide::ONE } else { Wide::ZERO })
    }

    /// The nearest matrix of doubles.
    pub(crate) fn rounded(&self) -> Mat<f64> {
        Mat::from_fn(self.rows, self.cols, |i, j| self.at(i, j).rounded())
    }

    pub(crate) fn at(&self, i: usize, j: usize) -> Wide {
        self.entries[j * self.rows + i]
    }

    fn column(&self, j: usize) -> &[Wide] {
        &self.entries[j * self.rows..(j + 1) * self.rows]
    }

    fn column_mut(&mut self, j: usize) -> &mut [Wide] {
        &mut self.entries[j * self.rows..(j + 1) * self.rows]
    }

    pub(crate) fn transposed(&self) -> Self {
        Self::from_fn(self.cols, self.rows, |i, j| self.at(j, i))
    }

    pub(crate) fn mul(&self, b: &Self) -> Self {
        debug_assert_eq!(self.cols, b.rows);
        let mut c = Self::from_fn(self.rows, b.cols, |_, _| Wide::ZERO);
        for j in 0..b.cols {
            for k in 0..self.cols {
                let s = b.at(k, j);
                for (y, &x) in c.column_mut(j).iter_mut().zip(self.column(k)) {
                    *y = *y + x * s;
                }
            }
        }
        c
    }

    /// `self + s b`.
    pub(crate) fn plus(&self, s: f64, b: &Self) -> Self {
        let entries = self.entries.iter().zip(&b.entries);
        Self {
            entries: entries.map(|(&x, &y)| x + Wide::from(s) * y).collect(),
            ..*self
        }
    }

    /// `c' self c` for a symmetric `self`, symmetric to the last bit.
    pub(crate) fn congruence(&self, c: &Self) -> Self {
        c.transposed().mul(&self.mul(c)).symmetric_part()
    }

    pub(crate) fn symmetric_part(&self) -> Self {
        Self::from_fn(self.rows, self.cols, |i, j| {
            Wide::from(0.5) * (self.at(i.min(j), i.max(j)) + self.at(i.max(j), i.min(j)))
        })
    }

    /// Frobenius norm; infinite or NaN where an entry is, or where its square overflows.
    pub(crate) fn norm(&self) -> f64 {
        self.entries.iter().map(|x| x.hi * x.hi).sum::<f64>().sqrt()
    }

    /// `self^-1 rhs` by elimination with row pivots; `None` at a zero or infinite pivot.
    pub(crate) fn solve(mut self, mut rhs: Self) -> Option<Self> {
        let n = self.rows;
        for k in 0..n {
            let size = |i: &usize| self.at(*i, k).hi.abs();
            let pivot = (k..n).max_by(|i, j| size(i).total_cmp(&size(j)))?;
            if size(&pivot) == 0.0 || !size(&pivot).is_finite() {
                return None;
            }
            for m in [&mut self, &mut rhs] {
                for j in 0..m.cols {
                    m.column_mut(j).swap(k, pivot);
                }
            }
            let inverse = Wide::ONE / self.at(k, k);
            let factors: Vec<Wide> = self.column(k)[k + 1..]
                .iter()
                .map(|&x| x * inverse)
                .collect();
            for m in [&mut self, &mut rhs] {
                for j in 0..m.cols {
                    let column = m.column_mut(j);
                    let s = column[k];
                    for (x, &f) in column[k + 1..].iter_mut().zip(&factors) {
                        *x = *x - s * f;
                    }
                }
            }
        }
        for j in 0..rhs.cols {
            let x = rhs.column_mut(j);
            for k in (0..n).rev() {
                let value = x[k] / self.at(k, k);
                x[k] = value;
                for (x, &u) in x[..k].iter_mut().zip(self.column(k)) {
                    *x = *x - value * u;
                }
            }
        }
        Some(rhs)
    }

    /// Lower Cholesky factor; `None` where the matrix is not numerically positive definite.
    pub(crate) fn cholesky(&self) -> Option<Self> {
        let n = self.rows;
        let mut l = self.clone();
        for j in 0..n {
            for k in 0..j {
                l.entries[j * n + k] = Wide::ZERO;
            }
            for k in 0..j {
                let s = l.at(j, k);
                for i in j..n {
                    l.entries[j * n + i] = l.at(i, j) - s * l.at(i, k);
                }
            }
            let pivot = l.at(j, j);
            // Written so that NaN is refused as well.
            if !(pivot.hi > 0.0 && pivot.hi.is_finite()) {
                return None;
            }
            let root = pivot.sqrt();
            for x in &mut l.column_mut(j)[j..] {
                *x = *x / root;
            }
        }
        Some(l)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_keep_thirty_digits() {
        let third = Wide::ONE / Wide::from(3.0);
        // 1/3 - fl(1/3) is known exactly: fl(1/3) = (2^54 - 1) / (3 2^54).
        let rest = third - Wide::from(1.0 / 3.0);
        assert!((rest.hi * 3.0 * 2.0_f64.powi(54) - 1.0).abs() < 1e-15);
        let two = Wide::from(2.0);
        assert!((two.sqrt() * two.sqrt() - two).hi.abs() < 1e-31);
        let tiny = Wide::from(1e-25);
        assert!(((Wide::ONE + tiny) - Wide::ONE - tiny).hi.abs() < 1e-31);
    }

    #[test]
    fn a_hilbert_system_of_condition_1e16_is_solved_to_double_precision() {
        let n = 12;
        let hilbert = WideMat::from_fn(n, n, |i, j| Wide::ONE / Wide::from((i + j + 1) as f64));
        let ones = WideMat::from_fn(n, 1, |_, _| Wide::ONE);
        let rhs = hilbert.mul(&ones);
        let x = hilbert.clone().solve(rhs).unwrap();
        // 2^-104 times a condition of 1.7e16.
        assert!(x.plus(-1.0, &ones).norm() < 1e-14);
        let l = hilbert.cholesky().unwrap();
        assert!(l.mul(&l.transposed()).plus(-1.0, &hilbert).norm() < 1e-30);
    }
}
