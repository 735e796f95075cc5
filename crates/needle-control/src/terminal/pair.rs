//! The pair and weights of one step of a reference, in the form that `lqr` takes.
//!
//! With a weight on changes of the input the state is (error, input deviation applied last) and the input its change; the weight on
//! the deviation itself then has a cross term.

use super::TerminalError;
use faer::Mat;
use lqr::{Constraints, Dare, DareSolution, InputError, RateAugmented, Stage};
use nalgebra::{DMatrix, Matrix2};

/// The pair and weights of one step, before augmentation.
#[derive(Debug, Clone)]
pub(crate) struct Pair {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
    pub(crate) q: DMatrix<f64>,
    pub(crate) r: Matrix2<f64>,
    /// Weight of the input's change; with it the last input is a state.
    pub(crate) r_rate: Option<Matrix2<f64>>,
}

pub(crate) fn dense(m: &DMatrix<f64>) -> Mat<f64> {
    Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)])
}

pub(crate) fn dynamic(m: &Mat<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)])
}

fn small(m: &Matrix2<f64>) -> Mat<f64> {
    Mat::from_fn(2, 2, |i, j| m[(i, j)])
}

/// A regulator problem of one step; `s` is its cross term, zero without augmentation.
pub(crate) struct Regulation {
    a: Mat<f64>,
    b: Mat<f64>,
    q: Mat<f64>,
    r: Mat<f64>,
    s: Mat<f64>,
}

impl Regulation {
    pub(crate) fn of_all(pairs: &[Pair]) -> Result<Vec<Self>, InputError> {
        pairs.iter().map(Self::of).collect()
    }

    pub(crate) fn of(pair: &Pair) -> Result<Self, InputError> {
        let (a, b, q, r) = (
            dense(&pair.a),
            dense(&pair.b),
            dense(&pair.q),
            small(&pair.r),
        );
        let Some(r_rate) = &pair.r_rate else {
            let s = Mat::zeros(a.nrows(), 2);
            return Ok(Self { a, b, q, r, s });
        };
        let RateAugmented { a, b, q, r, s } = RateAugmented::new(
            a.as_ref(),
            b.as_ref(),
            q.as_ref(),
            r.as_ref(),
            small(r_rate).as_ref(),
        )?;
        Ok(Self { a, b, q, r, s })
    }

    pub(crate) fn dare(&self) -> Dare<'_> {
        Dare::new(
            self.a.as_ref(),
            self.b.as_ref(),
            self.q.as_ref(),
            self.r.as_ref(),
        )
        .with_cross(self.s.as_ref())
    }

    pub(crate) fn solve(&self) -> Result<DareSolution, TerminalError> {
        Ok(self.dare().solve()?)
    }

    pub(crate) fn stage(&self) -> Stage<'_> {
        let Self { a, b, q, r, s } = self;
        Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref()).with_cross(s.as_ref())
    }
}

/// Limits in the state of the regulator problem.
pub(crate) fn limits_of(pair: &Pair, limits: Constraints) -> Constraints {
    match pair.r_rate {
        Some(_) => RateAugmented::constraints(&limits),
        None => limits,
    }
}
