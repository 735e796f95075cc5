//! The discrete algebraic Riccati equation P = Q + A'PA - (A'PB + S)(R + B'PB)^-1(B'PA + S').
//!
//! Doubling finds a candidate, Newton steps on the Joseph residual polish it, and a candidate is
//! returned only if the closed loop A + BK is stable and the residual small: that makes it *the* stabilising solution,
//! which is unique. Stabilisability needs no test beforehand: a stable closed loop bounds the Hautus measure
//! from below (`proved_measure`). The explicit test runs where that bound is too weak, or where no
//! candidate was good, to name the mode that is to blame.

use crate::dense::{cholesky, cholesky_solve, identity, norm_one};
use crate::fixed_size::{by_states, inverse_norm_one};
use crate::hautus::{self, Stabilisability, UncontrollableMode, UnobservableMode};
use crate::input::{self, InputError};
use crate::proved_measure::{WEAK, proved_measure};
use crate::riccati::{Balanced, Problem, indefinite};
use crate::routes::{ACCEPTED_RESIDUAL, Attempt, Route};
use crate::spectrum::SpectrumError;
use faer::{Mat, MatRef};

/// Why there is no answer. A `Dare` never returns a P that is not the stabilising solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DareError {
    /// Shapes, NaN, infinities, asymmetry.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A weight is indefinite beyond rounding.
    #[error(
        "{name} is not positive semidefinite: least eigenvalue {eigenvalue:e}, tolerance {tolerance:e}"
    )]
    IndefiniteWeight {
        /// Q, R or [Q S; S' R].
        name: &'static str,
        /// Its least eigenvalue.
        eigenvalue: f64,
        /// Distance below zero that counts as rounding.
        tolerance: f64,
    },
    /// A mode on or outside the unit circle that no input reaches: no gain stabilises the pair.
    #[error("not stabilisable: no input reaches {mode}")]
    NotStabilisable {
        /// The mode.
        mode: UncontrollableMode,
    },
    /// The data are conditioned so badly that their rounding decides whether a mode is reached.
    #[error("too ill conditioned: rounding decides whether an input reaches {mode}")]
    Undecided {
        /// The mode.
        mode: UncontrollableMode,
    },
    /// A mode on the unit circle without weight: the optimal law leaves it there.
    #[error("no stabilising solution: the weight does not see {mode} on the unit circle")]
    UnobservableOnCircle {
        /// The mode.
        mode: UnobservableMode,
    },
    /// R + B'PB is singular: the optimal input is not unique.
    #[error(
        "R + B'PB is singular to working precision: an input has neither a weight nor an effect that costs"
    )]
    SingularInputHessian,
    /// Entries so large or small that powers of the matrices overflow.
    #[error("the eigenvalues of A could not be computed")]
    Spectrum(#[source] SpectrumError),
    /// No route reached a stabilising solution with a small residual, though the tests find no mode to blame.
    #[error(
        "no stabilising solution reached: relative residual {relative_residual:e}, spectral radius {spectral_radius}"
    )]
    NoConvergence {
        /// Of the best candidate; infinite where there was none.
        relative_residual: f64,
        /// Of the best candidate's closed loop; infinite where there was none.
        spectral_radius: f64,
    },
}

/// What is nearly lost in an otherwise good solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum NearLoss {
    /// The closed loop's spectral radius is above 0.999.
    SlowClosedLoop,
    /// A mode that needs an input has a Hautus measure below 1e-6.
    WeakInput,
    /// The condition number of P is above 1e7, infinite included.
    IllConditionedP,
    /// The residual could not be brought below 1e-11.
    Residual,
}

/// The warning of a solution that is valid and fragile.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditioning {
    /// What is nearly lost, at least one.
    pub losses: Vec<NearLoss>,
    /// The weakest mode on or outside the unit circle (balanced coordinates), where there is one.
    pub weakest_mode: Option<UncontrollableMode>,
}

