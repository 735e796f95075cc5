//! Curvature that varies along the inserted length: layers of tissue of different stiffness give
//! the same bevel different curvatures. Context: K. Reed et al., "Robot-assisted needle steering", IEEE
//! Robotics and Automation Magazine 18, 2011. No values of tissues are given here.

use thiserror::Error;

use crate::needle::{InvalidCurvature, Needle};

/// Curvature as a function of arc length: linear between knots, constant beyond the first and last.
#[derive(Debug, Clone, PartialEq)]
pub struct CurvatureProfile {
    /// (arc length mm, needle), arc lengths strictly increasing; never empty.
    knots: Vec<(f64, Needle)>,
}

/// A table that is no curvature profile.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CurvatureProfileError {
    /// No knot at all.
    #[error("a curvature profile needs at least one knot")]
    Empty,
    /// A knot's arc length is not finite or does not exceed the one before.
    #[error(
        "arc length of knot {knot} must be finite and exceed the one before, found {arc_length_mm} mm"
    )]
    ArcLength {
        /// Index of the knot.
        knot: usize,
        /// Arc length found, mm.
        arc_length_mm: f64,
    },
    /// A knot's curvature is invalid.
    #[error("knot {knot}: {source}")]
    Curvature {
        /// Index of the knot.
        knot: usize,
        /// What is wrong with it.
        source: InvalidCurvature,
    },
}

impl CurvatureProfile {
    /// Profile through knots (arc length mm, curvature 1/mm). One knot is a constant.
    ///
    /// # Errors
    /// [`CurvatureProfileError`] naming the knot.
    pub fn new(knots: &[(f64, f64)]) -> Result<Self, CurvatureProfileError> {
        if knots.is_empty() {
            return Err(CurvatureProfileError::Empty);
        }
        let mut valid: Vec<(f64, Needle)> = Vec::with_capacity(knots.len());
        for (knot, &(arc_length_mm, curvature_per_mm)) in knots.iter().enumerate() {
            let increases = valid.last().is_none_or(|&(last, _)| arc_length_mm > last);
            if !(arc_length_mm.is_finite() && increases) {
                return Err(CurvatureProfileError::ArcLength {
                    knot,
                    arc_length_mm,
                });
            }
            let needle = Needle::new(curvature_per_mm)
                .map_err(|source| CurvatureProfileError::Curvature { knot, source })?;
            valid.push((arc_length_mm, needle));
        }
        Ok(Self { knots: valid })
    }

    /// The same curvature everywhere.
    #[must_use]
    pub fn constant(needle: Needle) -> Self {
        Self {
            knots: vec![(0.0, needle)],
        }
    }

    /// The needle as it is at arc length `arc_length_mm`.
    #[must_use]
    pub fn at(&self, arc_length_mm: f64) -> Needle {
        let after = self.knots.partition_point(|&(s, _)| s <= arc_length_mm);
        if after == 0 || after == self.knots.len() {
            return self.knots[after.saturating_sub(1)].1;
        }
        let ((s0, low), (s1, high)) = (self.knots[after - 1], self.knots[after]);
        let t = (arc_length_mm - s0) / (s1 - s0);
        let (k0, k1) = (low.curvature_per_mm(), high.curvature_per_mm());
        // A convex combination of two valid curvatures is valid.
        Needle::new(k0 + t * (k1 - k0)).unwrap_or(low)
    }
}
