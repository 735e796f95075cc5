//! The discrete algebraic Riccati equation P = Q + A'PA - (A'PB + S)(R + B'PB)^-1(B'PA + S').
//!
//! Doubling finds a candidate, Newton steps on the Joseph residual polish it, and a candidate is
//! returned only if the closed loop A + BK is stable and the residual small: that makes it *the* stabilising solution,
//! which is unique. Stabilisability needs no test beforehand: a stable closed loop bounds the Hautus measure
//! from below (`proved_measure`). The explicit test runs where that bound is too weak, or where no
//! candidate was good, to name the mode that is to blame.

use crate::arithmetic::dense::norm;
use crate::input::InputError;
use crate::riccati::balance::Balanced;
use crate::riccati::dare_error::DareError;
use crate::riccati::dare_solution::DareSolution;
use crate::riccati::problem::Problem;
use crate::riccati::verdict;
use faer::MatRef;

/// A discrete algebraic Riccati equation, ready to be solved.
#[derive(Debug, Clone)]
pub struct Dare<'a> {
    a: MatRef<'a, f64>,
    b: MatRef<'a, f64>,
    q: MatRef<'a, f64>,
    r: MatRef<'a, f64>,
    s: Option<MatRef<'a, f64>>,
}

impl<'a> Dare<'a> {
    /// x+ = Ax + Bu with stage cost x'Qx + u'Ru: A n x n, B n x m, Q n x n, R m x m.
    #[must_use]
    pub fn new(
        a: MatRef<'a, f64>,
        b: MatRef<'a, f64>,
        q: MatRef<'a, f64>,
        r: MatRef<'a, f64>,
    ) -> Self {
        Self {
            a,
            b,
            q,
            r,
            s: None,
        }
    }

    /// Adds 2x'Su to the stage cost, S n x m.
    #[must_use]
    pub fn with_cross(mut self, s: MatRef<'a, f64>) -> Self {
        self.s = Some(s);
        self
    }

    /// The stabilising solution.
    ///
    /// # Errors
    /// See [`DareError`]; each names what is wrong with the data.
    pub fn solve(&self) -> Result<DareSolution, DareError> {
        let problem = self.validated()?;
        let weight = norm(&problem.q);
        let balanced = Balanced::of(problem);
        let found = verdict::in_doubles(&balanced, weight);
        if verdict::calls_for_more_digits(&found) {
            return verdict::in_extended_precision(&self.problem()?, &balanced, found);
        }
        found
    }

    /// The data with shapes, finiteness and symmetry checked.
    pub(crate) fn problem(&self) -> Result<Problem, InputError> {
        Problem::read(self.a, self.b, self.q, self.r, self.s)
    }

    fn validated(&self) -> Result<Problem, DareError> {
        let problem = self.problem()?;
        if let Some((name, eigenvalue, tolerance)) = problem.indefinite_weight() {
            return Err(DareError::IndefiniteWeight {
                name,
                eigenvalue,
                tolerance,
            });
        }
        Ok(problem)
    }
}