/// The stabilising solution.
#[derive(Debug, Clone)]
pub struct DareSolution {
    /// Cost-to-go V(x) = x'Px, n x n, symmetric.
    pub p: Mat<f64>,
    /// Gain of u = Kx, m x n.
    pub k: Mat<f64>,
    /// Spectral radius of A + BK, below one.
    pub spectral_radius: f64,
    /// |right side - P| / max(|P|, |Q|), Frobenius norms, Joseph form.
    pub relative_residual: f64,
    /// Condition number of P in the one-norm; infinite for a singular P.
    pub condition: f64,
    /// Doubling and Newton steps together.
    pub iterations: usize,
    /// Present where something is nearly lost.
    pub warning: Option<Conditioning>,
}

/// A discrete algebraic Riccati equation, ready to be solved.
#[derive(Debug, Clone)]
pub struct Dare<'a> {
    a: MatRef<'a, f64>,
    b: MatRef<'a, f64>,
    q: MatRef<'a, f64>,
    r: MatRef<'a, f64>,
    s: Option<MatRef<'a, f64>>,
}

impl<'a> Dare<'a> {
    /// x+ = Ax + Bu with stage cost x'Qx + u'Ru: A n x n, B n x m, Q n x n, R m x m.
    #[must_use]
    pub fn new(
        a: MatRef<'a, f64>,
        b: MatRef<'a, f64>,
        q: MatRef<'a, f64>,
        r: MatRef<'a, f64>,
    ) -> Self {
        Self {
            a,
            b,
            q,
            r,
            s: None,
        }
    }

    /// Adds 2x'Su to the stage cost, S n x m.
    #[must_use]
    pub fn with_cross(mut self, s: MatRef<'a, f64>) -> Self {
        self.s = Some(s);
        self
    }

    /// The stabilising solution.
    ///
    /// # Errors
    /// See [`DareError`]; each names what is wrong with the data.
    pub fn solve(&self) -> Result<DareSolution, DareError> {
        let problem = self.validated()?;
        let balanced = Balanced::of(&problem);
        let mut best: Option<Attempt> = None;
        for route in [Route::Doubling, Route::ShiftedDoubling, Route::Regularised] {
            for attempt in route.attempts(&balanced.problem) {
                if attempt.is_stabilising() {
                    return accept(&problem, &balanced, attempt);
                }
                if best
                    .as_ref()
                    .is_none_or(|best| attempt.is_better_than(best))
                {
                    best = Some(attempt);
                }
            }
        }
        Err(diagnose(&balanced, best.as_ref()))
    }

    /// The data with shapes, finiteness and symmetry checked.
    pub(crate) fn problem(&self) -> Result<Problem, InputError> {
        let (a, b) = input::pair(self.a, self.b)?;
        let (n, m) = (b.nrows(), b.ncols());
        let q = input::symmetric("Q", self.q, n)?;
        let r = input::symmetric("R", self.r, m)?;
        let s = self.s.map(|s| input::matrix("S", s, (n, m))).transpose()?;
        Ok(Problem { a, b, q, r, s })
    }

    fn validated(&self) -> Result<Problem, DareError> {
        let problem = self.problem()?;
        let joint = problem.joint_weight();
        for (name, weight) in [
            ("Q", Some(&problem.q)),
            ("R", Some(&problem.r)),
            ("[Q S; S' R]", joint.as_ref()),
        ] {
            if let Some((eigenvalue, tolerance)) = weight.and_then(indefinite) {
                return Err(DareError::IndefiniteWeight {
                    name,
                    eigenvalue,
                    tolerance,
                });
            }
        }
        Ok(problem)
    }
}

