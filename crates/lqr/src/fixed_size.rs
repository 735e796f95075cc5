//! The Riccati kernels at sizes known to the compiler: doubling, the squared Smith sum, evaluation.
//!
//! A handful of states is the common case, and there allocation and dispatch cost more than arithmetic.
//! A problem of up to 12 states and 4 inputs is padded to the next size that is compiled: a padded state has
//! A = B = Q = 0, a padded input B = 0 and R = 1, so that every formula leaves the padding as it was. Larger
//! problems take the same formulas over faer's matrices, in the modules that call these.

use faer::Mat;

/// R x C, by columns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block<const R: usize, const C: usize>([[f64; R]; C]);

/// Calls a kernel that is generic in the number of states; `None` for more than 12.
macro_rules! by_states {
    ($n:expr, $kernel:ident ( $($argument:expr),* )) => {
        match $n {
            1..=2 => Some($kernel::<2>($($argument),*)),
            3..=4 => Some($kernel::<4>($($argument),*)),
            5..=6 => Some($kernel::<6>($($argument),*)),
            7..=8 => Some($kernel::<8>($($argument),*)),
            9..=12 => Some($kernel::<12>($($argument),*)),
            _ => None,
        }
    };
}
pub(crate) use by_states;

/// As `by_states`, generic in states and inputs; `None` for more than 12 or 4.
macro_rules! by_states_and_inputs {
    ($n:expr, $m:expr, $kernel:ident ( $($argument:expr),* )) => {
        match ($n, $m) {
            (1..=2, 1..=2) => Some($kernel::<2, 2>($($argument),*)),
            (3..=4, 1..=2) => Some($kernel::<4, 2>($($argument),*)),
            (5..=6, 1..=2) => Some($kernel::<6, 2>($($argument),*)),
            (7..=8, 1..=2) => Some($kernel::<8, 2>($($argument),*)),
            (9..=12, 1..=2) => Some($kernel::<12, 2>($($argument),*)),
            (1..=6, 3..=4) => Some($kernel::<6, 4>($($argument),*)),
            (7..=12, 3..=4) => Some($kernel::<12, 4>($($argument),*)),
            _ => None,
        }
    };
}
pub(crate) use by_states_and_inputs;

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

    #[inline]
    pub(crate) fn mul<const D: usize>(&self, b: &Block<C, D>) -> Block<R, D> {
        let mut c = Block::ZERO;
        for j in 0..D {
            let mut column = [0.0; R];
            for k in 0..C {
                let s = b.0[j][k];
                for i in 0..R {
                    column[i] += self.0[k][i] * s;
                }
            }
            c.0[j] = column;
        }
        c
    }

    #[inline]
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
    #[inline]
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
    fn identity() -> Self {
        let mut eye = Self::ZERO;
        for i in 0..N {
            eye.0[i][i] = 1.0;
        }
        eye
    }

    fn symmetric_part(mut self) -> Self {
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
    #[inline]
    fn congruence<const D: usize>(&self, c: &Block<N, D>) -> Block<D, D> {
        c.transposed().mul(&self.mul(c)).symmetric_part()
    }

    /// Elimination with row pivots; `None` at a zero or infinite pivot.
    fn lu(mut self) -> Option<Lu<N>> {
        let mut lu = Lu {
            order: std::array::from_fn(|i| i),
            factors: [[0.0; N]; N],
            upper: [[0.0; N]; N],
            inverses: [0.0; N],
        };
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
            if pivot != k {
                lu.order.swap(k, pivot);
                for column in &mut self.0 {
                    column.swap(k, pivot);
                }
                for column in &mut lu.factors {
                    column.swap(k, pivot);
                }
            }
            lu.inverses[k] = 1.0 / value;
            lu.upper[k][..k].copy_from_slice(&self.0[k][..k]);
            for i in k + 1..N {
                lu.factors[k][i] = self.0[k][i] * lu.inverses[k];
            }
            for j in k + 1..N {
                let s = self.0[j][k];
                for i in 0..N {
                    self.0[j][i] -= s * lu.factors[k][i];
                }
            }
        }
        Some(lu)
    }

    /// Solves `self x = rhs` for a positive definite `self`; `None` where it is not.
    fn cholesky_solve<const D: usize>(mut self, mut rhs: Block<N, D>) -> Option<Block<N, D>> {
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

/// Factors of a square block. Both triangles are kept as whole columns with zeros, so that a column is one operation.
struct Lu<const N: usize> {
    order: [usize; N],
    factors: [[f64; N]; N],
    upper: [[f64; N]; N],
    inverses: [f64; N],
}

impl<const N: usize> Lu<N> {
    #[inline]
    fn solve(&self, rhs: &Block<N, N>) -> Block<N, N> {
        let mut solved = Block::ZERO;
        for (target, column) in solved.0.iter_mut().zip(&rhs.0) {
            let mut x: [f64; N] = std::array::from_fn(|i| column[self.order[i]]);
            for k in 0..N {
                let s = x[k];
                for i in 0..N {
                    x[i] -= s * self.factors[k][i];
                }
            }
            for k in (0..N).rev() {
                x[k] *= self.inverses[k];
                let s = x[k];
                for i in 0..N {
                    x[i] -= s * self.upper[k][i];
                }
            }
            *target = x;
        }
        solved
    }
}

/// Limit of H under doubling from (A, G, H), as `StageMap::fixed_point`.
pub(crate) fn doubling<const N: usize>(
    a: &Mat<f64>,
    g: &Mat<f64>,
    h: &Mat<f64>,
    max_doublings: usize,
) -> Option<(Mat<f64>, usize)> {
    let states = a.nrows();
    let (mut a, mut g, mut h) = (
        Block::<N, N>::padded(a),
        Block::<N, N>::padded(g),
        Block::<N, N>::padded(h),
    );
    for count in 1..=max_doublings {
        let w = Block::identity().plus(1.0, &g.mul(&h)).lu()?;
        let wa = w.solve(&a);
        let growth = a.transposed().mul(&h.mul(&wa)).symmetric_part();
        h = h.plus(1.0, &growth);
        let size = h.norm();
        if !size.is_finite() {
            return None;
        }
        // The next A is A W^-1 A, and the next growth at most |A|^2 |H|: below 1e-18 of H it cannot matter.
        if growth.norm() <= 1e-15 * size || a.norm() * wa.norm() < 1e-9 {
            return Some((h.corner(states, states), count));
        }
        let reach = a.mul(&w.solve(&g)).mul(&a.transposed()).symmetric_part();
        g = g.plus(1.0, &reach);
        a = a.mul(&wa);
        if !g.norm().is_finite() {
            return None;
        }
    }
    None
}

/// X = A'XA + Q by squaring, as `spectrum::lyapunov_sum`.
pub(crate) fn smith_sum<const N: usize>(
    a: &Mat<f64>,
    q: &Mat<f64>,
    max_squarings: usize,
) -> Option<Mat<f64>> {
    let states = a.nrows();
    let (mut power, mut x) = (Block::<N, N>::padded(a), Block::<N, N>::padded(q));
    for _ in 0..max_squarings {
        let size = power.norm();
        if !size.is_finite() || size > 1e120 {
            return None;
        }
        x = x.plus(1.0, &x.congruence(&power));
        if size < 1e-9 {
            return x.norm().is_finite().then(|| x.corner(states, states));
        }
        power = power.mul(&power);
    }
    None
}

/// Bound on the sum of |A^j|, as `spectrum::sum_of_powers`.
pub(crate) fn power_sum<const N: usize>(a: &Mat<f64>, max_squarings: usize) -> f64 {
    let (mut power, mut sum) = (Block::<N, N>::padded(a), 1.0);
    for _ in 0..max_squarings {
        let size = power.norm();
        if size < 1e-3 {
            return sum / (1.0 - 2.0 * size);
        }
        sum *= 1.0 + size;
        power = power.mul(&power);
    }
    f64::INFINITY
}

/// Whether `w + shift I` is numerically positive definite.
pub(crate) fn is_definite<const N: usize>(w: &Mat<f64>, shift: f64) -> bool {
    let mut block = Block::<N, N>::padded(w);
    for i in 0..w.nrows() {
        block.0[i][i] += shift;
    }
    for i in w.nrows()..N {
        block.0[i][i] = 1.0;
    }
    block.cholesky_solve(Block::<N, 0>::ZERO).is_some()
}

/// One-norm of `p^-1`; infinite where `p` is not numerically positive definite.
pub(crate) fn inverse_norm_one<const N: usize>(p: &Mat<f64>) -> f64 {
    let n = p.nrows();
    let mut block = Block::<N, N>::padded(p);
    for i in n..N {
        block.0[i][i] = 1.0;
    }
    match block.cholesky_solve(Block::identity()) {
        Some(inverse) => inverse.0[..n]
            .iter()
            .map(|column| column.iter().map(|x| x.abs()).sum())
            .fold(0.0, f64::max),
        None => f64::INFINITY,
    }
}

/// Gain, closed loop and cost before the stage for the cost-to-go P: one backward step in Joseph form.
#[derive(Debug)]
pub(crate) struct Step {
    pub(crate) k: Mat<f64>,
    pub(crate) closed_loop: Mat<f64>,
    pub(crate) before: Mat<f64>,
}

/// The backward step of `problem` from `p`; `None` where R + B'PB is not positive definite.
pub(crate) fn backward<const N: usize, const M: usize>(
    problem: &crate::riccati::Problem,
    p: &Mat<f64>,
) -> Option<Step> {
    let (n, m) = (problem.b.nrows(), problem.b.ncols());
    let (a, b) = (
        Block::<N, N>::padded(&problem.a),
        Block::<N, M>::padded(&problem.b),
    );
    let (p, r) = (Block::<N, N>::padded(p), Block::<M, M>::padded(&problem.r));
    let pb = p.mul(&b);
    let mut hessian = r.plus(1.0, &b.transposed().mul(&pb)).symmetric_part();
    for i in m..M {
        hessian.0[i][i] = 1.0;
    }
    let mut gradient = pb.transposed().mul(&a);
    let s = problem.s.as_ref().map(Block::<N, M>::padded);
    if let Some(s) = &s {
        gradient = gradient.plus(1.0, &s.transposed());
    }
    let k = Block::ZERO.plus(-1.0, &hessian.cholesky_solve(gradient)?);
    let closed_loop = a.plus(1.0, &b.mul(&k));
    let mut before = Block::<N, N>::padded(&problem.q).plus(1.0, &r.congruence(&k));
    if let Some(s) = &s {
        let sk = s.mul(&k);
        before = before.plus(1.0, &sk.plus(1.0, &sk.transposed()));
    }
    before = before
        .plus(1.0, &p.congruence(&closed_loop))
        .symmetric_part();
    Some(Step {
        k: k.corner(m, n),
        closed_loop: closed_loop.corner(n, n),
        before: before.corner(n, n),
    })
}
