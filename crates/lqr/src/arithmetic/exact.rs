//! Exact linear algebra on stored doubles.
//!
//! A finite double is an integer times a power of two, so sums and products of matrices of doubles are exact on integers with
//! one common exponent; no fraction arises. Definiteness is decided by fraction-free elimination (Bareiss) with
//! diagonal pivots: every intermediate entry is a minor of the matrix, so the signs of the pivots are those of the
//! Schur complements. What is decided here is proved for the numbers as stored. Left out: square roots and inverses.

use faer::Mat;
use num_bigint::{BigInt, Sign};

/// A matrix of integers times 2^exponent, row-major.
#[derive(Debug, Clone)]
pub(crate) struct Exact {
    rows: usize,
    cols: usize,
    entries: Vec<BigInt>,
    exponent: i64,
}

/// m and e with x = m 2^e, for finite x.
fn decompose(x: f64) -> (i64, i64) {
    let bits = x.to_bits();
    let biased = ((bits >> 52) & 0x7ff) as i64;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let (mantissa, exponent) = if biased == 0 {
        (fraction, -1074)
    } else {
        (fraction | (1 << 52), biased - 1075)
    };
    (if x < 0.0 { -mantissa } else { mantissa }, exponent)
}

impl Exact {
    /// The stored doubles of a finite matrix.
    pub(crate) fn of(a: &Mat<f64>) -> Self {
        let (rows, cols) = (a.nrows(), a.ncols());
        let parts: Vec<(i64, i64)> = (0..rows)
            .flat_map(|i| (0..cols).map(move |j| (i, j)))
            .map(|(i, j)| decompose(a[(i, j)]))
            .collect();
        let used = parts.iter().filter(|(mantissa, _)| *mantissa != 0);
        let exponent = used.map(|&(_, exponent)| exponent).min().unwrap_or(0);
        let entries = parts
            .into_iter()
            .map(|(mantissa, e)| {
                if mantissa == 0 {
                    BigInt::ZERO
                } else {
                    BigInt::from(mantissa) << (e - exponent)
                }
            })
            .collect();
        Self {
            rows,
            cols,
            entries,
            exponent,
        }
    }

    pub(crate) fn number(x: f64) -> Self {
        Self::of(&Mat::from_fn(1, 1, |_, _| x))
    }

    pub(crate) fn identity(n: usize) -> Self {
        Self::of(&Mat::identity(n, n))
    }

    pub(crate) fn transpose(&self) -> Self {
        let entries = (0..self.cols)
            .flat_map(|j| (0..self.rows).map(move |i| (i, j)))
            .map(|(i, j)| self.entries[i * self.cols + j].clone())
            .collect();
        Self {
            rows: self.cols,
            cols: self.rows,
            entries,
            exponent: self.exponent,
        }
    }

    pub(crate) fn mul(&self, other: &Self) -> Self {
        debug_assert_eq!(self.cols, other.rows);
        let mut entries = Vec::with_capacity(self.rows * other.cols);
        for i in 0..self.rows {
            for j in 0..other.cols {
                let terms = (0..self.cols)
                    .map(|k| &self.entries[i * self.cols + k] * &other.entries[k * other.cols + j]);
                entries.push(terms.fold(BigInt::ZERO, |sum, term| sum + term));
            }
        }
        Self {
            rows: self.rows,
            cols: other.cols,
            entries,
            exponent: self.exponent + other.exponent,
        }
    }

    /// `factor * self` for a 1-by-1 factor.
    pub(crate) fn times(&self, factor: &Self) -> Self {
        let entries = self
            .entries
            .iter()
            .map(|x| x * &factor.entries[0])
            .collect();
        Self {
            rows: self.rows,
            cols: self.cols,
            entries,
            exponent: self.exponent + factor.exponent,
        }
    }

    pub(crate) fn add(&self, other: &Self) -> Self {
        self.combine(other, |x, y| x + y)
    }

