//! What is nearly lost in a solution that is valid and fragile.

use crate::arithmetic::dense::{cholesky, cholesky_solve, congruence, identity, mul, norm_one};
use crate::arithmetic::fixed_size::{by_states, inverse_norm_one};
use crate::modes::mode::UncontrollableMode;
use crate::riccati::problem::Problem;
use crate::riccati::proved_measure::WEAK;
use faer::Mat;

/// A closed loop with a larger spectral radius is slow.
pub(crate) const SLOW: f64 = 0.999;
/// A residual above this has lost digits.
pub(crate) const LOST_DIGITS: f64 = 1e-11;
/// A P of a larger condition is ill conditioned.
const ILL_CONDITIONED: f64 = 1e7;

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

impl Conditioning {
    /// What is nearly lost by these figures, if anything is.
    pub(crate) fn of(
        spectral_radius: f64,
        weakest_mode: Option<UncontrollableMode>,
        condition: f64,
        relative_residual: f64,
    ) -> Option<Self> {
        let weak = weakest_mode
            .as_ref()
            .is_some_and(|mode| mode.measure < WEAK);
        let losses: Vec<NearLoss> = [
            (spectral_radius > SLOW, NearLoss::SlowClosedLoop),
            (weak, NearLoss::WeakInput),
            // Written so that NaN counts as well.
            (!(condition < ILL_CONDITIONED), NearLoss::IllConditionedP),
            (relative_residual > LOST_DIGITS, NearLoss::Residual),
        ]
        .into_iter()
        .filter_map(|(lost, loss)| lost.then_some(loss))
        .collect();
        (!losses.is_empty()).then_some(Self {
            losses,
            weakest_mode,
        })
    }
}

/// Of what cancels in an entry of P's diagonal, a state: no more than rounding is left of it.
const CANCELLED: f64 = 16.0 * f64::EPSILON;

/// P without the states that cost nothing: where a cross term cancels what Q and R say of a state up to rounding (the last input where its change
/// has no weight), the sign and size of what is left are rounding too, and its row and column become zero. A level set is unbounded there.
pub(crate) fn without_cancelled(
    problem: &Problem,
    mut p: Mat<f64>,
    k: &Mat<f64>,
    closed_loop: &Mat<f64>,
) -> Mat<f64> {
    let Some(s) = &problem.s else { return p };
    let n = p.nrows();
    let (effort, cross, later) = (
        congruence(k, &problem.r),
        mul(s, k),
        congruence(closed_loop, &p),
    );
    for i in 0..n {
        let terms = problem.q[(i, i)] + effort[(i, i)] + 2.0 * cross[(i, i)].abs() + later[(i, i)];
        if p[(i, i)].abs() <= CANCELLED * n as f64 * terms {
            for j in 0..n {
                p[(i, j)] = 0.0;
                p[(j, i)] = 0.0;
            }
        }
    }
    p
}

/// Condition number in the one-norm; infinite where `p` has no Cholesky factor, zero included.
pub(crate) fn condition(p: &Mat<f64>) -> f64 {
    let inverse = by_states!(p.nrows(), inverse_norm_one(p)).unwrap_or_else(|| {
        cholesky(p).map_or(f64::INFINITY, |l| {
            norm_one(&cholesky_solve(&l, identity(p.nrows())))
        })
    });
    if inverse.is_finite() {
        norm_one(p) * inverse
    } else {
        f64::INFINITY
    }
}
