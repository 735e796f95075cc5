//! The stabilising solution in double-double arithmetic, and a proof that rounding of the data does not decide it.
//!
//! For what is beyond doubles: coordinates of condition 1e6, one input against a dozen unstable modes. There A + BK cancels ten digits
//! and a residual in doubles says nothing. Doubling gives a law, Kleinman's iteration its solution. Then the question is whether the *data*
//! say enough. In coordinates z = L'x with W = LL' close to P the closed loop M is a contraction, and entries of A and B that move by
//! one rounding move it by at most eta = eps | |L'| (|A| + |B||K|) |L^-T| |. While eta times the resolvent |(M - lambda I)^-1|, |lambda| >= 1, is
//! small, K stabilises every pair that rounds to the given one. Otherwise there is no answer here, however good the residual.

use crate::arithmetic::dense::{add_scaled, identity, mul, norm};
use crate::arithmetic::double_double::{Wide, WideMat};
use crate::modes::spectrum::{self, lyapunov_sum, sum_of_powers};
use crate::riccati::problem::Problem;
use faer::Mat;

/// Larger systems would take seconds.
const MAX_STATES: usize = 40;
const MAX_DOUBLINGS: usize = 60;
const MAX_KLEINMAN_STEPS: usize = 60;
const MAX_SQUARINGS: usize = 70;
/// Change of P, relative to it, at which Kleinman's iteration has converged.
const CONVERGED: f64 = 1e-24;
/// Change from which on a rise is rounding.
const SETTLED: f64 = 1e-9;
/// Of eta times the resolvent: the proof holds below one, less its own rounding.
const DECIDED: f64 = 0.5;

/// What 106 bits say of a problem.
#[derive(Debug)]
pub(crate) enum Extended {
    /// Its solution rounded to doubles, which no rounding of the data takes away.
    Decided {
        p: Mat<f64>,
        k: Mat<f64>,
        /// Of A + BK for the K as rounded.
        spectral_radius: f64,
        iterations: usize,
    },
    /// A solution with inputs that only rounding of R and B tells apart: R + B'PB is singular to working precision.
    Dependent,
    /// A solution of the numbers as stored, but other numbers that round to them may have none.
    Undecided {
        /// eta times the bound on the resolvent: one is where the proof ends.
        sensitivity: f64,
    },
    /// No stabilising solution was found.
    NotFound,
}

struct WideProblem {
    a: WideMat,
    b: WideMat,
    q: WideMat,
    r: WideMat,
    s: Option<WideMat>,
}

/// The solution of `problem`, and whether its data decide that it is one.
pub(crate) fn extended_solution(problem: &Problem) -> Extended {
    if problem.states() > MAX_STATES {
        return Extended::NotFound;
    }
    let wide = WideProblem::of(problem);
    let starts = [
        WideProblem::doubled as fn(&WideProblem) -> Option<(WideMat, usize)>,
        WideProblem::doubled_one_step_later,
        WideProblem::doubled_with_every_mode_seen,
    ];
    for start in starts {
        let solution = start(&wide).and_then(|(k, doublings)| {
            let (p, k, steps) = wide.kleinman(&k)?;
            let apart = wide.tells_inputs_apart(&p)?;
            Some((p.rounded(), k.rounded(), apart, doublings + steps))
        });
        let Some((p, k, apart, iterations)) = solution else {
            continue;
        };
        if !apart {
            return Extended::Dependent;
        }
        if let Some((spectral_radius, sensitivity)) = stability(problem, &wide, &p, &k) {
            // The stabilising solution is unique: another start would lead to the same.
            return if sensitivity < DECIDED {
                Extended::Decided {
                    p,
                    k,
                    spectral_radius,
                    iterations,
                }
            } else {
                Extended::Undecided { sensitivity }
            };
        }
    }
    Extended::NotFound
}

/// |right side - P| / max(|P|, |Q|) for a P of doubles, evaluated in double-double.
pub(crate) fn extended_residual(problem: &Problem, p: &Mat<f64>) -> Option<f64> {
    WideProblem::of(problem).relative_residual(p)
}

impl WideProblem {
    fn of(problem: &Problem) -> Self {
        Self {
            a: WideMat::of(&problem.a),
            b: WideMat::of(&problem.b),
            q: WideMat::of(&problem.q),
            r: WideMat::of(&problem.r),
            s: problem.s.as_ref().map(WideMat::of),
        }
    }

