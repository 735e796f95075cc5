//! A lower bound on the Hautus measure over all |lambda| >= 1, proved by a stable closed loop A_K = A + BK.
//!
//! A_K - lambda I = [A - lambda I, B][I; K], so the measure is at least 1 / (|[I; K]| |(A_K - lambda I)^-1|). The resolvent is bounded
//! by 2|P| / mu where P - A_K'PA_K >= mu I. In the norm of P: v = (A_K - lambda I)x gives |x| <= |A_K x| + |v|, and
//! |A_K x|^2 <= |x|^2 - mu x'x. One factorisation says whether that is enough; a weight that does not see every state, mu = 0, asks for
//! another P: the sum of |A_K^j| bounds the resolvent too, and so does 2|X| with X = A_K'XA_K + I. Squaring bounds the sum only by the product of
//! 1 + |A_K^(2^j)|, which compounds a transient of t at every power (2.8e5 for a sum of 279 at eight states); |X| grows as t^2 once.

use crate::arithmetic::dense::{add_scaled, cholesky, congruence, identity, norm};
use crate::arithmetic::fixed_size::{by_states, decreases};
use crate::modes::spectrum::{lyapunov_sum, sum_of_powers};
use crate::riccati::problem::{Candidate, Problem};

/// A Hautus measure below this is worth a warning, and a bound below it worth the explicit test.
pub(crate) const WEAK: f64 = 1e-6;

/// The first of the bounds that settles the matter, else the larger of the last two.
pub(crate) fn proved_measure(problem: &Problem, candidate: &Candidate) -> f64 {
    let scale = 1.0 + norm(&problem.a);
    // B was scaled by column in the measure, so the rows of K scale inversely.
    let mut gain_square = problem.states() as f64;
    for i in 0..candidate.k.nrows() {
        let column: f64 = problem.b.col_as_slice(i).iter().map(|x| x * x).sum();
        let row: f64 = (0..candidate.k.ncols())
            .map(|j| candidate.k[(i, j)].powi(2))
            .sum();
        gain_square += row * column / (scale * scale);
    }
    let factor = gain_square.sqrt() * scale;
    if falls_by(candidate, 2.0 * WEAK * factor * norm(&candidate.p)) {
        return WEAK;
    }
    let by_powers = 1.0 / (factor * sum_of_powers(&candidate.closed_loop));
    if by_powers >= WEAK {
        return by_powers;
    }
    match lyapunov_sum(&candidate.closed_loop, &identity(problem.states())) {
        Some(x) => by_powers.max(0.5 / (factor * norm(&x))),
        None => by_powers,
    }
}

/// Whether P - A_K'PA_K - `least` I is positive definite.
fn falls_by(candidate: &Candidate, least: f64) -> bool {
    let (p, closed_loop) = (&candidate.p, &candidate.closed_loop);
    by_states!(p.nrows(), decreases(p, closed_loop, least)).unwrap_or_else(|| {
        let fall = add_scaled(p, -1.0, &congruence(closed_loop, p));
        cholesky(&add_scaled(&fall, -least, &identity(p.nrows()))).is_some()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modes::hautus::unreached_modes;
    use crate::riccati::routes::Route;
    use faer::Mat;

    /// Eigenvalues around one and a closed loop with a long transient, as in the benchmark.
    fn solved(n: usize, q: Mat<f64>) -> (Problem, Candidate) {
        let problem = Problem {
            a: Mat::from_fn(n, n, |i, j| {
                if i == j {
                    1.0
                } else {
                    0.1 * ((i * 7 + j * 3) as f64).sin()
                }
            }),
            b: Mat::from_fn(n, 2, |i, j| 0.3 * ((i * 5 + j * 11) as f64).cos()),
            q,
            r: identity(2),
            s: None,
        };
        let mut attempts = Route::Doubling.attempts(&problem);
        let attempt = attempts.pop().unwrap();
        assert!(attempt.is_stabilising(), "{n}");
        (problem, attempt.candidate)
    }

    #[test]
    fn a_long_transient_does_not_call_for_the_hautus_test() {
        // The second weight sees one state only: there the decrease of P settles nothing, and X has to.
        let first = |n: usize| Mat::from_fn(n, n, |i, j| f64::from(i == 0 && j == 0));
        for n in [6, 8] {
            for (q, by_cost) in [(identity(n), true), (first(n), false)] {
                let (problem, candidate) = solved(n, q);
                let proved = proved_measure(&problem, &candidate);
                assert!(proved >= WEAK, "{n} states: {proved:e}");
                assert_eq!(proved == WEAK, by_cost, "{n} states: {proved:e}");
            }
        }
    }

    #[test]
    fn the_bound_stays_below_the_measure() {
        for n in 2..=9 {
            let (problem, candidate) = solved(n, identity(n));
            let weakest = unreached_modes(&problem.a, &problem.b).unwrap().weakest;
            let proved = proved_measure(&problem, &candidate);
            assert!(proved > 0.0);
            assert!(
                weakest.is_none_or(|mode| proved <= mode.measure),
                "{n} states: {proved:e}"
            );
        }
    }
}
