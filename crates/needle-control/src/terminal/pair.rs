//! The pair and weights of one step of a reference, in the form that `lqr` takes.
//!
//! With a weight on changes of the input the state is (error, input deviation applied last) and the input its change. `lqr`'s
//! chains know no cross term, which that form has: it is absorbed by du = w - F x with F = R^-1 S'.

use super::TerminalError;
use faer::Mat;
use lqr::{
    Constraint, ConstraintError, Constraints, Dare, DareSolution, InputError, RateAugmented,
};
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
}

/// Limits in the state of the regulator problem.
pub(crate) fn limits_of(pair: &Pair, limits: Constraints) -> Constraints {
    match pair.r_rate {
        Some(_) => RateAugmented::constraints(&limits),
        None => limits,
    }
}

/// A step whose cross term is absorbed by the input.
pub(crate) struct Uncrossed {
    a: Mat<f64>,
    b: Mat<f64>,
    q: Mat<f64>,
    r: Mat<f64>,
    shift: DMatrix<f64>,
}

impl Uncrossed {
    pub(crate) fn of_all(pairs: &[Pair]) -> Result<Vec<Self>, TerminalError> {
        pairs.iter().map(Self::of).collect()
    }

    fn of(pair: &Pair) -> Result<Self, TerminalError> {
        let Regulation { a, b, q, r, s } = Regulation::of(pair)?;
        let (a, s, q) = (dynamic(&a), dynamic(&s), dynamic(&q));
        // R of a valid configuration is positive definite; a zero inverse would only leave the cross term in place.
        let inverse = dynamic(&r)
            .try_inverse()
            .unwrap_or_else(|| DMatrix::zeros(2, 2));
        let shift = &inverse * s.transpose();
        let q = q - &s * &shift;
        Ok(Self {
            a: dense(&(a - dynamic(&b) * &shift)),
            q: dense(&((&q + q.transpose()) * 0.5)),
            b,
            r,
            shift,
        })
    }

    pub(crate) fn stage(&self) -> lqr::Stage<'_> {
        lqr::Stage::new(
            self.a.as_ref(),
            self.b.as_ref(),
            self.q.as_ref(),
            self.r.as_ref(),
        )
    }

    /// The limits in the new input; the weights, and so the shift, are the same at every step.
    pub(crate) fn constraints(&self, limits: &Constraints) -> Result<Constraints, ConstraintError> {
        let mut shifted = Constraints::new(self.a.nrows(), 2);
        for row in limits.rows() {
            let on_x = (0..self.a.nrows())
                .map(|j| {
                    row.on_x[j]
                        - (0..2)
                            .map(|i| row.on_u[i] * self.shift[(i, j)])
                            .sum::<f64>()
                })
                .collect();
            shifted = shifted.with(Constraint {
                on_x,
                ..row.clone()
            })?;
        }
        Ok(shifted)
    }
}
