//! The last input as a state, so that rate limits become input limits.
//!
//! A rate limits u_k - u_{k-1}, so u_{k-1} is part of the state: z = (x, u_prev) with du as input. A terminal set sized for z also bounds the first change
//! after the last input outside the set, of which a set in x alone says nothing.

use crate::arithmetic::dense::add_scaled;
use crate::input::{self, InputError};
use crate::terminal_set::constraints::{Constraint, Constraints};
use faer::{Mat, MatRef};

/// The system with state (x, u_prev) and input du: x+ = Ax + B(u_prev + du), u_prev+ = u_prev + du.
///
/// The stage cost x'Qx + u'Ru + du'R_d du, u = u_prev + du, has the cross term S = [0; R]. R_d = 0 is a problem like any other: its law
/// is du = Kx - u_prev with the plain K, and P = diag(P_x, 0). But then u_prev costs nothing and no level set is bounded in it: for
/// an [`Ellipsoid`](crate::Ellipsoid) R_d must be positive definite.
#[derive(Debug, Clone)]
pub struct RateAugmented {
    /// [A B; 0 I], (n+m) x (n+m).
    pub a: Mat<f64>,
    /// [B; I], (n+m) x m.
    pub b: Mat<f64>,
    /// diag(Q, R).
    pub q: Mat<f64>,
    /// R + R_d.
    pub r: Mat<f64>,
    /// [0; R], the cross term.
    pub s: Mat<f64>,
}

impl RateAugmented {
    /// Augments A n x n, B n x m with weights Q n x n, R and R_d m x m.
    ///
    /// # Errors
    /// [`InputError`] for malformed matrices.
    pub fn new(
        a: MatRef<'_, f64>,
        b: MatRef<'_, f64>,
        q: MatRef<'_, f64>,
        r: MatRef<'_, f64>,
        r_rate: MatRef<'_, f64>,
    ) -> Result<Self, InputError> {
        let (a, b) = input::pair(a, b)?;
        let (n, m) = (b.nrows(), b.ncols());
        let q = input::symmetric("Q", q, n)?;
        let r = input::symmetric("R", r, m)?;
        let r_rate = input::symmetric("R_d", r_rate, m)?;
        let eye = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
        Ok(Self {
            a: Mat::from_fn(n + m, n + m, |i, j| match (i < n, j < n) {
                (true, true) => a[(i, j)],
                (true, false) => b[(i, j - n)],
                (false, true) => 0.0,
                (false, false) => eye(i, j),
            }),
            b: Mat::from_fn(
                n + m,
                m,
                |i, j| if i < n { b[(i, j)] } else { eye(i - n, j) },
            ),
            q: Mat::from_fn(n + m, n + m, |i, j| match (i < n, j < n) {
                (true, true) => q[(i, j)],
                (false, false) => r[(i - n, j - n)],
                _ => 0.0,
            }),
            r: add_scaled(&r, 1.0, &r_rate),
            s: Mat::from_fn(n + m, m, |i, j| if i < n { 0.0 } else { r[(i - n, j)] }),
        })
    }

    /// The same constraints for state (x, u_prev) and input du.
    #[must_use]
    pub fn constraints(original: &Constraints) -> Constraints {
        let sum = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x + y).collect();
        Constraints {
            states: original.states + original.inputs,
            inputs: original.inputs,
            rows: original
                .rows
                .iter()
                .map(|c| Constraint {
                    on_x: c.on_x.iter().chain(&c.on_u).copied().collect(),
                    on_u: sum(&c.on_u, &c.on_rate),
                    on_rate: vec![0.0; original.inputs],
                    ..c.clone()
                })
                .collect(),
        }
    }
}
