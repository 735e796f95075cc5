//! The two linear systems of a smooth curve through points: not-a-knot cubic splines and smoothing.
//!
//! Cubic with not-a-knot ends: C. de Boor, A Practical Guide to Splines, chapter IV. Natural ends would
//! force the curvature to zero there, which no needle does. Smoothing penalises third differences
//! (Whittaker-Henderson), which leaves quadratics and so nearly constant curvature alone; a penalty on
//! second differences would straighten them. Its condition grows as (length / spacing)^6, so long
//! lengths are solved for on a subset of the knots that they resolve, fitted to all points.

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

/// Nodes of a smoothed curve per smoothing length. More would resolve nothing that smoothing leaves,
/// and the condition of the system grows with its sixth power: 64 * 20^6 = 4e9 is harmless.
const NODES_PER_LENGTH: f64 = 20.0;

/// Nodes of the smoothed curve among the knots: all of them, or as many as the smoothing length
/// resolves; the first and the last always.
pub(crate) fn smoothing_nodes(knots: &[f64], length_mm: f64) -> Vec<usize> {
    let spacing_mm = length_mm / NODES_PER_LENGTH;
    let end = knots.len() - 1;
    let mut nodes = vec![0];
    let mut at_mm = knots[0];
    for (k, &knot) in knots.iter().enumerate().take(end).skip(1) {
        // Not closer to the end than half a spacing: the last node is not a choice.
        if knot - at_mm >= spacing_mm && knots[end] - knot >= 0.5 * spacing_mm {
            nodes.push(k);
            at_mm = knot;
        }
    }
    nodes.push(end);
    nodes
}

/// Minimiser z, at the nodes, of sum |y - L z|^2 + l^6 sum n |third divided difference times 3!|^2,
/// heptadiagonal. L interpolates z to every point by the cubic through four nodes, and n is the
/// number of points per node there; with a node at every point both vanish from the formula. Needs
/// four nodes.
pub(crate) fn smoothed(
    points: &[Vector3<f64>],
    knots: &[f64],
    nodes: &[usize],
    length_mm: f64,
) -> Vec<Vector3<f64>> {
    let m = nodes.len();
    let at: Vec<f64> = nodes.iter().map(|&k| knots[k]).collect();
    // Column j of `bands` holds the entries (i, i + j) of the upper half.
    let mut bands = DMatrix::zeros(m, 4);
    let mut add = |first: usize, weight: f64, c: [f64; 4]| {
        for a in 0..4 {
            for b in a..4 {
                bands[(first + a, b - a)] += weight * c[a] * c[b];
            }
        }
    };
    let mut right = vec![Vector3::zeros(); m];
    let mut after = 1;
    for (&knot, point) in knots.iter().zip(points) {
        while after < m - 1 && at[after] < knot {
            after += 1;
        }
        let first = after.saturating_sub(2).min(m - 4);
        let c = lagrange(&at[first..first + 4], knot);
        add(first, 1.0, c);
        for (z, c) in right[first..].iter_mut().zip(c) {
            *z += point * c;
        }
    }
    for i in 0..m - 3 {
        let points_per_node = (nodes[i + 3] - nodes[i]) as f64 / 3.0;
        let c = third_difference(&at[i..i + 4]);
        // l^3 goes into the coefficients: l^6 alone would overflow first.
        let cube = length_mm * length_mm * length_mm;
        add(i, points_per_node, c.map(|x| x * cube));
    }
    solve_banded(bands, right)
}

/// Product over the other nodes of (x - node m) / (node j - node m).
fn lagrange(nodes: &[f64], x: f64) -> [f64; 4] {
    std::array::from_fn(|j| {
        let others = (0..4).filter(|&m| m != j);
        others
            .map(|m| (x - nodes[m]) / (nodes[j] - nodes[m]))
            .product()
    })
}

/// Coefficients of the third divided difference times 3!.
fn third_difference(nodes: &[f64]) -> [f64; 4] {
    std::array::from_fn(|j| {
        let others = (0..4).filter(|&m| m != j);
        6.0 / others.map(|m| nodes[j] - nodes[m]).product::<f64>()
    })
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
        let every = smoothing_nodes(&knots, 3.0);
        assert_eq!(every.len(), 60);
        let clean: Vec<_> = knots
            .iter()
            .map(|&t| Vector3::new(t, 0.01 * t * t, 0.0))
            .collect();
        let rippled: Vec<_> = clean
            .iter()
            .enumerate()
            .map(|(i, p)| p + Vector3::z() * if i % 2 == 0 { 0.1 } else { -0.1 })
            .collect();
        for (z, p) in smoothed(&clean, &knots, &every, 3.0).iter().zip(&clean) {
            // Condition of the system: l^6 64 = 5e4, times rounding of 36 mm.
            assert!((z - p).norm() < 1e-9);
        }
        for z in &smoothed(&rippled, &knots, &every, 3.0)[25..35] {
            // Third differences see this ripple with a gain of 64 l^6: 2e-5 of it is left in an
            // infinite row, and what the ends leave dies out over some l.
            assert!(z.z.abs() < 1e-4);
        }
    }
}
