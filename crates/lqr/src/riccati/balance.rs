//! Diagonal scaling of a Riccati problem, so that units cost the solver no digits.

use crate::arithmetic::scaling::{power_of_two, scale};
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
    pub(crate) fn of(mut problem: Problem) -> Self {
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
        let (mut t, mut down) = (vec![1.0_f64; n], vec![1.0_f64; n]);
        for _ in 0..3 {
            let mut settled = true;
            for i in 0..n {
                let (mut enters, mut leaves) = (
                    effort[i] * cost_scale * down[i],
                    problem.q[(i, i)] / cost_scale * t[i],
                );
                let column = problem.a.col_as_slice(i);
                for j in (0..n).filter(|&j| j != i) {
                    enters += problem.a.col_as_slice(j)[i].abs() * t[j];
                    leaves += column[j].abs() * down[j];
                }
                if enters > 0.0 && leaves > 0.0 {
                    let factor = power_of_two((enters * down[i] / (leaves * t[i])).sqrt().sqrt());
                    settled &= factor == 1.0;
                    t[i] = (t[i] * factor).clamp(2.0_f64.powi(-80), 2.0_f64.powi(80));
                    down[i] = 1.0 / t[i];
                }
            }
            if settled {
                break;
            }
        }
        let up: Vec<f64> = t.iter().map(|t| t / cost_scale).collect();
        let (one, by_cost) = (
            vec![1.0; problem.b.ncols()],
            vec![1.0 / cost_scale; problem.b.ncols()],
        );
        scale(&mut problem.a, &down, &t);
        scale(&mut problem.b, &down, &one);
        scale(&mut problem.q, &up, &t);
        scale(&mut problem.r, &by_cost, &one);
        if let Some(s) = &mut problem.s {
            scale(s, &up, &one);
        }
        Self {
            problem,
            state_scale: t,
            cost_scale,
        }
    }

    /// P in the caller's coordinates.
    pub(crate) fn restore(&self, mut p: Mat<f64>) -> Mat<f64> {
        let by_cost: Vec<f64> = self
            .state_scale
            .iter()
            .map(|t| self.cost_scale / t)
            .collect();
        let down: Vec<f64> = self.state_scale.iter().map(|t| 1.0 / t).collect();
        scale(&mut p, &by_cost, &down);
        p
    }

    /// K in the caller's coordinates.
    pub(crate) fn restore_gain(&self, mut k: Mat<f64>) -> Mat<f64> {
        let down: Vec<f64> = self.state_scale.iter().map(|t| 1.0 / t).collect();
        scale(&mut k, &vec![1.0; self.problem.b.ncols()], &down);
        k
    }
}
