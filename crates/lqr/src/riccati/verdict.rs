//! Judges the candidates for a Riccati solution: accepted with its warnings, or refused by the name of a mode.

use crate::arithmetic::definiteness::{indefinite, indefinite_weight, loses_its_sign};
use crate::arithmetic::dense::{cholesky, norm};
use crate::modes::hautus;
use crate::modes::mode::{Stabilisability, UncontrollableMode, UnobservableMode};
use crate::riccati::balance::Balanced;
use crate::riccati::conditioning::{Conditioning, LOST_DIGITS, SLOW, condition, without_cancelled};
use crate::riccati::dare_error::DareError;
use crate::riccati::dare_solution::DareSolution;
use crate::riccati::extended_solution::{Extended, extended_residual, extended_solution};
use crate::riccati::problem::Problem;
use crate::riccati::proved_measure::{WEAK, proved_measure};
use crate::riccati::routes::{ACCEPTED_RESIDUAL, Attempt, Route};
use crate::riccati::zeros;
use faer::{Mat, c64};

/// Inputs with a smaller relative pivot of R + B'PB are a matter for more digits.
const NEARLY_DEPENDENT: f64 = 1e-10;
/// Of a solution in extended precision: rounding P to doubles leaves eps |A_K|^2, and with a larger residual P says too little.
const ACCEPTED_EXTENDED_RESIDUAL: f64 = 1e-4;

/// The solution by ordinary arithmetic; `weight` is |Q| in the caller's coordinates.
pub(crate) fn in_doubles(balanced: &Balanced, weight: f64) -> Result<DareSolution, DareError> {
    let mut best: Option<Attempt> = None;
    for route in [Route::Doubling, Route::ShiftedDoubling, Route::Regularised] {
        for attempt in route.attempts(&balanced.problem) {
            if attempt.is_stabilising() {
                return accept(balanced, weight, attempt);
            }
            if best
                .as_ref()
                .is_none_or(|best| attempt.is_better_than(best))
            {
                best = Some(attempt);
            }
        }
    }
    Err(diagnose(balanced, best.as_ref()))
}

/// Whether rounding, not the data, may be to blame for the outcome.
pub(crate) fn calls_for_more_digits(found: &Result<DareSolution, DareError>) -> bool {
    match found {
        Ok(solution) => {
            // A finite condition is that of a P with a Cholesky factor.
            let doubtful = !solution.condition.is_finite() && loses_its_sign(&solution.p);
            solution.relative_residual > LOST_DIGITS || doubtful
        }
        Err(error) => matches!(
            error,
            DareError::NoConvergence { .. }
                | DareError::IndefiniteSolution { .. }
                | DareError::Undecided { .. }
                | DareError::SingularInputHessian
        ),
    }
}

/// The solution by double-double arithmetic, where the data decide that there is one; else `found` as it was, or why they do not.
pub(crate) fn in_extended_precision(
    problem: &Problem,
    balanced: &Balanced,
    found: Result<DareSolution, DareError>,
) -> Result<DareSolution, DareError> {
    // What doubles found may have lost its sign: then it is no answer.
    let unless_negative = |found: Result<DareSolution, DareError>| {
        let solution = found?;
        match indefinite_weight(&solution.p) {
            Some((eigenvalue, tolerance)) => Err(DareError::IndefiniteSolution {
                eigenvalue,
                tolerance,
            }),
            None => Ok(solution),
        }
    };
    let (p, k, spectral_radius, iterations) = match extended_solution(&balanced.problem) {
        Extended::Decided {
            p,
            k,
            spectral_radius,
            iterations,
        } => (p, k, spectral_radius, iterations),
        Extended::Dependent => return Err(DareError::SingularInputHessian),
        Extended::Undecided { sensitivity } => {
            return match unless_negative(found) {
                Err(DareError::NoConvergence { .. } | DareError::IndefiniteSolution { .. }) => {
                    Err(DareError::IllConditioned { sensitivity })
                }
                other => other,
            };
        }
        Extended::NotFound => return unless_negative(found),
    };
    let closed_loop = balanced.problem.closed_loop(&k);
    let p = balanced.restore(without_cancelled(&balanced.problem, p, &k, &closed_loop));
    let Some(relative_residual) = extended_residual(problem, &p) else {
        return unless_negative(found);
    };
    if let Some((eigenvalue, tolerance)) = indefinite(&p).or_else(|| indefinite_weight(&p)) {
        return Err(DareError::IndefiniteSolution {
            eigenvalue,
            tolerance,
        });
    }
    // Doubles may have come as close: then their answer stands, with the same P up to rounding.
    if let Ok(solution) = &found
        && solution.relative_residual <= relative_residual
        && !loses_its_sign(&solution.p)
    {
        return found;
    }
    if !(relative_residual <= ACCEPTED_EXTENDED_RESIDUAL) {
        return Err(DareError::NoConvergence {
            relative_residual,
            spectral_radius,
        });
    }
    if spectral_radius > SLOW {
        refuse_unseen(balanced, Some(&closed_loop))?;
    }
    let weakest_mode = hautus::unreached_modes(&balanced.problem.a, &balanced.problem.b)
        .ok()
        .and_then(|found| found.weakest);
    let condition = condition(&p);
    Ok(DareSolution {
        warning: Conditioning::of(spectral_radius, weakest_mode, condition, relative_residual),
        p,
        k: balanced.restore_gain(k),
        spectral_radius,
        relative_residual,
        condition,
        iterations,
    })
}

