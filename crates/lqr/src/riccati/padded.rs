//! The Riccati map at sizes known to the compiler: doubling and the backward step.
//!
//! A problem of up to 12 states and 4 inputs is padded to the next size that is compiled: a padded state has
//! A = B = Q = 0, a padded input B = 0 and R = 1, so that every formula leaves the padding as it was. Larger
//! problems take the same formulas over faer's matrices, in the modules that call these.

use crate::arithmetic::fixed_block::Block;
use crate::arithmetic::fixed_size::widest;
use crate::riccati::problem::Problem;
use faer::Mat;
use pulp::NullaryFnOnce;

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

/// Limit of H under doubling from (A, G, H), as `StageMap::fixed_point`.
pub(crate) fn doubling<const N: usize>(
    a: &Mat<f64>,
    g: &Mat<f64>,
    h: &Mat<f64>,
    max_doublings: usize,
) -> Option<(Mat<f64>, usize)> {
    let states = a.nrows();
    let (limit, count) = widest(Doubling::<N> {
        a: Block::padded(a),
        g: Block::padded(g),
        h: Block::padded(h),
        max_doublings,
    })?;
    Some((limit.corner(states, states), count))
}

/// `doubling` from the data of a problem: G = BR^-1B', and with a cross term A - BR^-1S', Q - SR^-1S'.
pub(crate) fn problem_doubling<const N: usize, const M: usize>(
    problem: &Problem,
    max_doublings: usize,
) -> Option<(Mat<f64>, usize)> {
    let (states, inputs) = (problem.b.nrows(), problem.b.ncols());
    let (mut a, mut h) = (Block::padded(&problem.a), Block::padded(&problem.q));
    let b = Block::<N, M>::padded(&problem.b);
    let mut r = Block::<M, M>::padded(&problem.r);
    for i in inputs..M {
        r.0[i][i] = 1.0;
    }
    let g = b.mul(&r.cholesky_solve(b.transposed())?).symmetric_part();
    if let Some(s) = problem.s.as_ref().map(Block::<N, M>::padded) {
        let solved = r.cholesky_solve(s.transposed())?;
        a = a.plus(-1.0, &b.mul(&solved));
        h = h.plus(-1.0, &s.mul(&solved)).symmetric_part();
    }
    let (limit, count) = widest(Doubling {
        a,
        g,
        h,
        max_doublings,
    })?;
    Some((limit.corner(states, states), count))
}

/// Doubling from (A, G, H) until H settles; then H and the number of doublings.
struct Doubling<const N: usize> {
    a: Block<N, N>,
    g: Block<N, N>,
    h: Block<N, N>,
    max_doublings: usize,
}

impl<const N: usize> NullaryFnOnce for Doubling<N> {
    type Output = Option<(Block<N, N>, usize)>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let (mut a, mut g, mut h) = (self.a, self.g, self.h);
        for count in 1..=self.max_doublings {
            let inverse = Block::identity().plus(1.0, &g.mul_inlined(&h)).inverse()?;
            let (wa, transposed) = (inverse.mul_inlined(&a), a.transposed());
            let growth = transposed.mul_inlined(&h.mul_inlined(&wa)).symmetric_part();
            h = h.plus(1.0, &growth);
            let size = h.norm();
            if !size.is_finite() {
                return None;
            }
            // The next A is A W^-1 A, and the next growth at most |A|^2 |H|: below 1e-18 of H it cannot matter.
            if growth.norm() <= 1e-15 * size || a.norm() * wa.norm() < 1e-9 {
                return Some((h, count));
            }
            let reach = a
                .mul_inlined(&inverse.mul_inlined(&g))
                .mul_inlined(&transposed)
                .symmetric_part();
            g = g.plus(1.0, &reach);
            a = a.mul_inlined(&wa);
            if !g.norm().is_finite() {
                return None;
            }
        }
        None
    }
}

/// Gain, closed loop and cost before the stage for the cost-to-go P: one backward step in Joseph form.
#[derive(Debug)]
pub(crate) struct Step {
    pub(crate) k: Mat<f64>,
    pub(crate) closed_loop: Mat<f64>,
    pub(crate) before: Mat<f64>,
    /// Of R + B'PB: the least pivot over its diagonal entry.
    pub(crate) hessian_pivot: f64,
}

/// The backward step of `problem` from `p`; `None` where R + B'PB is not positive definite.
pub(crate) fn backward<const N: usize, const M: usize>(
    problem: &Problem,
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
    let hessian_pivot = hessian.least_relative_pivot();
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
        hessian_pivot,
    })
}
