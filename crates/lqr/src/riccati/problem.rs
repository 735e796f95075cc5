//! The Riccati problem in validated form, one backward step of it, and its residual.
//!
//! Everything is written for the stage cost x'Qx + 2x'Su + u'Ru and the law u = Kx,
//! K = -(R + B'PB)^-1 (B'PA + S'). The right side of the equation is evaluated in Joseph form,
//! Q + SK + (SK)' + K'RK + (A + BK)'P(A + BK): for the optimal K it is equal to the textbook form and
//! loses no digits when A'PA and its reduction nearly cancel.

use crate::arithmetic::definiteness::indefinite_weight;
use crate::arithmetic::dense::{
    accumulate, add_scaled, cholesky, cholesky_solve, congruence, mul, norm, symmetrise, tr_mul,
};
use crate::input::{self, InputError};
use crate::riccati::doubling::StageMap;
use crate::riccati::padded::{Step, backward as small_backward, by_states_and_inputs};
use faer::{Mat, MatRef};

/// Data of x+ = Ax + Bu with cost x'Qx + 2x'Su + u'Ru: A n x n, B n x m, Q n x n, R m x m, S n x m.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub(crate) a: Mat<f64>,
    pub(crate) b: Mat<f64>,
    pub(crate) q: Mat<f64>,
    pub(crate) r: Mat<f64>,
    pub(crate) s: Option<Mat<f64>>,
}

/// A P with everything that follows from it.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub(crate) p: Mat<f64>,
    pub(crate) k: Mat<f64>,
    pub(crate) closed_loop: Mat<f64>,
    /// Of R + B'PB: the least Cholesky pivot over its diagonal entry.
    pub(crate) hessian_pivot: f64,
    /// Right side of the equation minus P.
    pub(crate) residual: Mat<f64>,
    /// |residual| / max(|P|, |Q|), Frobenius norms.
    pub(crate) relative_residual: f64,
}

impl Problem {
    /// The data with shapes, finiteness and symmetry checked.
    pub(crate) fn read(
        a: MatRef<'_, f64>,
        b: MatRef<'_, f64>,
        q: MatRef<'_, f64>,
        r: MatRef<'_, f64>,
        s: Option<MatRef<'_, f64>>,
    ) -> Result<Self, InputError> {
        let (a, b) = input::pair(a, b)?;
        let (n, m) = (b.nrows(), b.ncols());
        Ok(Self {
            q: input::symmetric("Q", q, n)?,
            r: input::symmetric("R", r, m)?,
            s: s.map(|s| input::matrix("S", s, (n, m))).transpose()?,
            a,
            b,
        })
    }

    pub(crate) fn states(&self) -> usize {
        self.a.nrows()
    }

    /// R + B'PB.
    fn hessian(&self, pb: &Mat<f64>) -> Mat<f64> {
        let mut hessian = add_scaled(&self.r, 1.0, &tr_mul(&self.b, pb));
        symmetrise(&mut hessian);
        hessian
    }

    /// The least Cholesky pivot of R + B'PB over its diagonal entry; zero where an input depends on the others.
    pub(crate) fn hessian_pivot(&self, p: &Mat<f64>) -> f64 {
        let hessian = self.hessian(&mul(p, &self.b));
        cholesky(&hessian).map_or(0.0, |l| {
            (0..l.nrows())
                .map(|i| l[(i, i)] * l[(i, i)] / hessian[(i, i)])
                .fold(1.0, f64::min)
        })
    }

    /// K = -(R + B'PB)^-1 (B'PA + S'); `None` where R + B'PB is not positive definite.
    pub(crate) fn gain(&self, p: &Mat<f64>) -> Option<Mat<f64>> {
        let pb = mul(p, &self.b);
        let hessian = self.hessian(&pb);
        let mut gradient = tr_mul(&pb, &self.a);
        if let Some(s) = &self.s {
            gradient = add_scaled(&gradient, 1.0, &s.transpose().to_owned());
        }
        let mut k = cholesky_solve(&cholesky(&hessian)?, gradient);
        negate(&mut k);
        Some(k)
    }

    pub(crate) fn closed_loop(&self, k: &Mat<f64>) -> Mat<f64> {
        add_scaled(&self.a, 1.0, &mul(&self.b, k))
    }