    /// -(R + B'PB)^-1 (B'PA + S').
    fn gain(&self, p: &WideMat) -> Option<WideMat> {
        let hessian = self.r.plus(1.0, &p.congruence(&self.b));
        hessian.cholesky()?;
        let mut gradient = self.b.transposed().mul(&p.mul(&self.a));
        if let Some(s) = &self.s {
            gradient = gradient.plus(1.0, &s.transposed());
        }
        let k = hessian.solve(gradient)?;
        Some(k.plus(-2.0, &k))
    }

    /// Whether the Cholesky pivots of R + B'PB are above what rounding of R and B makes of them: the first moves a pivot by
    /// its own size, the second turns a column by a rounding, and the pivot is the square of a distance.
    fn tells_inputs_apart(&self, p: &WideMat) -> Option<bool> {
        let through_states = p.congruence(&self.b);
        let l = self.r.plus(1.0, &through_states).cholesky()?;
        let inputs = l.rounded().nrows();
        let rounding = 64.0 * inputs as f64 * f64::EPSILON;
        Some((0..inputs).all(|i| {
            let (r, effect) = (self.r.at(i, i), through_states.at(i, i));
            let floor = rounding * r.rounded() + rounding * rounding * effect.rounded();
            (l.at(i, i) * l.at(i, i)).rounded() > floor
        }))
    }

    fn closed_loop(&self, k: &WideMat) -> WideMat {
        self.a.plus(1.0, &self.b.mul(k))
    }

    fn stage_cost(&self, k: &WideMat) -> WideMat {
        let mut cost = self.q.plus(1.0, &self.r.congruence(k));
        if let Some(s) = &self.s {
            let sk = s.mul(k);
            cost = cost.plus(1.0, &sk).plus(1.0, &sk.transposed());
        }
        cost.symmetric_part()
    }

    /// Right side in Joseph form minus P.
    fn residual(&self, p: &WideMat, k: &WideMat) -> WideMat {
        self.stage_cost(k)
            .plus(1.0, &p.congruence(&self.closed_loop(k)))
            .plus(-1.0, p)
            .symmetric_part()
    }

    fn relative_residual(&self, p: &Mat<f64>) -> Option<f64> {
        let stored = WideMat::of(p);
        let size = self.residual(&stored, &self.gain(&stored)?).norm();
        let relative = size / norm(p).max(self.q.norm());
        if size == 0.0 {
            Some(0.0)
        } else {
            relative.is_finite().then_some(relative)
        }
    }

    /// The law of the fixed point of doubling, and the number of doublings.
    fn doubled(&self) -> Option<(WideMat, usize)> {
        let (p, doublings) = self.fixed_point()?;
        Some((self.gain(&p)?, doublings))
    }

    /// As `Problem::shifted`, for a singular R.
    fn doubled_one_step_later(&self) -> Option<(WideMat, usize)> {
        let mut s = self.a.transposed().mul(&self.q.mul(&self.b));
        if let Some(own) = &self.s {
            s = s.plus(1.0, own);
        }
        let later = Self {
            a: self.a.clone(),
            b: self.b.clone(),
            q: self.q.congruence(&self.a),
            r: self.r.plus(1.0, &self.q.congruence(&self.b)),
            s: Some(s),
        };
        let (y, doublings) = later.fixed_point()?;
        Some((self.gain(&y.plus(1.0, &self.q))?, doublings))
    }

    /// Under other weights, for an unstable mode that Q does not see.
    fn doubled_with_every_mode_seen(&self) -> Option<(WideMat, usize)> {
        let (n, m) = (self.a.rounded().nrows(), self.b.rounded().ncols());
        let effort = self.b.transposed().mul(&self.b);
        let seen = Self {
            a: self.a.clone(),
            b: self.b.clone(),
            q: WideMat::identity(n),
            r: WideMat::from_fn(m, m, |i, j| match (i == j, effort.at(i, i)) {
                (false, _) => Wide::ZERO,
                (true, square) if square.rounded() > 0.0 => square,
                (true, _) => Wide::ONE,
            }),
            s: None,
        };
        seen.doubled()
    }

