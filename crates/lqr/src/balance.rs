//! Diagonal scaling by powers of two: of a Riccati problem, so that units cost the solver no digits, and of a matrix for its eigenvalues.

use crate::riccati::Problem;
use faer::Mat;

const MAX_SWEEPS: usize = 30;

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

/// diag(rows) w diag(cols).
pub(crate) fn scaled(w: &Mat<f64>, rows: &[f64], cols: &[f64]) -> Mat<f64> {
    let mut w = w.clone();
    for (j, col) in cols.iter().enumerate() {
        for (x, row) in w.col_as_slice_mut(j).iter_mut().zip(rows) {
            *x *= row * col;
        }
    }
    w
}

/// The power of two next to `x`; 1 where `x` has none in range.
pub(crate) fn power_of_two(x: f64) -> f64 {
    let exponent = x.log2().round();
    if exponent.is_finite() && exponent.abs() <= 160.0 {
        exponent.exp2()
    } else {
        1.0
    }
}

/// `a` in coordinates where each state's row and column have the same sum of moduli (Parlett and Reinsch): computed eigenvalues then carry rounding
/// of *that* matrix, not of the largest entry that the units make.
pub(crate) fn level(a: &Mat<f64>) -> Mat<f64> {
    let (n, mut level) = (a.nrows(), a.clone());
    for _ in 0..MAX_SWEEPS {
        let mut settled = true;
        for i in 0..n {
            let others = || (0..n).filter(|&j| j != i);
            let enters: f64 = others().map(|j| level[(i, j)].abs()).sum();
            let leaves: f64 = others().map(|j| level[(j, i)].abs()).sum();
            // A factor that gains less than this is not worth another sweep.
            if enters == 0.0 || leaves == 0.0 || (0.25..=4.0).contains(&(enters / leaves)) {
                continue;
            }
            let factor = power_of_two((enters / leaves).sqrt());
            settled &= factor == 1.0;
            for j in others() {
                level[(i, j)] /= factor;
                level[(j, i)] *= factor;
            }
        }
        if settled {
            break;
        }
    }
    level
}
