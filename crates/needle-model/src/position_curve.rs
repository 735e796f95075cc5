//! A smooth curve through given positions, by arc length: position, tangent and curvature vector.
//!
//! A cubic spline by chord length, after optional smoothing; the linear systems are in
//! `spline.rs`.

use nalgebra::Vector3;
use thiserror::Error;

use crate::spline::{not_a_knot, smoothed};

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

/// Curvature below which a curve has no direction of bending, 1/mm.
const STRAIGHT_PER_MM: f64 = 1e-9;

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

    /// Torsion at an arc length, 1/mm: how fast the direction of bending turns about the tangent. A
    /// needle of the curve's curvature has to turn at omega = torsion v. By central differences of the
    /// curvature over the mean knot spacing, second order; `None` where the curve bends
    /// by less than 1e-9 per mm and the direction is rounding.
    #[must_use]
    pub fn torsion_per_mm(&self, arc_length_mm: f64) -> Option<f64> {
        let spacing_mm = self.length_mm() / (self.knots_mm.len() - 1) as f64;
        let middle_mm = arc_length_mm
            .max(spacing_mm)
            .min(self.length_mm() - spacing_mm);
        let here = self.at(middle_mm);
        let k = here.curvature_per_mm;
        let change = self.at(middle_mm + spacing_mm).curvature_per_mm
            - self.at(middle_mm - spacing_mm).curvature_per_mm;
        let torsion = here.tangent.dot(&k.cross(&change)) / (2.0 * spacing_mm * k.norm_squared());
        (k.norm() > STRAIGHT_PER_MM && torsion.is_finite()).then_some(torsion)
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
