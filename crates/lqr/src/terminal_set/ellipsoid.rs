//! Ellipsoidal terminal sets { x : x'Px <= c } and their largest admissible level.
//!
//! The maximum of f x over the set is sqrt(c f P^-1 f'), so all rows f x <= h hold iff c <= min h^2 / (f P^-1 f'). With V = x'Px
//! falling along the law the set is then invariant and admissible. For a chain, X_f(k) maps into X_f(k+1) if
//! V(k+1, x+) <= V(k, x) and c_k <= c_{k+1}: c_T is the largest admissible level, c_k = min(largest admissible, c_{k+1}).

use crate::arithmetic::dense::{cholesky, cholesky_solve, forward_substitute};
use crate::input::{self, InputError};
use crate::terminal_set::constraints::{ConstraintKind, LawRow};
use faer::{Mat, MatRef};

/// Why a set could not be sized.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TerminalSetError {
    /// Wrong shapes, NaN, infinities.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A level set of this P is not bounded, or empty.
    #[error("the shape matrix is not positive definite")]
    NotPositiveDefinite,
    /// A set with an interior was asked for where a constraint that acts on the state has no room.
    #[error("constraint {name} leaves no interior: bound {bound}")]
    NoInterior {
        /// Name of the constraint.
        name: String,
        /// Its bound.
        bound: f64,
    },
    /// The closed loop is not stable: no set around the origin is invariant.
    #[error("the closed loop has spectral radius {spectral_radius}, not below one")]
    Unstable {
        /// Its spectral radius, or NaN where it could not be computed.
        spectral_radius: f64,
    },
    /// The barrier iteration stopped before its gap was closed.
    #[error(
        "the largest-volume ellipsoid was not reached: decrement {decrement:e} after {steps} Newton steps"
    )]
    NoConvergence {
        /// Newton steps taken.
        steps: usize,
        /// Last Newton decrement.
        decrement: f64,
    },
}

/// What decided a level.
#[derive(Debug, Clone, PartialEq)]
pub enum LevelReason {
    /// This constraint touches the set.
    Active {
        /// Its name.
        name: String,
        /// Its kind.
        kind: ConstraintKind,
    },
    /// This constraint has a limit of zero and acts on the set: only the origin is left.
    ZeroLimit {
        /// Its name.
        name: String,
        /// Its kind.
        kind: ConstraintKind,
    },
    /// The next set of the chain: this stage's own constraints allow more.
    NextStage {
        /// Index of the stage whose level is inherited.
        stage: usize,
    },
    /// No constraint acts on the state: any level is admissible.
    Unconstrained,
}

/// The set { x : x'Px <= c }.
#[derive(Debug, Clone)]
pub struct Ellipsoid {
    /// Shape, n x n, symmetric positive definite.
    pub p: Mat<f64>,
    /// Level c >= 0; infinite where nothing constrains it.
    pub level: f64,
    /// What decided the level.
    pub reason: LevelReason,
    factor: Mat<f64>,
}

impl Ellipsoid {
    /// The largest level set of x'Px inside all rows.
    ///
    /// # Errors
    /// [`TerminalSetError`] for a P that is not positive definite or rows of another length.
    pub fn largest(p: MatRef<'_, f64>, rows: &[LawRow]) -> Result<Self, TerminalSetError> {
        let mut set = Self::with_level(p, f64::INFINITY)?;
        for row in rows {
            let reach = set.inverse_form(&row.row)?;
            // A constraint that does not act on the state is no constraint; its limit may be zero.
            if reach == 0.0 {
                continue;
            }
            // Squared last: the square of a bound may overflow where the level does not.
            let level = (input::finite_not_negative("bound", row.bound)? / reach.sqrt()).powi(2);
            if level < set.level {
                let (name, kind) = (row.name.clone(), row.kind);
                set.level = level;
                set.reason = if row.bound == 0.0 {
                    LevelReason::ZeroLimit { name, kind }
                } else {
                    LevelReason::Active { name, kind }
                };
            }
        }
        Ok(set)
    }

