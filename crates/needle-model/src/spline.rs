//! The two linear systems of a smooth curve through points: not-a-knot cubic splines and smoothing.
//!
//! Cubic with not-a-knot ends: C. de Boor, A Practical Guide to Splines, chapter IV. Natural ends would
//! force the curvature to zero there, which no needle does. Smoothing penalises third differences
//! (Whittaker-Henderson), which leaves quadratics and so nearly constant curvature alone; a penalty on
//! second differences would straighten them.

use nalgebra::{DMatrix, Vector3};

/// Second derivatives at the knots: continuity of the first derivative inside, one cubic across the
/// first and the last two segments. Elimination of the ends leaves a tridiagonal system.
pub(crate) fn not_a_knot(knots: &[f64], points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let n = knots.len() - 1;
    let h = |i: usize| knots[i + 1] - knots[i];
    let slope = |i: usize| (points[i + 1] - points[i]) / h(i);
    let mut diagonal = vec![0.0; n];
    let mut second = vec![Vector3::zeros(); n + 1];
    let (first_ratio, last_ratio) = (h(0) / h(1), h(n - 1) / h(n - 2));
    for i in 1..n {
        let mut lower = h(i - 1);
        let mut middle = 2.0 * (h(i - 1) + h(i));
        if i == 1 {
            // second[0] = (1 + r) second[1] - r second[2], r = h0 / h1.
            middle += lower * (1.0 + first_ratio);
            lower = 0.0;
        }
        let mut right = (slope(i) - slope(i - 1)) * 6.0;
        if i == n - 1 {
            middle += h(i) * (1.0 + last_ratio);
            lower -= h(i) * last_ratio;
        }
        if i > 1 {
            let mut upper_above = h(i - 1);
            if i == 2 {
                upper_above -= h(0) * first_ratio;
            }
            let factor = lower / diagonal[i - 1];
            middle -= factor * upper_above;
            let above = second[i - 1];
            right -= above * factor;
        }
        diagonal[i] = middle;
        second[i] = right;
    }
    for i in (1..n).rev() {
        let mut right = second[i];
        if i < n - 1 {
            let upper = if i == 1 {
                h(1) - h(0) * first_ratio
            } else {
                h(i)
            };
            right -= second[i + 1] * upper;
        }
        second[i] = right / diagonal[i];
    }
    second[0] = second[1] * (1.0 + first_ratio) - second[2] * first_ratio;
    second[n] = second[n - 1] * (1.0 + last_ratio) - second[n - 2] * last_ratio;
    second
}

/// Minimiser of sum |z - y|^2 + l^6 sum |third divided difference times 3!|^2, heptadiagonal.
pub(crate) fn smoothed(
    points: &[Vector3<f64>],
    knots: &[f64],
    length_mm: f64,
) -> Vec<Vector3<f64>> {
    let n = points.len();
    // Column j of `bands` holds the entries (i, i + j) of the upper half.
    let mut bands = DMatrix::zeros(n, 4);
    bands.column_mut(0).fill(1.0);
    let weight = length_mm.powi(6);
    for i in 0..n - 3 {
        let coefficient = |j: usize| {
            let others = (0..4).filter(|&m| m != j);
            6.0 / others.map(|m| knots[i + j] - knots[i + m]).product::<f64>()
        };
        let c: [f64; 4] = std::array::from_fn(coefficient);
        for a in 0..4 {
            for b in a..4 {
                bands[(i + a, b - a)] += weight * c[a] * c[b];
            }
        }
    }
    solve_banded(bands, points.to_vec())
}

/// Solves a positive definite system of half bandwidth 3 by U^T D U.
fn solve_banded(mut bands: DMatrix<f64>, mut z: Vec<Vector3<f64>>) -> Vec<Vector3<f64>> {
    let n = z.len();
    for i in 0..n {
        for a in 1..4.min(n - i) {
            let factor = bands[(i, a)] / bands[(i, 0)];
            for b in a..4.min(n - i) {
                let update = factor * bands[(i, b)];
                bands[(i + a, b - a)] -= update;
            }
            let above = z[i];
            z[i + a] -= above * factor;
        }
    }
    for i in (0..n).rev() {
        let mut right = z[i];
        for a in 1..4.min(n - i) {
            right -= z[i + a] * bands[(i, a)];
        }
        z[i] = right / bands[(i, 0)];
    }
    z
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a cubic, unevenly spaced.
    fn cubic(t: f64) -> Vector3<f64> {
        Vector3::new(t, 0.1 * t * t - 0.3 * t, 0.02 * t * t * t)
    }

    #[test]
    fn not_a_knot_second_derivatives_of_a_cubic_are_exact() {
        let knots = [0.0, 0.7, 1.0, 2.2, 3.0, 3.1, 5.0];
        let points: Vec<_> = knots.iter().map(|&t| cubic(t)).collect();
        let second = not_a_knot(&knots, &points);
        for (t, m) in knots.iter().zip(second) {
            // The spline is the cubic itself; only rounding over spacings of 0.1 is left.
            assert!(
                (m - Vector3::new(0.0, 0.2, 0.12 * t)).norm() < 1e-11,
                "{t} {m}"
            );
        }
    }

    #[test]
    fn smoothing_leaves_quadratics_alone_and_removes_ripple() {
        let knots: Vec<f64> = (0..60).map(f64::from).collect();
        let clean: Vec<_> = knots
            .iter()
            .map(|&t| Vector3::new(t, 0.01 * t * t, 0.0))
            .collect();
        let rippled: Vec<_> = clean
            .iter()
            .enumerate()
            .map(|(i, p)| p + Vector3::z() * if i % 2 == 0 { 0.1 } else { -0.1 })
            .collect();
        for (z, p) in smoothed(&clean, &knots, 3.0).iter().zip(&clean) {
            // Condition of the system: l^6 64 = 5e4, times rounding of 36 mm.
            assert!((z - p).norm() < 1e-9);
        }
        for z in &smoothed(&rippled, &knots, 3.0)[25..35] {
            // Third differences see this ripple with a gain of 64 l^6: 2e-5 of it is left in an
            // infinite row, and what the ends leave dies out over some l.
            assert!(z.z.abs() < 1e-4);
        }
    }
}
