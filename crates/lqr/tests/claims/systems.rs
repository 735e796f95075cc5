//! Random systems with a known structure, from a seed.

use faer::Mat;
use lqr::{Dare, DareSolution, Stage};

/// SplitMix64: a whole test case is one number in a failure report.
#[derive(Debug, Clone)]
pub(crate) struct Source(pub(crate) u64);

impl Source {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Sum of uniforms: bell-shaped, mean 0, variance 1.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    pub(crate) fn matrix(&mut self, rows: usize, cols: usize) -> Mat<f64> {
        Mat::from_fn(rows, cols, |_, _| self.normal())
    }

    pub(crate) fn vector(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.normal()).collect()
    }

    /// Orthogonal factor of a random matrix.
    pub(crate) fn orthogonal(&mut self, n: usize) -> Mat<f64> {
        self.matrix(n, n).qr().compute_Q()
    }

    /// U diag V' with condition number 10^digits.
    pub(crate) fn conditioned(&mut self, n: usize, digits: f64) -> Mat<f64> {
        let (u, v) = (self.orthogonal(n), self.orthogonal(n));
        let step = if n > 1 { digits / (n - 1) as f64 } else { 0.0 };
        let middle = Mat::from_fn(n, n, |i, j| {
            if i == j {
                10f64.powf(-step * i as f64)
            } else {
                0.0
            }
        });
        &u * &middle * v.transpose()
    }

    /// Positive definite with condition number 10^digits.
    pub(crate) fn weight(&mut self, n: usize, digits: f64) -> Mat<f64> {
        let half = self.conditioned(n, digits / 2.0);
        let w = &half * half.transpose();
        Mat::from_fn(n, n, |i, j| 0.5 * (w[(i, j)] + w[(j, i)]))
    }
}

/// x+ = Ax + Bu with weights.
#[derive(Debug, Clone)]
pub(crate) struct System {
    pub(crate) a: Mat<f64>,
    pub(crate) b: Mat<f64>,
    pub(crate) q: Mat<f64>,
    pub(crate) r: Mat<f64>,
}

impl System {
    pub(crate) fn dare(&self) -> Dare<'_> {
        Dare::new(
            self.a.as_ref(),
            self.b.as_ref(),
            self.q.as_ref(),
            self.r.as_ref(),
        )
    }

    pub(crate) fn stage(&self) -> Stage<'_> {
        Stage::new(
            self.a.as_ref(),
            self.b.as_ref(),
            self.q.as_ref(),
            self.r.as_ref(),
        )
    }

    /// Full random A scaled to a spectral radius, full random B, weights of the given condition.
    pub(crate) fn random(
        source: &mut Source,
        n: usize,
        m: usize,
        radius: f64,
        digits: f64,
    ) -> Self {
        let a = source.matrix(n, n);
        let now = lqr::spectral_radius(a.as_ref()).unwrap().max(1e-3);
        Self {
            a: Mat::from_fn(n, n, |i, j| a[(i, j)] * radius / now),
            b: source.matrix(n, m),
            q: source.weight(n, digits),
            r: source.weight(m, digits),
        }
    }

    /// `random`, seen through coordinates of condition 10^digits.
    pub(crate) fn skewed(
        source: &mut Source,
        n: usize,
        m: usize,
        radius: f64,
        digits: f64,
    ) -> Self {
        let plain = Self::random(source, n, m, radius, 0.0);
        let t = source.conditioned(n, digits);
        let solve = |rhs: &Mat<f64>| {
            use faer::prelude::Solve;
            t.partial_piv_lu().solve(rhs)
        };
        Self {
            a: solve(&(&plain.a * &t)),
            b: solve(&plain.b),
            ..plain
        }
    }

    /// A pair with one mode `lambda` that no input reaches, hidden by an orthogonal change of coordinates;
    /// returns the left eigenvector as well.
    pub(crate) fn with_unreached_mode(
        source: &mut Source,
        n: usize,
        m: usize,
        lambda: f64,
    ) -> (Self, Vec<f64>) {
        let mut plain = Self::random(source, n, m, 0.9, 0.0);
        for j in 0..n {
            plain.a[(n - 1, j)] = if j == n - 1 { lambda } else { 0.0 };
        }
        for j in 0..m {
            plain.b[(n - 1, j)] = 0.0;
        }
        let t = source.orthogonal(n);
        let left = (0..n).map(|i| t[(i, n - 1)]).collect();
        (
            Self {
                a: &t * &plain.a * t.transpose(),
                b: &t * &plain.b,
                ..plain
            },
            left,
        )
    }
}

pub(crate) fn norm(a: &Mat<f64>) -> f64 {
    a.norm_l2()
}

/// The textbook right side of the equation minus P, over max(|P|, |Q|): written apart from the library's Joseph form.
pub(crate) fn textbook_residual(system: &System, p: &Mat<f64>) -> f64 {
    use faer::prelude::Solve;
    let (a, b) = (&system.a, &system.b);
    let hessian = &system.r + b.transpose() * p * b;
    let gradient = b.transpose() * p * a;
    let reduction = gradient.transpose() * hessian.partial_piv_lu().solve(&gradient);
    let right = &system.q + a.transpose() * p * a - reduction;
    norm(&(&right - p)) / norm(p).max(norm(&system.q)).max(f64::MIN_POSITIVE)
}

/// Value iteration from zero, in textbook form, until it stands still.
pub(crate) fn value_iteration(system: &System, steps: usize) -> Mat<f64> {
    use faer::prelude::Solve;
    let (a, b) = (&system.a, &system.b);
    let mut p = system.q.clone();
    for _ in 0..steps {
        let gradient = b.transpose() * &p * a;
        let hessian = &system.r + b.transpose() * &p * b;
        let next = &system.q + a.transpose() * &p * a
            - gradient.transpose() * hessian.partial_piv_lu().solve(&gradient);
        let change = norm(&(&next - &p)) / norm(&next);
        p = Mat::from_fn(p.nrows(), p.ncols(), |i, j| {
            0.5 * (next[(i, j)] + next[(j, i)])
        });
        if change < 1e-15 {
            break;
        }
    }
    p
}

pub(crate) fn closed_loop(system: &System, solution: &DareSolution) -> Mat<f64> {
    &system.a + &system.b * &solution.k
}

pub(crate) fn apply(m: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    (0..m.nrows())
        .map(|i| (0..m.ncols()).map(|j| m[(i, j)] * x[j]).sum())
        .collect()
}
