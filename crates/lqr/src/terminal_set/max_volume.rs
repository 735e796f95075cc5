//! The ellipsoid of largest volume that is invariant under a law and admissible.
//!
//! With W the inverse of the shape matrix the problem is the semidefinite program
//! maximise log det W subject to W - A_K W A_K' >= 0 and f_i W f_i' <= h_i^2. It has n(n+1)/2 unknowns (36 for eight states), so its own
//! barrier method is short and needs no conic solver: maximise t log det W + log det(W - A_K W A_K') + sum log(h_i^2 - f_i W f_i'),
//! a self-concordant function, by damped Newton steps for growing t. At a centre the volume's logarithm is within (n + rows) / t of the optimum (the duality gap).
//! Every iterate is strictly feasible, so what is returned satisfies both conditions with a margin, optimal or not.

use crate::arithmetic::dense::{
    add_scaled, cholesky, cholesky_solve, forward_substitute, identity, mul, mul_tr, norm, solve,
    symmetrise, tr_mul,
};
use crate::input;
use crate::modes::spectrum::{self, lyapunov_sum};
use crate::terminal_set::constraints::LawRow;
use crate::terminal_set::ellipsoid::{Ellipsoid, TerminalSetError};
use faer::{Mat, MatRef};

/// Bound on the distance of 2 log(volume) to its optimum at which the method stops.
const GAP: f64 = 1e-6;
const MAX_NEWTON_STEPS: usize = 400;

/// The largest-volume ellipsoid { x : x'W^-1 x <= 1 } that x+ = A_K x maps into itself and that satisfies all rows.
///
/// `closed_loop` is A + BK, n x n. The level of the result is one. Its volume is optimal to a factor of 1 - 5e-7.
///
/// # Errors
/// [`TerminalSetError::Unstable`] for an unstable closed loop; `NoInterior` for a limit of zero; `NotPositiveDefinite` where too few rows leave no
/// bounded set; `NoConvergence` past the cap of Newton steps.
pub fn largest_volume_ellipsoid(
    closed_loop: MatRef<'_, f64>,
    rows: &[LawRow],
) -> Result<Ellipsoid, TerminalSetError> {
    let n = closed_loop.nrows();
    if n == 0 {
        return Err(input::InputError::Empty { name: "A_K" }.into());
    }
    let a = input::matrix("A_K", closed_loop, (n, n))?;
    let mut limits = Vec::new();
    for row in rows {
        let f = input::matrix(
            "row",
            MatRef::from_column_major_slice(&row.row, row.row.len(), 1),
            (n, 1),
        )?;
        if norm(&f) > 0.0 {
            if !(row.bound > 0.0) {
                return Err(TerminalSetError::NoInterior {
                    name: row.name.clone(),
                    bound: row.bound,
                });
            }
            limits.push(add_scaled(&Mat::zeros(n, 1), 1.0 / row.bound, &f));
        }
    }
    let (start, coordinates) = strictly_feasible(&a, &limits)?;
    let barrier = Barrier {
        a: transformed(&a, &coordinates)?,
        limits: limits.iter().map(|f| tr_mul(&coordinates, f)).collect(),
    };
    let w = barrier.maximise(start)?;
    let w = mul_tr(&mul(&coordinates, &w), &coordinates);
    let factor = cholesky(&w).ok_or(TerminalSetError::NotPositiveDefinite)?;
    let mut p = cholesky_solve(&factor, identity(n));
    symmetrise(&mut p);
    Ellipsoid::with_level(p.as_ref(), 1.0)
}

/// A strictly feasible W = T T' and T: in the coordinates x = T z it is the identity, scaled.
fn strictly_feasible(
    a: &Mat<f64>,
    limits: &[Mat<f64>],
) -> Result<(Mat<f64>, Mat<f64>), TerminalSetError> {
    let n = a.nrows();
    let unstable = || TerminalSetError::Unstable {
        spectral_radius: spectrum::largest_modulus(a).unwrap_or(f64::NAN),
    };
    if !(spectrum::largest_modulus(a).is_ok_and(|radius| radius < 1.0)) {
        return Err(unstable());
    }
    // The image is unbounded unless the observed rows see every state.
    let seen = limits.iter().fold(Mat::zeros(n, n), |sum: Mat<f64>, f| {
        add_scaled(&sum, 1.0, &mul_tr(f, f))
    });
    let seen = lyapunov_sum(a, &seen).ok_or_else(unstable)?;
    let factor = cholesky(&seen).ok_or(TerminalSetError::NotPositiveDefinite)?;
    // Stationary covariance of noise in the shape of the constraints: invariant, and adapted to their units.
    let noise = cholesky_solve(&factor, identity(n));
    let mut w = lyapunov_sum(&a.transpose().to_owned(), &noise).ok_or_else(unstable)?;
    let worst = limits
        .iter()
        .map(|f| tr_mul(f, &mul(&w, f))[(0, 0)])
        .fold(0.0, f64::max);
    w = add_scaled(&Mat::zeros(n, n), 0.5 / worst, &w);
    symmetrise(&mut w);
    let t = cholesky(&w).ok_or(TerminalSetError::NotPositiveDefinite)?;
    Ok((identity(n), t))
}

/// T^-1 A T.
fn transformed(a: &Mat<f64>, t: &Mat<f64>) -> Result<Mat<f64>, TerminalSetError> {
    solve(t.clone(), mul(a, t)).ok_or(TerminalSetError::NotPositiveDefinite)
}