    /// The set of a given level.
    ///
    /// # Errors
    /// [`TerminalSetError`] for a P that is not positive definite.
    pub fn with_level(p: MatRef<'_, f64>, level: f64) -> Result<Self, TerminalSetError> {
        if p.nrows() == 0 {
            return Err(InputError::Empty { name: "P" }.into());
        }
        let p = input::symmetric("P", p, p.nrows())?;
        input::not_negative("level", level)?;
        let factor = cholesky(&p).ok_or(TerminalSetError::NotPositiveDefinite)?;
        Ok(Self {
            p,
            level,
            reason: LevelReason::Unconstrained,
            factor,
        })
    }

    /// f P^-1 f'.
    fn inverse_form(&self, row: &[f64]) -> Result<f64, InputError> {
        let n = self.p.nrows();
        let mut f = input::matrix(
            "row",
            MatRef::from_column_major_slice(row, row.len(), 1),
            (n, 1),
        )?;
        forward_substitute(&self.factor, &mut f);
        Ok((0..n).map(|i| f[(i, 0)] * f[(i, 0)]).sum())
    }

    /// x'Px for x of length n.
    ///
    /// # Errors
    /// [`InputError`] for another length or non-finite entries.
    pub fn value(&self, x: &[f64]) -> Result<f64, InputError> {
        let n = self.p.nrows();
        let x = input::matrix("x", MatRef::from_column_major_slice(x, x.len(), 1), (n, 1))?;
        // |L'x|^2 cannot be negative by cancellation.
        Ok((0..n)
            .map(|j| {
                (j..n)
                    .map(|i| self.factor[(i, j)] * x[(i, 0)])
                    .sum::<f64>()
                    .powi(2)
            })
            .sum())
    }

    /// The largest f x over the set, sqrt(c f P^-1 f').
    ///
    /// # Errors
    /// [`InputError`] for another length or non-finite entries.
    pub fn support(&self, row: &[f64]) -> Result<f64, InputError> {
        let reach = self.inverse_form(row)?;
        // Also of an unbounded set.
        Ok(if reach == 0.0 {
            0.0
        } else {
            (self.level * reach).sqrt()
        })
    }

    /// The point of the set where f x is largest; the origin for f = 0.
    ///
    /// # Errors
    /// [`InputError`] for another length, non-finite entries, or an infinite level with f not zero.
    pub fn extreme_point(&self, row: &[f64]) -> Result<Vec<f64>, InputError> {
        let reach = self.inverse_form(row)?;
        let n = row.len();
        if reach == 0.0 {
            return Ok(vec![0.0; n]);
        }
        let f = MatRef::from_column_major_slice(row, n, 1).to_owned();
        let x = cholesky_solve(&self.factor, f);
        let scale = (input::finite_not_negative("level", self.level)? / reach).sqrt();
        Ok((0..n).map(|i| x[(i, 0)] * scale).collect())
    }

    /// log of the volume without the factor of the unit ball: n/2 log c - 1/2 log det P.
    #[must_use]
    pub fn log_volume(&self) -> f64 {
        let n = self.p.nrows();
        0.5 * n as f64 * self.level.ln() - (0..n).map(|i| self.factor[(i, i)].ln()).sum::<f64>()
    }
}

/// Nested levels for a chain: `shapes[k]` with the rows of stage k, k = 0..=T.
///
/// c_T is the largest admissible level of the last stage, c_k = min(own largest admissible, c_{k+1}).
///
/// # Errors
/// [`TerminalSetError`]; the lists must have the same length.
pub fn chain_levels(
    shapes: &[Mat<f64>],
    rows: &[Vec<LawRow>],
) -> Result<Vec<Ellipsoid>, TerminalSetError> {
    if shapes.len() != rows.len() {
        return Err(InputError::Shape {
            name: "rows",
            expected: (shapes.len(), 1),
            found: (rows.len(), 1),
        }
        .into());
    }
    let mut sets: Vec<Ellipsoid> = Vec::with_capacity(shapes.len());
    for (stage, (p, rows)) in shapes.iter().zip(rows).enumerate().rev() {
        let mut set = Ellipsoid::largest(p.as_ref(), rows)?;
        if let Some(next) = sets.last().filter(|next| next.level < set.level) {
            set.level = next.level;
            set.reason = LevelReason::NextStage { stage: stage + 1 };
        }
        sets.push(set);
    }
    sets.reverse();
    Ok(sets)
}
