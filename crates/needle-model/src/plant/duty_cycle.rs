//! Duty-cycled rotation, averaged: a needle that spins during a fraction d of the insertion follows,
//! on average, an arc of curvature kappa (1 - d).
//!
//! Source: D. Minhas, J. Engh, M. Fenske, C. Riviere, "Modeling of needle steering via duty-cycled
//! spinning", EMBC 2007. The average holds when a cycle's insertion length is short against
//! 1 / kappa; the ripple of a cycle is left out.

use thiserror::Error;

use crate::plant::needle::Needle;

/// Fraction of the insertion during which the needle spins, in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DutyCycle {
    fraction: f64,
}

/// Why no duty cycle exists.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum DutyCycleError {
    /// The fraction is outside [0, 1].
    #[error("duty cycle must lie in [0, 1], found {fraction}")]
    Fraction {
        /// Fraction found.
        fraction: f64,
    },
    /// The wanted curvature is negative, not finite, or exceeds the needle's.
    #[error(
        "curvature {wanted_per_mm} per mm cannot be had from a needle of {needle_per_mm} per mm"
    )]
    Curvature {
        /// Curvature wanted, 1/mm.
        wanted_per_mm: f64,
        /// Curvature of the needle, 1/mm.
        needle_per_mm: f64,
    },
}

/// Excess over the needle's curvature, as a fraction of it, that is rounding: the arc that a needle
/// made is an arc that it can make.
const CURVATURE_TOLERANCE: f64 = 1e-9;

impl DutyCycle {
    /// Spinning during `fraction` of the insertion.
    ///
    /// # Errors
    /// [`DutyCycleError::Fraction`] outside [0, 1] or NaN.
    pub fn new(fraction: f64) -> Result<Self, DutyCycleError> {
        if (0.0..=1.0).contains(&fraction) {
            Ok(Self { fraction })
        } else {
            Err(DutyCycleError::Fraction { fraction })
        }
    }

    /// The duty cycle that turns `needle` into one of curvature `wanted_per_mm`: d = 1 - k / kappa.
    ///
    /// # Errors
    /// [`DutyCycleError::Curvature`] when the needle does not bend enough, by more than
    /// rounding (1e-9 of its curvature).
    pub fn for_curvature(needle: Needle, wanted_per_mm: f64) -> Result<Self, DutyCycleError> {
        let needle_per_mm = needle.curvature_per_mm();
        let limit_per_mm = (needle_per_mm * (1.0 + CURVATURE_TOLERANCE)).min(f64::MAX);
        if !(0.0..=limit_per_mm).contains(&wanted_per_mm) {
            return Err(DutyCycleError::Curvature {
                wanted_per_mm,
                needle_per_mm,
            });
        }
        let fraction = if needle_per_mm > 0.0 {
            (1.0 - wanted_per_mm / needle_per_mm).max(0.0)
        } else {
            0.0
        };
        Ok(Self { fraction })
    }

    /// Fraction of the insertion during which the needle spins.
    #[must_use]
    pub fn fraction(&self) -> f64 {
        self.fraction
    }

    /// The needle that moves like `needle` under this duty cycle, on average.
    #[must_use]
    pub fn averaged(&self, needle: Needle) -> Needle {
        // A product of numbers in range is in range.
        Needle::new(needle.curvature_per_mm() * (1.0 - self.fraction)).unwrap_or(needle)
    }
}