struct Barrier {
    a: Mat<f64>,
    limits: Vec<Mat<f64>>,
}

impl Barrier {
    fn maximise(&self, mut w: Mat<f64>) -> Result<Mat<f64>, TerminalSetError> {
        let complexity = (self.a.nrows() + self.limits.len()) as f64;
        let mut t = 1.0;
        let mut steps = 0;
        loop {
            loop {
                let (direction, decrement) = self
                    .newton(&w, t)
                    .ok_or(TerminalSetError::NotPositiveDefinite)?;
                if decrement < 1e-3 {
                    break;
                }
                steps += 1;
                if steps > MAX_NEWTON_STEPS {
                    return Err(TerminalSetError::NoConvergence { steps, decrement });
                }
                // Damping by 1 / (1 + decrement) stays inside for a self-concordant function; full steps near the centre.
                let length = if decrement < 0.25 {
                    1.0
                } else {
                    1.0 / (1.0 + decrement)
                };
                w = self
                    .inside(&w, length, &direction)
                    .ok_or(TerminalSetError::NoConvergence { steps, decrement })?;
            }
            if complexity / t < GAP {
                return Ok(w);
            }
            t *= 8.0;
        }
    }

    fn slacks(&self, w: &Mat<f64>) -> Option<(Mat<f64>, Mat<f64>, Vec<f64>)> {
        let mut difference = add_scaled(w, -1.0, &mul_tr(&mul(&self.a, w), &self.a));
        symmetrise(&mut difference);
        let rest: Vec<f64> = self
            .limits
            .iter()
            .map(|f| 1.0 - tr_mul(f, &mul(w, f))[(0, 0)])
            .collect();
        if !rest.iter().all(|&slack| slack > 0.0) {
            return None;
        }
        Some((cholesky(w)?, cholesky(&difference)?, rest))
    }

    /// Halves the step while rounding has put it outside.
    fn inside(&self, w: &Mat<f64>, mut length: f64, direction: &Mat<f64>) -> Option<Mat<f64>> {
        for _ in 0..40 {
            let mut next = add_scaled(w, length, direction);
            symmetrise(&mut next);
            if self.slacks(&next).is_some() {
                return Some(next);
            }
            length *= 0.5;
        }
        None
    }

    /// Newton direction and decrement of the barrier at a feasible W.
    fn newton(&self, w: &Mat<f64>, t: f64) -> Option<(Mat<f64>, f64)> {
        let n = w.nrows();
        let (wl, dl, rest) = self.slacks(w)?;
        let pairs: Vec<(usize, usize)> =
            (0..n).flat_map(|j| (0..=j).map(move |i| (i, j))).collect();
        let basis: Vec<Mat<f64>> = pairs
            .iter()
            .map(|&(i, j)| {
                Mat::from_fn(n, n, |r, c| {
                    if (r, c) == (i, j) || (r, c) == (j, i) {
                        1.0
                    } else {
                        0.0
                    }
                })
            })
            .collect();
        // L^-1 E L^-T and the same for the image under W - A W A': then traces of products are inner products.
        let whiten = |l: &Mat<f64>, e: Mat<f64>| -> Mat<f64> {
            let mut half = e;
            forward_substitute(l, &mut half);
            let mut other = half.transpose().to_owned();
            forward_substitute(l, &mut other);
            other
        };
        let on_w: Vec<Mat<f64>> = basis.iter().map(|e| whiten(&wl, e.clone())).collect();
        let on_d: Vec<Mat<f64>> = basis
            .iter()
            .map(|e| whiten(&dl, add_scaled(e, -1.0, &mul_tr(&mul(&self.a, e), &self.a))))
            .collect();
        let on_rows: Vec<Vec<f64>> = basis
            .iter()
            .map(|e| {
                self.limits
                    .iter()
                    .zip(&rest)
                    .map(|(f, slack)| -tr_mul(f, &mul(e, f))[(0, 0)] / slack)
                    .collect()
            })
            .collect();
        let trace = |m: &Mat<f64>| (0..n).map(|i| m[(i, i)]).sum::<f64>();
        let inner = |x: &Mat<f64>, y: &Mat<f64>| {
            (0..n)
                .map(|j| {
                    x.col_as_slice(j)
                        .iter()
                        .zip(y.col_as_slice(j))
                        .map(|(x, y)| x * y)
                        .sum::<f64>()
                })
                .sum::<f64>()
        };
        let size = pairs.len();
        let gradient = Mat::from_fn(size, 1, |i, _| {
            t * trace(&on_w[i]) + trace(&on_d[i]) + on_rows[i].iter().sum::<f64>()
        });
        let hessian = Mat::from_fn(size, size, |i, j| {
            let rows: f64 = on_rows[i].iter().zip(&on_rows[j]).map(|(x, y)| x * y).sum();
            t * inner(&on_w[i], &on_w[j]) + inner(&on_d[i], &on_d[j]) + rows
        });
        let step = cholesky_solve(&cholesky(&hessian)?, gradient.clone());
        let decrement = tr_mul(&gradient, &step)[(0, 0)].max(0.0).sqrt();
        let mut direction = Mat::zeros(n, n);
        for (&(i, j), index) in pairs.iter().zip(0..) {
            direction[(i, j)] = step[(index, 0)];
            direction[(j, i)] = step[(index, 0)];
        }
        Some((direction, decrement))
    }
}
