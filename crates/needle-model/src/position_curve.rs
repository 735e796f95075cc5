//! A smooth curve through given positions, by arc length: position, tangent and curvature vector.
//!
//! A cubic spline by chord length with not-a-knot ends (C. de Boor, A Practical Guide to Splines,
//! chapter IV): natural ends would force the curvature to zero there, which no needle does. Positions
//! with measurement noise can be smoothed first by penalised third differences (Whittaker-Henderson),
//! which leaves constant curvature alone, as a penalty on second differences would not.

use nalgebra::{DMatrix, Vector3};
use thiserror::Error;

/// Fewest positions of a cubic with not-a-knot ends.
pub const MIN_POSITIONS: usize = 4;

/// Nodes and weights of Gauss-Legendre quadrature on [0, 1], five points: arc length of a cubic to
/// rounding at the spacings of interest.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668_02, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_24),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

/// Why positions make no curve.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PositionCurveError {
    /// Too few positions.
    #[error("a curve needs at least {MIN_POSITIONS} positions, found {found}")]
    TooFew {
        /// Number of positions.
        found: usize,
    },
    /// A position is NaN or infinite.
    #[error("position {index} is not finite")]
    NonFinite {
        /// Index of the position.
        index: usize,
    },
    /// Two successive positions coincide.
    #[error("position {index} coincides with the one before")]
    Coincident {
        /// Index of the second of the two.
        index: usize,
    },
    /// The smoothing length is negative or not finite.
    #[error("smoothing length must be finite and not negative, found {smoothing_mm} mm")]
    Smoothing {
        /// Smoothing length found, mm.
        smoothing_mm: f64,
    },
}

/// A point of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Position, mm.
    pub position_mm: Vector3<f64>,
    /// Unit tangent.
    pub tangent: Vector3<f64>,
    /// Derivative of the tangent by arc length, 1/mm: toward the centre of curvature.
    pub curvature_per_mm: Vector3<f64>,
}

/// A cubic spline in space with its arc length.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionCurve {
    /// Parameter (chord length) at the knots, mm.
    knots_mm: Vec<f64>,
    points_mm: Vec<Vector3<f64>>,
    /// Second derivatives by the parameter at the knots.
    second: Vec<Vector3<f64>>,
    /// Arc length at the knots, mm.
    arc_length_mm: Vec<f64>,
}

impl PositionCurve {
    /// Curve through the positions; with `smoothing_mm` = l > 0, through positions smoothed so that
    /// a ripple of wavelength w keeps the part 1 / (1 + (2 pi l / w)^6).
    ///
    /// # Errors
    /// [`PositionCurveError`] when there are too few positions, or one is unusable.
    pub fn through(
        positions_mm: &[Vector3<f64>],
        smoothing_mm: f64,
    ) -> Result<Self, PositionCurveError> {
        if positions_mm.len() < MIN_POSITIONS {
            return Err(PositionCurveError::TooFew {
                found: positions_mm.len(),
            });
        }
        if !(smoothing_mm.is_finite() && smoothing_mm >= 0.0) {
            return Err(PositionCurveError::Smoothing { smoothing_mm });
        }
        let knots_mm = chord_lengths(positions_mm)?;
        if smoothing_mm > 0.0 {
            let smooth = smoothed(positions_mm, &knots_mm, smoothing_mm);
            let knots_mm = chord_lengths(&smooth)?;
            Ok(Self::interpolating(knots_mm, smooth))
        } else {
            Ok(Self::interpolating(knots_mm, positions_mm.to_vec()))
        }
    }

    fn interpolating(knots_mm: Vec<f64>, points_mm: Vec<Vector3<f64>>) -> Self {
        let second = not_a_knot(&knots_mm, &points_mm);
        let mut curve = Self {
            arc_length_mm: vec![0.0],
            knots_mm,
            points_mm,
            second,
        };
        let mut s_mm = 0.0;
        for segment in 0..curve.knots_mm.len() - 1 {
            s_mm += curve.segment_length(segment, 1.0);
            curve.arc_length_mm.push(s_mm);
        }
        curve
    }

    /// Length of the curve, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.arc_length_mm.last().copied().unwrap_or(0.0)
    }

    /// Point at an arc length, clamped to the curve.
    #[must_use]
    pub fn at(&self, arc_length_mm: f64) -> CurvePoint {
        let last = self.knots_mm.len() - 2;
        let after = self.arc_length_mm.partition_point(|&s| s <= arc_length_mm);
        let segment = after.saturating_sub(1).min(last);
        let start_mm = self.arc_length_mm[segment];
        let wanted = (arc_length_mm - start_mm).max(0.0);
        let whole = self.arc_length_mm[segment + 1] - start_mm;
        let mut t = (wanted / whole).min(1.0);
        // Chord length is nearly arc length: Newton gains all digits in three or four steps.
        for _ in 0..6 {
            let speed = self.derivatives(segment, t).1.norm() * self.width(segment);
            let excess = self.segment_length(segment, t) - wanted;
            let next = (t - excess / speed).clamp(0.0, 1.0);
            if !next.is_finite() || (next - t).abs() < 1e-15 {
                break;
            }
            t = next;
        }
        let (position_mm, first, second) = self.derivatives(segment, t);
        let speed = first.norm();
        let tangent = first / speed;
        CurvePoint {
            position_mm,
            tangent,
            curvature_per_mm: (second - tangent * second.dot(&tangent)) / (speed * speed),
        }
    }

    fn width(&self, segment: usize) -> f64 {
        self.knots_mm[segment + 1] - self.knots_mm[segment]
    }

    /// Arc length of a segment from its start to the fraction `t` of its parameter.
    fn segment_length(&self, segment: usize, t: f64) -> f64 {
        let speed = |x: f64| self.derivatives(segment, x * t).1.norm();
        GAUSS.iter().map(|&(x, w)| w * speed(x)).sum::<f64>() * t * self.width(segment)
    }

    /// Value, first and second derivative by the parameter, at the fraction `t` of a segment.
    fn derivatives(&self, segment: usize, t: f64) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let h = self.width(segment);
        let (p0, p1) = (self.points_mm[segment], self.points_mm[segment + 1]);
        let (m0, m1) = (self.second[segment], self.second[segment + 1]);
        let (a, b) = (1.0 - t, t);
        let value = p0 * a + p1 * b + (m0 * (a * a * a - a) + m1 * (b * b * b - b)) * (h * h / 6.0);
        let first =
            (p1 - p0) / h + (m1 * (3.0 * b * b - 1.0) - m0 * (3.0 * a * a - 1.0)) * (h / 6.0);
        (value, first, m0 * a + m1 * b)
    }
}

fn chord_lengths(points: &[Vector3<f64>]) -> Result<Vec<f64>, PositionCurveError> {
    let mut knots = Vec::with_capacity(points.len());
    let mut length = 0.0;
    for (index, point) in points.iter().enumerate() {
        if !point.iter().all(|x| x.is_finite()) {
            return Err(PositionCurveError::NonFinite { index });
        }
        if index > 0 {
            let chord = (point - points[index - 1]).norm();
            if length + chord <= length {
                return Err(PositionCurveError::Coincident { index });
            }
            length += chord;
        }
        knots.push(length);
    }
    Ok(knots)
}

/// Second derivatives at the knots: continuity of the first derivative inside, one cubic across the
/// first and the last two segments. Elimination of the ends leaves a tridiagonal system.
fn not_a_knot(knots: &[f64], points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
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
fn smoothed(points: &[Vector3<f64>], knots: &[f64], length_mm: f64) -> Vec<Vector3<f64>> {
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
