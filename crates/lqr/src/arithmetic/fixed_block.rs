//! Matrices of a size known to the compiler: products, an inverse, a Cholesky solution. No allocation, no dispatch.
//!
//! What the kernels of [`widest`](crate::arithmetic::fixed_size::widest) call is inlined, so that it is compiled for their instruction set.

use faer::Mat;

/// R x C, by columns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block<const R: usize, const C: usize>(pub(crate) [[f64; R]; C]);

impl<const R: usize, const C: usize> Block<R, C> {
    pub(crate) const ZERO: Self = Self([[0.0; R]; C]);

    /// `a` in the upper left corner of zeros.
    pub(crate) fn padded(a: &Mat<f64>) -> Self {
        let mut block = Self::ZERO;
        for j in 0..a.ncols() {
            block.0[j][..a.nrows()].copy_from_slice(a.col_as_slice(j));
        }
        block
    }

    /// The upper left corner.
    pub(crate) fn corner(&self, rows: usize, cols: usize) -> Mat<f64> {
        let mut a = Mat::zeros(rows, cols);
        for j in 0..cols {
            a.col_as_slice_mut(j).copy_from_slice(&self.0[j][..rows]);
        }
        a
    }

    /// The product, compiled once a shape.
    pub(crate) fn mul<const D: usize>(&self, b: &Block<C, D>) -> Block<R, D> {
        self.mul_inlined(b)
    }

    /// The product, compiled with what calls it.
    #[inline(always)]
    pub(crate) fn mul_inlined<const D: usize>(&self, b: &Block<C, D>) -> Block<R, D> {
        let mut c = Block::ZERO;
        for (column, weights) in c.0.iter_mut().zip(&b.0) {
            let mut sum = [0.0; R];
            for (a, s) in self.0.iter().zip(weights) {
                for i in 0..R {
                    sum[i] += a[i] * s;
                }
            }
            *column = sum;
        }
        c
    }

    #[inline(always)]
    pub(crate) fn transposed(&self) -> Block<C, R> {
        let mut t = Block::ZERO;
        for j in 0..C {
            for i in 0..R {
                t.0[i][j] = self.0[j][i];
            }
        }
        t
    }

    /// `self + s b`.
    #[inline(always)]
    pub(crate) fn plus(&self, s: f64, b: &Self) -> Self {
        let mut c = *self;
        for j in 0..C {
            for i in 0..R {
                c.0[j][i] += s * b.0[j][i];
            }
        }
        c
    }

    /// Frobenius norm, without protection against overflow: infinite then, and the caller gives up.
    #[inline(always)]
    pub(crate) fn norm(&self) -> f64 {
        let mut sum = [0.0; R];
        for column in &self.0 {
            for i in 0..R {
                sum[i] += column[i] * column[i];
            }
        }
        sum.iter().sum::<f64>().sqrt()
    }
}

impl<const N: usize> Block<N, N> {
    #[inline(always)]
    pub(crate) fn identity() -> Self {
        let mut eye = Self::ZERO;
        for i in 0..N {
            eye.0[i][i] = 1.0;
        }
        eye
    }

    #[inline(always)]
    pub(crate) fn symmetric_part(mut self) -> Self {
        for j in 0..N {
            for i in 0..j {
                let mean = 0.5 * self.0[j][i] + 0.5 * self.0[i][j];
                self.0[j][i] = mean;
                self.0[i][j] = mean;
            }
        }
        self
    }

    /// `c' self c` for a symmetric `self`.
    pub(crate) fn congruence<const D: usize>(&self, c: &Block<N, D>) -> Block<D, D> {
        c.transposed().mul(&self.mul(c)).symmetric_part()
    }

    /// Inverse by Gauss and Jordan's elimination with row pivots; `None` at a zero or infinite pivot.
    #[inline(always)]
    pub(crate) fn inverse(mut self) -> Option<Self> {
        let mut swaps = [0; N];
        for k in 0..N {
            let mut pivot = k;
            for i in k + 1..N {
                if self.0[k][i].abs() > self.0[k][pivot].abs() {
                    pivot = i;
                }
            }
            let value = self.0[k][pivot];
            if value == 0.0 || !value.is_finite() {
                return None;
            }
            swaps[k] = pivot;
            if pivot != k {
                for column in &mut self.0 {
                    column.swap(k, pivot);
                }
            }
            let inverse = 1.0 / value;
            let factors = self.0[k];
            for (j, column) in self.0.iter_mut().enumerate() {
                if j == k {
                    *column = factors.map(|x| -inverse * x);
                    column[k] = inverse;
                } else {
                    let s = column[k] * inverse;
                    for i in 0..N {
                        column[i] -= s * factors[i];
                    }
                    column[k] = s;
                }
            }
        }
        for k in (0..N).rev() {
            self.0.swap(k, swaps[k]);
        }
        Some(self)
    }

    /// Least pivot of a Cholesky factorisation over its diagonal entry: one where the columns are orthogonal, zero where they depend.
    pub(crate) fn least_relative_pivot(mut self) -> f64 {
        let mut least = 1.0_f64;
        let diagonal: [f64; N] = std::array::from_fn(|i| self.0[i][i]);
        for j in 0..N {
            let pivot = self.0[j][j];
            // Written so that NaN counts as dependent.
            if !(pivot > 0.0) {
                return 0.0;
            }
            least = least.min(pivot / diagonal[j]);
            for k in j + 1..N {
                let s = self.0[j][k] / pivot;
                for i in k..N {
                    self.0[k][i] -= s * self.0[j][i];
                }
            }
        }
        least
    }

    /// Solves `self x = rhs` for a positive definite `self`; `None` where it is not.
    pub(crate) fn cholesky_solve<const D: usize>(
        mut self,
        mut rhs: Block<N, D>,
    ) -> Option<Block<N, D>> {
        for j in 0..N {
            let pivot = self.0[j][j];
            // Written so that NaN is refused as well.
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            let inverse = 1.0 / pivot.sqrt();
            for i in j..N {
                self.0[j][i] *= inverse;
            }
            for k in j + 1..N {
                let s = self.0[j][k];
                for i in k..N {
                    self.0[k][i] -= s * self.0[j][i];
                }
            }
        }
        for x in &mut rhs.0 {
            for k in 0..N {
                x[k] /= self.0[k][k];
                for i in k + 1..N {
                    x[i] -= x[k] * self.0[k][i];
                }
            }
            for k in (0..N).rev() {
                for i in k + 1..N {
                    x[k] -= x[i] * self.0[k][i];
                }
                x[k] /= self.0[k][k];
            }
        }
        Some(rhs)
    }
}
