//! Diagonal scaling of a Riccati problem, so that units cost the solver no digits.

use crate::arithmetic::scaling::{power_of_two, scaled};
use crate::riccati::problem::Problem;
use faer::Mat;

/// A problem in coordinates x = T z with the cost divided by `cost`; T diagonal, all powers of two so that no digit changes.
#[derive(Debug, Clone)]
pub(crate) struct Balanced {
    pub(crate) problem: Problem,
    pub(crate) state_scale: Vec<f64>,
    pub(crate) cost_scale: f64,
}

impl Balanced {
    /// Brings what enters a state (its row of A, its share of B R^-1 B') level with what leaves it (its column of A, its
    /// weight in Q). Without it a weight or an input in other units costs the solver digits.
    pub(crate) fn of(problem: &Problem) -> Self {
        let n = problem.states();
        let effort: Vec<f64> = (0..n)
            .map(|i| {
                (0..problem.b.ncols())
                    .filter(|&j| problem.r[(j, j)] > 0.0)
                    .map(|j| problem.b[(i, j)].powi(2) / problem.r[(j, j)])
                    .sum()
            })
            .collect();
        let (g, h) = (
            effort.iter().copied().fold(0.0, f64::max),
            (0..n).map(|i| problem.q[(i, i)]).fold(0.0, f64::max),
        );
        let cost_scale = if g > 0.0 && h > 0.0 {
            power_of_two((h / g).sqrt())
        } else {
            1.0
        };
        let mut t = vec![1.0_f64; n];
        for _ in 0..3 {
            for i in 0..n {
                let (mut enters, mut leaves) = (
                    effort[i] * cost_scale / (t[i] * t[i]),
                    problem.q[(i, i)] / cost_scale * t[i] * t[i],
                );
                for j in (0..n).filter(|&j| j != i) {
                    enters += problem.a[(i, j)].abs() * t[j] / t[i];
                    leaves += problem.a[(j, i)].abs() * t[i] / t[j];
                }
                if enters > 0.0 && leaves > 0.0 {
                    let factor = power_of_two((enters / leaves).sqrt().sqrt());
                    t[i] = (t[i] * factor).clamp(2.0_f64.powi(-80), 2.0_f64.powi(80));
                }
            }
        }
        let down: Vec<f64> = t.iter().map(|t| 1.0 / t).collect();
        let up: Vec<f64> = t.iter().map(|t| t / cost_scale).collect();
        let (one, by_cost) = (
            vec![1.0; problem.b.ncols()],
            vec![1.0 / cost_scale; problem.b.ncols()],
        );
        let balanced = Problem {
            a: scaled(&problem.a, &down, &t),
            b: scaled(&problem.b, &down, &one),
            q: scaled(&problem.q, &up, &t),
            r: scaled(&problem.r, &by_cost, &one),
            s: problem.s.as_ref().map(|s| scaled(s, &up, &one)),
        };
        Self {
            problem: balanced,
            state_scale: t,
            cost_scale,
        }
    }

    /// P in the caller's coordinates.
    pub(crate) fn restore(&self, p: &Mat<f64>) -> Mat<f64> {
        let t = &self.state_scale;
        Mat::from_fn(p.nrows(), p.ncols(), |i, j| {
            p[(i, j)] * self.cost_scale / t[i] / t[j]
        })
    }

    /// K in the caller's coordinates.
    pub(crate) fn restore_gain(&self, k: &Mat<f64>) -> Mat<f64> {
        Mat::from_fn(k.nrows(), k.ncols(), |i, j| k[(i, j)] / self.state_scale[j])
    }
}
