//! The data of one stage: dynamics, cost and constraints.
//!
//! ```text
//! x_{k+1} = A x_k + B u_k + c
//! cost      1/2 x'Q x + x'S u + 1/2 u'R u + q'x + r'u
//! with      u_min <= u_k <= u_max,  du_min <= u_k - u_{k-1} <= du_max,
//!           x_min <= x_k <= x_max (from k = 1 on: x_0 is data),  G x_k + H u_k <= g
//! ```
//! Mind the factor 1/2: a cost `x'Qx` is `q = 2 Q` here.

use crate::error::{Place, ProblemError};
use crate::semidefinite::joint_positive_semidefinite;
use crate::validation::{
    absent_bounds, absent_limit, bounds, finite, finite_row, symmetric, symmetrise, upper_limit,
};
use nalgebra::{SMatrix, SVector};

/// One general row `g_x'x_k + h_u'u_k <= upper`; `upper = +inf`, or 1e20 and beyond, switches it off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row<const NX: usize, const NU: usize> {
    /// Coefficients of the state, a row of G.
    pub g_x: SVector<f64, NX>,
    /// Coefficients of the input, a row of H.
    pub h_u: SVector<f64, NU>,
    /// Right-hand side, a component of g.
    pub upper: f64,
}

/// Data of stage `k`. Bounds are infinite where absent; a problem reads 1e20 and beyond as infinite.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage<const NX: usize, const NU: usize> {
    /// State matrix A.
    pub a: SMatrix<f64, NX, NX>,
    /// Input matrix B.
    pub b: SMatrix<f64, NX, NU>,
    /// Affine term c of the dynamics.
    pub c: SVector<f64, NX>,
    /// State weight Q, symmetric; a problem keeps the symmetric part of what differs by rounding.
    pub q: SMatrix<f64, NX, NX>,
    /// Input weight R, symmetric.
    pub r: SMatrix<f64, NU, NU>,
    /// Cross weight S in `x'S u`.
    pub s: SMatrix<f64, NX, NU>,
    /// Linear state cost q.
    pub q_linear: SVector<f64, NX>,
    /// Linear input cost r.
    pub r_linear: SVector<f64, NU>,
    /// Lower input bound.
    pub u_min: SVector<f64, NU>,
    /// Upper input bound.
    pub u_max: SVector<f64, NU>,
    /// Lower bound of `u_k - u_{k-1}`; at stage 0 against the input applied last.
    pub du_min: SVector<f64, NU>,
    /// Upper bound of `u_k - u_{k-1}`.
    pub du_max: SVector<f64, NU>,
    /// Lower bound of `x_k`; see [`Self::x_max`].
    pub x_min: SVector<f64, NX>,
    /// Upper bound of `x_k`; not imposed at stage 0, where `x_0` is given. Those of `x_N` are
    /// [`Terminal`](crate::Terminal)'s, open unless set there.
    pub x_max: SVector<f64, NX>,
    /// General rows; at stage 0 the given `x_0` enters them as a number.
    pub rows: Vec<Row<NX, NU>>,
}

impl<const NX: usize, const NU: usize> Stage<NX, NU> {
    /// A stage with these dynamics, zero cost and no constraint.
    #[must_use]
    pub fn new(a: SMatrix<f64, NX, NX>, b: SMatrix<f64, NX, NU>) -> Self {
        Self {
            a,
            b,
            c: SVector::zeros(),
            q: SMatrix::zeros(),
            r: SMatrix::zeros(),
            s: SMatrix::zeros(),
            q_linear: SVector::zeros(),
            r_linear: SVector::zeros(),
            u_min: SVector::repeat(f64::NEG_INFINITY),
            u_max: SVector::repeat(f64::INFINITY),
            du_min: SVector::repeat(f64::NEG_INFINITY),
            du_max: SVector::repeat(f64::INFINITY),
            x_min: SVector::repeat(f64::NEG_INFINITY),
            x_max: SVector::repeat(f64::INFINITY),
            rows: Vec::new(),
        }
    }

    /// The stage's cost at a point.
    #[must_use]
    pub fn cost(&self, x: &SVector<f64, NX>, u: &SVector<f64, NU>) -> f64 {
        let quadratic =
            0.5 * x.dot(&(self.q * x)) + 0.5 * u.dot(&(self.r * u)) + x.dot(&(self.s * u));
        quadratic + self.q_linear.dot(x) + self.r_linear.dot(u)
    }

    /// The successor state `A x + B u + c`.
    #[must_use]
    pub fn successor(&self, x: &SVector<f64, NX>, u: &SVector<f64, NU>) -> SVector<f64, NX> {
        self.a * x + self.b * u + self.c
    }

    /// The weights are not looked at again where they are those of a stage that was `accepted`.
    pub(crate) fn validate(
        &self,
        place: Place,
        accepted: Option<&Self>,
    ) -> Result<(), ProblemError> {
        finite(place, "a", &self.a)?;
        finite(place, "b", &self.b)?;
        finite(place, "c", &self.c)?;
        finite(place, "s", &self.s)?;
        finite(place, "q_linear", &self.q_linear)?;
        finite(place, "r_linear", &self.r_linear)?;
        let known = |it: &Self| it.r == self.r && it.s == self.s && it.q == self.q;
        if !accepted.is_some_and(known) {
            let q = symmetric(place, "q", &self.q)?;
            let r = symmetric(place, "r", &self.r)?;
            joint_positive_semidefinite(place, &q, &r, &self.s)?;
        }
        bounds(place, ["u", "u_min", "u_max"], &self.u_min, &self.u_max)?;
        bounds(
            place,
            ["du", "du_min", "du_max"],
            &self.du_min,
            &self.du_max,
        )?;
        bounds(place, ["x", "x_min", "x_max"], &self.x_min, &self.x_max)?;
        for (index, row) in self.rows.iter().enumerate() {
            finite_row(place, "rows.g_x", index, &row.g_x)?;
            finite_row(place, "rows.h_u", index, &row.h_u)?;
            upper_limit(place, "rows.upper", index, row.upper)?;
        }
        Ok(())
    }

    /// Makes the bounds infinite that are written as large numbers, and weights symmetric to the last digit.
    pub(crate) fn normalise(&mut self) {
        symmetrise(&mut self.q);
        symmetrise(&mut self.r);
        absent_bounds(&mut self.u_min, &mut self.u_max);
        absent_bounds(&mut self.du_min, &mut self.du_max);
        absent_bounds(&mut self.x_min, &mut self.x_max);
        (self.rows.iter_mut()).for_each(|row| absent_limit(&mut row.upper));
    }

    /// Overwrites every value without allocating; the row counts must agree.
    pub(crate) fn overwrite(&mut self, source: &Self) {
        debug_assert_eq!(self.rows.len(), source.rows.len());
        let mut rows = std::mem::take(&mut self.rows);
        rows.copy_from_slice(&source.rows);
        *self = Self { rows, ..*source };
        self.normalise();
    }
}