    /// Q + SK + (SK)' + K'RK, the stage cost under u = Kx.
    pub(crate) fn stage_cost(&self, k: &Mat<f64>) -> Mat<f64> {
        let mut cost = add_scaled(&self.q, 1.0, &congruence(k, &self.r));
        if let Some(s) = &self.s {
            let sk = mul(s, k);
            cost = add_scaled(
                &cost,
                1.0,
                &add_scaled(&sk, 1.0, &sk.transpose().to_owned()),
            );
        }
        symmetrise(&mut cost);
        cost
    }

    /// One backward step in Joseph form from the cost-to-go `p`; `None` where R + B'PB is not positive definite.
    pub(crate) fn backward(&self, p: &Mat<f64>) -> Option<Step> {
        let (n, m) = (self.states(), self.b.ncols());
        if let Some(step) = by_states_and_inputs!(n, m, small_backward(self, p)) {
            return step;
        }
        let k = self.gain(p)?;
        let closed_loop = self.closed_loop(&k);
        let before = add_scaled(&self.stage_cost(&k), 1.0, &congruence(&closed_loop, p));
        Some(Step {
            k,
            closed_loop,
            before,
            hessian_pivot: self.hessian_pivot(p),
        })
    }

    pub(crate) fn evaluate(&self, p: Mat<f64>) -> Option<Candidate> {
        let step = self.backward(&p)?;
        let mut residual = step.before;
        accumulate(&mut residual, -1.0, &p);
        let scale = norm(&p).max(norm(&self.q));
        let size = norm(&residual);
        let relative_residual = if size == 0.0 { 0.0 } else { size / scale };
        relative_residual.is_finite().then_some(Candidate {
            p,
            k: step.k,
            closed_loop: step.closed_loop,
            hessian_pivot: step.hessian_pivot,
            residual,
            relative_residual,
        })
    }

    /// The same P from a cost that starts one step later: P = Q + Y, where Y solves an equation whose input
    /// weight R + B'QB may be invertible although R is not.
    pub(crate) fn shifted(&self) -> Self {
        let qb = mul(&self.q, &self.b);
        let mut r = add_scaled(&self.r, 1.0, &tr_mul(&self.b, &qb));
        symmetrise(&mut r);
        let mut s = tr_mul(&self.a, &qb);
        if let Some(own) = &self.s {
            s = add_scaled(&s, 1.0, own);
        }
        Self {
            a: self.a.clone(),
            b: self.b.clone(),
            q: congruence(&self.a, &self.q),
            r,
            s: Some(s),
        }
    }

    /// (A - BR^-1S', BR^-1B', Q - SR^-1S'): the equation without its cross term, or `None` for a singular R.
    pub(crate) fn stage_map(&self) -> Option<StageMap> {
        let r = cholesky(&self.r)?;
        let solved = cholesky_solve(&r, self.b.transpose().to_owned());
        let mut g = mul(&self.b, &solved);
        symmetrise(&mut g);
        let Some(s) = &self.s else {
            return Some(StageMap {
                a: self.a.clone(),
                g,
                h: self.q.clone(),
            });
        };
        let solved = cholesky_solve(&r, s.transpose().to_owned());
        let mut h = add_scaled(&self.q, -1.0, &mul(s, &solved));
        symmetrise(&mut h);
        Some(StageMap {
            a: add_scaled(&self.a, -1.0, &mul(&self.b, &solved)),
            g,
            h,
        })
    }

    /// The first of Q, R and [Q S; S' R] that is indefinite beyond rounding: its name, least eigenvalue and tolerance.
    pub(crate) fn indefinite_weight(&self) -> Option<(&'static str, f64, f64)> {
        let joint = self.joint_weight();
        [
            ("Q", Some(&self.q)),
            ("R", Some(&self.r)),
            ("[Q S; S' R]", joint.as_ref()),
        ]
        .into_iter()
        .find_map(|(name, weight)| {
            let (eigenvalue, tolerance) = indefinite_weight(weight?)?;
            Some((name, eigenvalue, tolerance))
        })
    }

    /// The joint weight [Q S; S' R].
    fn joint_weight(&self) -> Option<Mat<f64>> {
        let s = self.s.as_ref()?;
        let (n, m) = (s.nrows(), s.ncols());
        Some(Mat::from_fn(n + m, n + m, |i, j| match (i < n, j < n) {
            (true, true) => self.q[(i, j)],
            (true, false) => s[(i, j - n)],
            (false, true) => s[(j, i - n)],
            (false, false) => self.r[(i - n, j - n)],
        }))
    }
}

pub(crate) fn negate(a: &mut Mat<f64>) {
    for j in 0..a.ncols() {
        for x in a.col_as_slice_mut(j) {
            *x = -*x;
        }
    }
}
