//! The end of the horizon: cost `1/2 x'P x + p'x`, bounds on `x_N`, and the terminal set.

use crate::error::{Place, ProblemError};
use crate::semidefinite::factor;
use crate::validation::{
    absent_bounds, absent_limit, bounds, finite, finite_row, symmetric, symmetrise, upper_limit,
};
use nalgebra::{SMatrix, SVector};

/// One face of a polytope, `normal'x <= upper`; `upper = +inf`, or 1e20 and beyond, switches it off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace<const NX: usize> {
    /// Outer normal, of any length.
    pub normal: SVector<f64, NX>,
    /// Right-hand side.
    pub upper: f64,
}

/// The set that `x_N` must reach.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum TerminalSet<const NX: usize> {
    /// The whole space.
    #[default]
    None,
    /// The single point `target`.
    Equality {
        /// The point.
        target: SVector<f64, NX>,
    },
    /// An intersection of half-spaces.
    Polytope {
        /// The faces.
        faces: Vec<HalfSpace<NX>>,
    },
    /// `(x - center)' shape (x - center) <= level`, a second-order cone of dimension NX + 1.
    Ellipsoid {
        /// Symmetric positive semidefinite matrix.
        shape: SMatrix<f64, NX, NX>,
        /// Center.
        center: SVector<f64, NX>,
        /// Positive level.
        level: f64,
    },
}

impl<const NX: usize> TerminalSet<NX> {
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Equality { .. } => "equality",
            Self::Polytope { .. } => "polytope",
            Self::Ellipsoid { .. } => "ellipsoid",
        }
    }
}

/// Data at `x_N`.
#[derive(Debug, Clone, PartialEq)]
pub struct Terminal<const NX: usize> {
    /// Terminal weight P, symmetric, in `1/2 x'P x`.
    pub p: SMatrix<f64, NX, NX>,
    /// Linear terminal cost p.
    pub p_linear: SVector<f64, NX>,
    /// Lower bound of `x_N`, infinite (or -1e20 and beyond) where absent.
    pub x_min: SVector<f64, NX>,
    /// Upper bound of `x_N`, infinite (or 1e20 and beyond) where absent.
    pub x_max: SVector<f64, NX>,
    /// Terminal set.
    pub set: TerminalSet<NX>,
}

impl<const NX: usize> Terminal<NX> {
    /// Terminal weight `p`, no linear term, no constraint: `x_N` is free even where the stages bound their states.
    #[must_use]
    pub fn new(p: SMatrix<f64, NX, NX>) -> Self {
        Self {
            p,
            p_linear: SVector::zeros(),
            x_min: SVector::repeat(f64::NEG_INFINITY),
            x_max: SVector::repeat(f64::INFINITY),
            set: TerminalSet::None,
        }
    }

    /// The terminal cost at a point.
    #[must_use]
    pub fn cost(&self, x: &SVector<f64, NX>) -> f64 {
        0.5 * x.dot(&(self.p * x)) + self.p_linear.dot(x)
    }

    /// Checks everything; the result is the ellipsoid's factor L with `shape = L L'`, zero for the other sets.
    pub(crate) fn validate(&self) -> Result<SMatrix<f64, NX, NX>, ProblemError> {
        let place = Place::Terminal;
        factor(place, "p", &symmetric(place, "p", &self.p)?)?;
        finite(place, "p_linear", &self.p_linear)?;
        bounds(place, ["x", "x_min", "x_max"], &self.x_min, &self.x_max)?;
        match &self.set {
            TerminalSet::None => {}
            TerminalSet::Equality { target } => finite(place, "target", target)?,
            TerminalSet::Polytope { faces } => {
                for (index, face) in faces.iter().enumerate() {
                    finite_row(place, "faces.normal", index, &face.normal)?;
                    upper_limit(place, "faces.upper", index, face.upper)?;
                }
            }
            TerminalSet::Ellipsoid {
                shape,
                center,
                level,
            } => {
                let shape = symmetric(place, "shape", shape)?;
                finite(place, "center", center)?;
                if !(*level > 0.0 && level.is_finite()) {
                    return Err(ProblemError::EllipsoidLevel { found: *level });
                }
                return factor(place, "shape", &shape);
            }
        }
        Ok(SMatrix::zeros())
    }

    /// Checks that a refill has this structure.
    pub(crate) fn same_structure(&self, refill: &Self) -> Result<(), ProblemError> {
        if self.set.kind() != refill.set.kind() {
            return Err(ProblemError::TerminalSetKind {
                expected: self.set.kind(),
                found: refill.set.kind(),
            });
        }
        if let (TerminalSet::Polytope { faces }, TerminalSet::Polytope { faces: found }) =
            (&self.set, &refill.set)
            && faces.len() != found.len()
        {
            return Err(ProblemError::RowCount {
                place: Place::Terminal,
                expected: faces.len(),
                found: found.len(),
            });
        }
        Ok(())
    }

    /// Makes the bounds infinite that are written as large numbers, and matrices symmetric to the last digit.
    pub(crate) fn normalise(&mut self) {
        symmetrise(&mut self.p);
        absent_bounds(&mut self.x_min, &mut self.x_max);
        match &mut self.set {
            TerminalSet::Polytope { faces } => {
                (faces.iter_mut()).for_each(|face| absent_limit(&mut face.upper));
            }
            TerminalSet::Ellipsoid { shape, .. } => symmetrise(shape),
            TerminalSet::None | TerminalSet::Equality { .. } => {}
        }
    }

    /// Overwrites every value without allocating; the structures must agree.
    pub(crate) fn overwrite(&mut self, source: &Self) {
        self.p = source.p;
        self.p_linear = source.p_linear;
        self.x_min = source.x_min;
        self.x_max = source.x_max;
        match (&mut self.set, &source.set) {
            (TerminalSet::Polytope { faces }, TerminalSet::Polytope { faces: new }) => {
                faces.copy_from_slice(new);
            }
            (set, new) => set.clone_from(new),
        }
        self.normalise();
    }
}