    /// Limit of H under doubling, as `StageMap::fixed_point`.
    fn fixed_point(&self) -> Option<(WideMat, usize)> {
        self.r.cholesky()?;
        let solved = self.r.clone().solve(self.b.transposed())?;
        let mut g = self.b.mul(&solved).symmetric_part();
        let (mut a, mut h) = (self.a.clone(), self.q.clone());
        if let Some(s) = &self.s {
            let solved = self.r.clone().solve(s.transposed())?;
            a = a.plus(-1.0, &self.b.mul(&solved));
            h = h.plus(-1.0, &s.mul(&solved)).symmetric_part();
        }
        let n = a.rounded().nrows();
        for doubling in 1..=MAX_DOUBLINGS {
            let w = WideMat::identity(n).plus(1.0, &g.mul(&h));
            let both = WideMat::from_fn(
                n,
                2 * n,
                |i, j| {
                    if j < n { a.at(i, j) } else { g.at(i, j - n) }
                },
            );
            let solved = w.solve(both)?;
            let wa = WideMat::from_fn(n, n, |i, j| solved.at(i, j));
            let wg = WideMat::from_fn(n, n, |i, j| solved.at(i, n + j));
            let growth = a.transposed().mul(&h.mul(&wa)).symmetric_part();
            let reach = a.mul(&wg).mul(&a.transposed()).symmetric_part();
            h = h.plus(1.0, &growth);
            g = g.plus(1.0, &reach);
            a = a.mul(&wa);
            if !(h.norm().is_finite() && g.norm().is_finite() && a.norm().is_finite()) {
                return None;
            }
            if growth.norm() <= CONVERGED * h.norm() || a.norm() < 1e-20 {
                return Some((h, doubling));
            }
        }
        None
    }

    /// From a stabilising law to the optimal one: the cost of the law, then Newton steps on the residual in Joseph form, which is
    /// Kleinman's iteration with the rounding of the correction only.
    fn kleinman(&self, k: &WideMat) -> Option<(WideMat, WideMat, usize)> {
        let mut p = sum_along(self.closed_loop(k), self.stage_cost(k))?;
        let mut last = f64::INFINITY;
        for step in 1..=MAX_KLEINMAN_STEPS {
            let k = self.gain(&p)?;
            let correction = sum_along(self.closed_loop(&k), self.residual(&p, &k))?;
            let change = correction.norm() / p.norm().max(f64::MIN_POSITIVE);
            p = p.plus(1.0, &correction);
            // Once small the change falls to its rounding quadratically, and then no further.
            if change <= CONVERGED || (change < SETTLED && change >= 0.5 * last) {
                return Some((p, k, step));
            }
            last = change;
        }
        None
    }
}

/// Sum of A'^j Q A^j by squaring, as `spectrum::lyapunov_sum`.
fn sum_along(mut power: WideMat, mut x: WideMat) -> Option<WideMat> {
    for _ in 0..MAX_SQUARINGS {
        let size = power.norm();
        if !(size < 1e120) {
            return None;
        }
        x = x.plus(1.0, &x.congruence(&power));
        if size < 1e-20 {
            return x.norm().is_finite().then_some(x);
        }
        power = power.mul(&power);
    }
    None
}

/// Spectral radius of A + BK and eta times the resolvent bound; `None` for an unstable loop.
fn stability(
    problem: &Problem,
    wide: &WideProblem,
    p: &Mat<f64>,
    k: &Mat<f64>,
) -> Option<(f64, f64)> {
    let n = problem.states();
    let wide_k = WideMat::of(k);
    let closed_loop = wide.closed_loop(&wide_k);
    // A little more than the stage cost, so that a mode without cost has a length as well.
    let stage = wide.stage_cost(&wide_k).plus(
        f64::EPSILON * norm(p).max(f64::MIN_POSITIVE),
        &WideMat::identity(n),
    );
    let factor = sum_along(closed_loop.clone(), stage)?
        .cholesky()?
        .transposed();
    let inverse = factor.clone().solve(WideMat::identity(n))?;
    let contraction = factor.mul(&closed_loop).mul(&inverse).rounded();
    let spectral_radius = spectrum::largest_modulus(&contraction).ok()?;
    if !(spectral_radius < 1.0) {
        return None;
    }
    let entries = add_scaled(
        &absolute(&problem.a),
        1.0,
        &mul(&absolute(&problem.b), &absolute(k)),
    );
    let moved = mul(
        &mul(&absolute(&factor.rounded()), &entries),
        &absolute(&inverse.rounded()),
    );
    let by_cost =
        lyapunov_sum(&contraction, &identity(n)).map_or(f64::INFINITY, |x| 2.0 * norm(&x));
    let resolvent = by_cost.min(sum_of_powers(&contraction));
    Some((spectral_radius, f64::EPSILON * norm(&moved) * resolvent))
}

fn absolute(a: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)].abs())
}