fn accept(balanced: &Balanced, weight: f64, attempt: Attempt) -> Result<DareSolution, DareError> {
    let Attempt {
        candidate,
        spectral_radius,
        iterations,
    } = attempt;
    let proved = proved_measure(&balanced.problem, &candidate);
    // The routes judge in balanced coordinates; what is reported and promised is the caller's. Powers of two change no digit.
    let (k, closed_loop) = (candidate.k, candidate.closed_loop);
    let p = without_cancelled(&balanced.problem, candidate.p, &k, &closed_loop);
    let p = balanced.restore(p);
    let size = norm(&balanced.restore(candidate.residual));
    let relative_residual = if size == 0.0 {
        0.0
    } else {
        size / norm(&p).max(weight)
    };
    // With inputs so nearly dependent P can be the fixed point of the rounded map and far from that of the map.
    if !(relative_residual <= ACCEPTED_RESIDUAL) || candidate.hessian_pivot < NEARLY_DEPENDENT {
        return Err(DareError::NoConvergence {
            relative_residual,
            spectral_radius,
        });
    }
    // Semidefinite in the balanced coordinates, P may have lost its sign in those of the caller; with a factor it has not.
    let condition = condition(&p);
    if !condition.is_finite()
        && let Some((eigenvalue, tolerance)) = indefinite(&p)
    {
        return Err(DareError::IndefiniteSolution {
            eigenvalue,
            tolerance,
        });
    }
    if spectral_radius > SLOW {
        refuse_unseen(balanced, Some(&closed_loop))?;
    }
    let mut weakest_mode = None;
    if proved < WEAK {
        let found = hautus::unreached_modes(&balanced.problem.a, &balanced.problem.b)
            .map_err(DareError::Spectrum)?;
        // A bound above rounding is a proof, and overrules a doubt.
        let doubtful = proved < 16.0 * balanced.problem.states() as f64 * f64::EPSILON;
        if !found.unreached.is_empty() || doubtful {
            refuse_unreached(&found, balanced)?;
        }
        weakest_mode = found.weakest;
    }
    Ok(DareSolution {
        warning: Conditioning::of(spectral_radius, weakest_mode, condition, relative_residual),
        p,
        k: balanced.restore_gain(k),
        spectral_radius,
        relative_residual,
        condition,
        iterations,
    })
}

/// With a singular R the zeros are sought near the eigenvalues of `closed_loop`.
fn refuse_unseen(balanced: &Balanced, closed_loop: Option<&Mat<f64>>) -> Result<(), DareError> {
    let problem = &balanced.problem;
    let found = match (problem.stage_map(), closed_loop) {
        (Some(map), _) => hautus::unseen_modes(&map.a, &map.h).map(|m| m.into_iter().next()),
        (None, Some(closed_loop)) => zeros::free_zero_on_circle(problem, closed_loop),
        (None, None) => Ok(None),
    };
    match found.map_err(DareError::Spectrum)? {
        Some(mode) => Err(DareError::UnobservableOnCircle {
            mode: unseen_in_original_coordinates(mode, balanced),
        }),
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
    if let Err(error) = refuse_unseen(balanced, best.map(|best| &best.candidate.closed_loop)) {
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
    to_unit_length(&mut mode.left_eigenvector);
    mode
}

/// v for z = T^-1 x becomes T v for x, of unit length.
fn unseen_in_original_coordinates(
    mut mode: UnobservableMode,
    balanced: &Balanced,
) -> UnobservableMode {
    for (v, t) in mode.right_eigenvector.iter_mut().zip(&balanced.state_scale) {
        *v *= *t;
    }
    to_unit_length(&mut mode.right_eigenvector);
    mode
}

fn to_unit_length(vector: &mut [c64]) {
    let square: f64 = vector.iter().map(|w| w.re * w.re + w.im * w.im).sum();
    for w in vector {
        *w *= 1.0 / square.sqrt();
    }
}