fn accept(
    problem: &Problem,
    balanced: &Balanced,
    attempt: Attempt,
) -> Result<DareSolution, DareError> {
    let Attempt {
        candidate,
        spectral_radius,
        iterations,
    } = attempt;
    let p = balanced.restore(&candidate.p);
    let condition = condition(&p);
    let Some(restored) = problem.evaluate(p) else {
        return Err(DareError::SingularInputHessian);
    };
    // The routes judge in balanced coordinates; what is reported and promised is the caller's.
    let relative_residual = restored.relative_residual;
    if relative_residual > ACCEPTED_RESIDUAL {
        return Err(DareError::NoConvergence {
            relative_residual,
            spectral_radius,
        });
    }
    let mut losses = Vec::new();
    if spectral_radius > 0.999 {
        losses.push(NearLoss::SlowClosedLoop);
        refuse_unseen(&balanced.problem)?;
    }
    let mut weakest_mode = None;
    let proved = proved_measure(&balanced.problem, &candidate);
    if proved < WEAK {
        let found = hautus::unreached_modes(&balanced.problem.a, &balanced.problem.b)
            .map_err(DareError::Spectrum)?;
        // A bound above rounding is a proof, and overrules a doubt.
        let doubtful = proved < 16.0 * problem.states() as f64 * f64::EPSILON;
        if !found.unreached.is_empty() || doubtful {
            refuse_unreached(&found, balanced)?;
        }
        if found
            .weakest
            .as_ref()
            .is_some_and(|mode| mode.measure < WEAK)
        {
            losses.push(NearLoss::WeakInput);
        }
        weakest_mode = found.weakest;
    }
    if !(condition < 1e7) {
        losses.push(NearLoss::IllConditionedP);
    }
    if restored.relative_residual > 1e-11 {
        losses.push(NearLoss::Residual);
    }
    let warning = (!losses.is_empty()).then_some(Conditioning {
        losses,
        weakest_mode,
    });
    Ok(DareSolution {
        p: restored.p,
        k: restored.k,
        spectral_radius,
        relative_residual: restored.relative_residual,
        condition,
        iterations,
        warning,
    })
}

fn refuse_unseen(problem: &Problem) -> Result<(), DareError> {
    let Some(map) = problem.stage_map() else {
        return Ok(());
    };
    let modes = hautus::unseen_modes(&map.a, &map.h).map_err(DareError::Spectrum)?;
    match modes.into_iter().next() {
        Some(mode) => Err(DareError::UnobservableOnCircle { mode }),
        None => Ok(()),
    }
}

fn refuse_unreached(found: &Stabilisability, balanced: &Balanced) -> Result<(), DareError> {
    let named = |mode: &UncontrollableMode| in_original_coordinates(mode.clone(), balanced);
    if let Some(mode) = found.unreached.first() {
        return Err(DareError::NotStabilisable { mode: named(mode) });
    }
    match found.undecided.first() {
        Some(mode) => Err(DareError::Undecided { mode: named(mode) }),
        None => Ok(()),
    }
}

/// Names what is wrong where no route led to a stabilising solution.
fn diagnose(balanced: &Balanced, best: Option<&Attempt>) -> DareError {
    let problem = &balanced.problem;
    match hautus::unreached_modes(&problem.a, &problem.b) {
        Err(error) => return DareError::Spectrum(error),
        Ok(found) => {
            if let Err(error) = refuse_unreached(&found, balanced) {
                return error;
            }
        }
    }
    if let Err(error) = refuse_unseen(problem) {
        return error;
    }
    match best {
        Some(attempt) => DareError::NoConvergence {
            relative_residual: attempt.candidate.relative_residual,
            spectral_radius: attempt.spectral_radius,
        },
        None if cholesky(&problem.r).is_none() && cholesky(&problem.shifted().r).is_none() => {
            DareError::SingularInputHessian
        }
        None => DareError::NoConvergence {
            relative_residual: f64::INFINITY,
            spectral_radius: f64::INFINITY,
        },
    }
}

/// w for z = T^-1 x becomes T^-1 w for x, of unit length.
fn in_original_coordinates(
    mut mode: UncontrollableMode,
    balanced: &Balanced,
) -> UncontrollableMode {
    for (w, t) in mode.left_eigenvector.iter_mut().zip(&balanced.state_scale) {
        *w *= 1.0 / t;
    }
    let length = mode
        .left_eigenvector
        .iter()
        .map(|w| w.re * w.re + w.im * w.im)
        .sum::<f64>()
        .sqrt();
    for w in &mut mode.left_eigenvector {
        *w *= 1.0 / length;
    }
    mode
}

/// Condition number in the one-norm.
fn condition(p: &Mat<f64>) -> f64 {
    if let Some(inverse) = by_states!(p.nrows(), inverse_norm_one(p)) {
        return norm_one(p) * inverse;
    }
    match cholesky(p) {
        Some(l) => norm_one(p) * norm_one(&cholesky_solve(&l, identity(p.nrows()))),
        None => f64::INFINITY,
    }
}