    pub(crate) fn sub(&self, other: &Self) -> Self {
        self.combine(other, |x, y| x - y)
    }

    fn combine(&self, other: &Self, op: impl Fn(BigInt, BigInt) -> BigInt) -> Self {
        debug_assert_eq!((self.rows, self.cols), (other.rows, other.cols));
        let exponent = self.exponent.min(other.exponent);
        let entries = self
            .entries
            .iter()
            .zip(&other.entries)
            .map(|(x, y)| {
                op(
                    x << (self.exponent - exponent),
                    y << (other.exponent - exponent),
                )
            })
            .collect();
        Self {
            rows: self.rows,
            cols: self.cols,
            entries,
            exponent,
        }
    }

    /// The moduli of the entries.
    pub(crate) fn modulus(&self) -> Self {
        let entries = self
            .entries
            .iter()
            .map(|x| BigInt::from(x.magnitude().clone()));
        Self {
            entries: entries.collect(),
            ..*self
        }
    }

    /// Whether every entry is zero.
    pub(crate) fn is_zero(&self) -> bool {
        self.entries.iter().all(|x| x.sign() == Sign::NoSign)
    }

    /// `a' self a`.
    pub(crate) fn congruence(&self, a: &Self) -> Self {
        a.transpose().mul(&self.mul(a))
    }

    /// Whether a symmetric matrix is positive semidefinite (`strictly`: positive definite). Proved either way.
    pub(crate) fn is_definite(&self, strictly: bool) -> bool {
        let n = self.rows;
        let mut m = self.entries.clone();
        let mut left: Vec<usize> = (0..n).collect();
        let mut previous = BigInt::from(1);
        while !left.is_empty() {
            if left.iter().any(|&i| m[i * n + i].sign() == Sign::Minus) {
                return false;
            }
            let Some(at) = left.iter().position(|&i| m[i * n + i].sign() == Sign::Plus) else {
                // A zero diagonal of a semidefinite matrix has zero rows.
                return !strictly
                    && left
                        .iter()
                        .all(|&i| left.iter().all(|&j| m[i * n + j].sign() == Sign::NoSign));
            };
            let k = left.remove(at);
            let pivot = m[k * n + k].clone();
            for &i in &left {
                for &j in &left {
                    m[i * n + j] =
                        (&pivot * &m[i * n + j] - &m[i * n + k] * &m[k * n + j]) / &previous;
                }
            }
            previous = pivot;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::mat;

    #[test]
    fn a_matrix_that_rounding_calls_singular_is_decided() {
        // 1 - 2^-54 is not a double, so the determinant of the first differs from zero only exactly.
        let e = 2.0_f64.powi(-27);
        let above = Exact::of(&mat![[1.0, e], [e, e * e * (1.0 + f64::EPSILON)]]);
        let at = Exact::of(&mat![[1.0, e], [e, e * e]]);
        let below = Exact::of(&mat![[1.0, e], [e, e * e * (1.0 - f64::EPSILON)]]);
        assert!(above.is_definite(true));
        assert!(at.is_definite(false) && !at.is_definite(true));
        assert!(!below.is_definite(false));
    }

    #[test]
    fn a_zero_diagonal_with_a_coupling_is_indefinite() {
        assert!(!Exact::of(&mat![[0.0, 1e-300], [1e-300, 1.0]]).is_definite(false));
        assert!(Exact::of(&mat![[0.0, 0.0], [0.0, 1.0]]).is_definite(false));
    }

    #[test]
    fn sums_and_products_lose_nothing() {
        // (1e300 + 1e-300) - 1e300 - 1e-300 = 0 exactly; in floating point it is -1e-300.
        let (big, small) = (Exact::number(1e300), Exact::number(-1e-300));
        let zero = big.sub(&small).sub(&big).add(&small);
        assert!(zero.is_definite(false) && !zero.is_definite(true));
        let subnormal = Exact::number(f64::from_bits(1));
        assert!(subnormal.mul(&subnormal).is_definite(true));
    }
}
