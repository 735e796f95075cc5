//! Where a curve bends more than a needle can, and by how much.

use crate::plant::needle::Needle;
use crate::positions::position_curve::PositionCurve;

/// Number of equal stretches that are sampled.
const SAMPLES: usize = 2000;

/// A stretch of a curve whose curvature exceeds the needle's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvatureExcess {
    /// Arc length where it begins, mm.
    pub start_mm: f64,
    /// Arc length where it ends, mm.
    pub end_mm: f64,
    /// Arc length of the largest curvature, mm.
    pub worst_mm: f64,
    /// Largest curvature, 1/mm.
    pub curvature_per_mm: f64,
    /// How much that is above the needle's, 1/mm.
    pub excess_per_mm: f64,
}

impl PositionCurve {
    /// Stretches whose curvature exceeds the needle's by more than the fraction `margin` of it, from
    /// 2000 equally spaced samples; empty when the needle can follow everywhere.
    #[must_use]
    pub fn curvature_excesses(&self, needle: Needle, margin: f64) -> Vec<CurvatureExcess> {
        let limit = needle.curvature_per_mm() * (1.0 + margin.max(0.0));
        let mut stretches: Vec<CurvatureExcess> = Vec::new();
        let mut open = false;
        for i in 0..=SAMPLES {
            let s_mm = self.length_mm() * i as f64 / SAMPLES as f64;
            let curvature_per_mm = self.at(s_mm).curvature_per_mm.norm();
            // A straight line bends by rounding only, whatever its direction.
            let exceeds = curvature_per_mm > limit + self.curvature_rounding_per_mm(s_mm);
            if exceeds && !open {
                stretches.push(CurvatureExcess {
                    start_mm: s_mm,
                    end_mm: s_mm,
                    worst_mm: s_mm,
                    curvature_per_mm,
                    excess_per_mm: 0.0,
                });
            }
            open = exceeds;
            if let (true, Some(stretch)) = (exceeds, stretches.last_mut()) {
                stretch.end_mm = s_mm;
                if curvature_per_mm >= stretch.curvature_per_mm {
                    stretch.worst_mm = s_mm;
                    stretch.curvature_per_mm = curvature_per_mm;
                }
                stretch.excess_per_mm = stretch.curvature_per_mm - needle.curvature_per_mm();
            }
        }
        stretches
    }
}
