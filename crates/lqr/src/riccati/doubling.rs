//! The Riccati map over many stages at once, and its fixed point by doubling.
//!
//! One stage maps the cost-to-go X after it to H + A'X(I + GX)^-1 A before it, with G = BR^-1B'. Such maps compose to one of
//! the same form, so 2^j stages cost j compositions (structure-preserving doubling for the symplectic pencil). Starting from a
//! zero terminal weight the limit is the minimal solution, which is the stabilising one unless Q misses an unstable mode.

use crate::arithmetic::dense::{
    add_scaled, identity, mul, mul_tr, norm, solve, symmetrise, tr_mul,
};
use crate::arithmetic::fixed_size::by_states;
use crate::riccati::padded::doubling as small_doubling;
use faer::Mat;

/// The map X -> H + A'X(I + GX)^-1 A; G and H symmetric, all n x n.
#[derive(Debug, Clone)]
pub(crate) struct StageMap {
    pub(crate) a: Mat<f64>,
    pub(crate) g: Mat<f64>,
    pub(crate) h: Mat<f64>,
}

impl StageMap {
    /// The map of `self` followed in time by `later`; `None` where I + GH is singular.
    pub(crate) fn then(&self, later: &Self) -> Option<Self> {
        let n = self.a.nrows();
        let w = add_scaled(&identity(n), 1.0, &mul(&self.g, &later.h));
        let both = Mat::from_fn(n, 2 * n, |i, j| {
            if j < n {
                self.a[(i, j)]
            } else {
                self.g[(i, j - n)]
            }
        });
        let solved = solve(w, both)?;
        let (wa, wg) = (
            solved.get(.., ..n).to_owned(),
            solved.get(.., n..).to_owned(),
        );
        let mut growth = tr_mul(&self.a, &mul(&later.h, &wa));
        symmetrise(&mut growth);
        let mut reach = mul_tr(&mul(&later.a, &wg), &later.a);
        symmetrise(&mut reach);
        Some(Self {
            a: mul(&later.a, &wa),
            g: add_scaled(&later.g, 1.0, &reach),
            h: add_scaled(&self.h, 1.0, &growth),
        })
    }

    /// Limit of H under repeated doubling and the number of doublings; `None` where it does not settle.
    pub(crate) fn fixed_point(mut self, max_doublings: usize) -> Option<(Mat<f64>, usize)> {
        let (a, g, h) = (&self.a, &self.g, &self.h);
        if let Some(limit) = by_states!(a.nrows(), small_doubling(a, g, h, max_doublings)) {
            return limit;
        }
        for doubling in 1..=max_doublings {
            let next = self.then(&self)?;
            let (change, size) = (norm(&add_scaled(&next.h, -1.0, &self.h)), norm(&next.h));
            if !(size.is_finite() && norm(&next.g).is_finite()) {
                return None;
            }
            // The next growth is at most |A|^2 |H|: below 1e-18 of H it cannot matter.
            if change <= 1e-15 * size || norm(&next.a) < 1e-9 {
                return Some((next.h, doubling));
            }
            self = next;
        }
        None
    }
}
