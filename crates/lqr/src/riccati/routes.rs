//! Ways to a candidate for the stabilising Riccati solution, and its polish by Newton steps.
//!
//! A route may fail or lead to another solution; whether a candidate is the one sought is decided by
//! [`Attempt::is_stabilising`] alone, never by the route.

use crate::arithmetic::definiteness::indefinite;
use crate::arithmetic::dense::{self, identity, norm};
use crate::modes::spectrum::{self, lyapunov_sum};
use crate::riccati::padded::{by_states_and_inputs, problem_doubling};
use crate::riccati::problem::{Candidate, Problem};
use faer::Mat;

const MAX_DOUBLINGS: usize = 50;
const MAX_POLISH_STEPS: usize = 4;
const MAX_KLEINMAN_STEPS: usize = 100;
/// A candidate with a larger relative residual is no solution.
pub(crate) const ACCEPTED_RESIDUAL: f64 = 1e-8;

/// A polished candidate and how stable its closed loop is.
#[derive(Debug)]
pub(crate) struct Attempt {
    pub(crate) candidate: Candidate,
    pub(crate) spectral_radius: f64,
    pub(crate) iterations: usize,
}

impl Attempt {
    fn new(candidate: Candidate, iterations: usize) -> Self {
        let spectral_radius =
            spectrum::largest_modulus(&candidate.closed_loop).unwrap_or(f64::INFINITY);
        Self {
            candidate,
            spectral_radius,
            iterations,
        }
    }

    pub(crate) fn is_stabilising(&self) -> bool {
        self.spectral_radius < 1.0
            && self.candidate.relative_residual <= ACCEPTED_RESIDUAL
            && indefinite(&self.candidate.p).is_none()
    }

    pub(crate) fn is_better_than(&self, other: &Self) -> bool {
        let key = |x: &Self| (x.spectral_radius >= 1.0, x.candidate.relative_residual);
        key(self) < key(other)
    }
}

/// Ways to a candidate, cheapest first.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Route {
    /// Doubling on the problem as it is.
    Doubling,
    /// Doubling on the cost that starts one step later, for a singular R.
    ShiftedDoubling,
    /// Kleinman's iteration from the law of a problem whose weights see every mode.
    Regularised,
}

impl Route {
    pub(crate) fn attempts(self, problem: &Problem) -> Vec<Attempt> {
        match self {
            Self::Doubling => doubling(problem)
                .and_then(|(p, steps)| polish(problem, p, steps, MAX_POLISH_STEPS))
                .into_iter()
                .collect(),
            Self::ShiftedDoubling => doubling(&problem.shifted())
                .map(|(y, steps)| (dense::add_scaled(&y, 1.0, &problem.q), steps))
                .and_then(|(p, steps)| polish(problem, p, steps, MAX_POLISH_STEPS))
                .into_iter()
                .collect(),
            Self::Regularised => regularisations(problem)
                .iter()
                .filter_map(|surrogate| from_surrogate(problem, surrogate))
                .collect(),
        }
    }
}

/// Problems on the same pair whose weights see every mode, so that doubling finds *a* stabilising law.
fn regularisations(problem: &Problem) -> Vec<Problem> {
    let (n, m) = (problem.states(), problem.b.ncols());
    let eye = identity(n);
    let q_size = norm(&problem.q);
    let mut found = Vec::new();
    if q_size > 0.0 {
        found.push(Problem {
            q: dense::add_scaled(&problem.q, q_size, &eye),
            ..problem.clone()
        });
    }
    let column_sizes: Vec<f64> = (0..m)
        .map(|j| problem.b.col_as_slice(j).iter().map(|x| x * x).sum::<f64>())
        .map(|square| if square > 0.0 { square } else { 1.0 })
        .collect();
    for effort in [1.0, 1e-8, 1e8] {
        let r = Mat::from_fn(m, m, |i, j| {
            if i == j {
                effort * column_sizes[i]
            } else {
                0.0
            }
        });
        found.push(Problem {
            q: eye.clone(),
            r,
            s: None,
            ..problem.clone()
        });
    }
    found
}

fn doubling(problem: &Problem) -> Option<(Mat<f64>, usize)> {
    let (n, m) = (problem.states(), problem.b.ncols());
    match by_states_and_inputs!(n, m, problem_doubling(problem, MAX_DOUBLINGS)) {
        Some(limit) => limit,
        None => problem.stage_map()?.fixed_point(MAX_DOUBLINGS),
    }
}

fn from_surrogate(problem: &Problem, surrogate: &Problem) -> Option<Attempt> {
    let (p, steps) = doubling(surrogate)?;
    let k = surrogate.gain(&p)?;
    // The cost of that law under the true weights starts Kleinman's monotone iteration.
    let cost = lyapunov_sum(&problem.closed_loop(&k), &problem.stage_cost(&k))?;
    polish(problem, cost, steps + 1, MAX_KLEINMAN_STEPS)
}

/// Newton steps P + X, X = A_K'XA_K + residual, for as long as they help.
fn polish(
    problem: &Problem,
    p: Mat<f64>,
    mut iterations: usize,
    max_steps: usize,
) -> Option<Attempt> {
    let mut candidate = problem.evaluate(p)?;
    // Below this the residual is that of rounding P itself.
    let floor = problem.states() as f64 * f64::EPSILON;
    for _ in 0..max_steps {
        if candidate.relative_residual <= floor {
            break;
        }
        let Some(x) = lyapunov_sum(&candidate.closed_loop, &candidate.residual) else {
            break;
        };
        let mut p = dense::add_scaled(&candidate.p, 1.0, &x);
        dense::symmetrise(&mut p);
        iterations += 1;
        match problem.evaluate(p) {
            Some(next) if next.relative_residual < 0.5 * candidate.relative_residual => {
                candidate = next;
            }
            // Far from the solution the residual may rise for a step; near it a rise is rounding.
            Some(next) if candidate.relative_residual > 1e-6 => candidate = next,
            _ => break,
        }
    }
    Some(Attempt::new(candidate, iterations))
}
