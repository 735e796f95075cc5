//! Where a function is worst over an ellipsoid: evenly spread samples, descent on the unit sphere, and the size at which a limit is kept.

use crate::terminal::End;
use nalgebra::{Matrix6, Vector6};

/// Samples whose worst is a start of a descent, its first step on the unit sphere, and its steps.
pub(super) const DESCENT: (usize, f64, usize) = (250, 0.2, 40);

/// Part of a limit that is left to what the search for its largest share does not find.
const SEARCH_MARGIN: f64 = 1e-3;

/// Trials of a smaller size.
const TRIALS: usize = 50;

/// By how much the level is to be scaled, at most by `scale`, so that `share` stays below one in the set: from where its linearisation,
/// a row, is largest, P^-1 f of each row f, uphill to where it is itself.
pub(super) fn scale_within(
    end: &End<'_>,
    mut scale: f64,
    rows: impl IntoIterator<Item = Vector6<f64>>,
    share: impl Fn(&Vector6<f64>) -> Option<f64>,
) -> f64 {
    let p = Matrix6::from_fn(|i, j| end.p[(i, j)]);
    let (Some(level), Some(factor)) = (end.level, p.cholesky()) else {
        return scale;
    };
    let upper = factor.l().transpose();
    for row in rows {
        let Some(outward) = (upper * factor.solve(&row)).try_normalize(0.0) else {
            continue;
        };
        for start in [outward, -outward] {
            // The reference's own change is part of what is used: a set that is smaller by the excess uses less, but not by as much.
            for _ in 0..TRIALS {
                let left = |direction: &Vector6<f64>| {
                    let xi = upper.solve_upper_triangular(direction);
                    let used = xi.and_then(|xi| share(&(xi * (level * scale).sqrt())));
                    used.map_or(f64::NEG_INFINITY, |used| -used)
                };
                let used = -descended((left(&start), start), left);
                if used <= 1.0 - SEARCH_MARGIN {
                    break;
                }
                scale *= ((1.0 - SEARCH_MARGIN) / used).powi(2);
            }
        }
    }
    scale
}

/// The least of a function on the unit sphere that steepest descent finds from a start.
pub(super) fn descended(
    (mut least, mut here): (f64, Vector6<f64>),
    function: impl Fn(&Vector6<f64>) -> f64,
) -> f64 {
    // Differences of margins of 0.01 and more, known to 1e-10 or so.
    const DIFFERENCE: f64 = 1e-5;
    let (_, mut reach, steps) = DESCENT;
    for _ in 0..steps {
        let beside = |i: usize| (here + Vector6::ith(i, DIFFERENCE)).normalize();
        let rise = Vector6::from_fn(|i, _| function(&beside(i)) - least);
        let Some(uphill) = (rise - here * rise.dot(&here)).try_normalize(0.0) else {
            break;
        };
        let tried = (here - uphill * reach).normalize();
        let found = function(&tried);
        if found < least {
            (least, here, reach) = (found, tried, 1.5 * reach);
        } else {
            reach *= 0.3;
        }
    }
    least
}

/// The `sample`-th of a sequence of directions that fills the sphere evenly enough: the Kronecker sequence of the powers of 1/g, with
/// g^7 = g + 1 (Roberts, 2018), in the cube, normalised.
pub(super) fn direction(sample: usize) -> Vector6<f64> {
    const G: f64 = 1.112_775_684_278_705_5;
    let in_cube = |i: usize, _| 2.0 * (0.5 + sample as f64 * G.powi(-1 - i as i32)).fract() - 1.0;
    let point = Vector6::from_fn(in_cube);
    // The first is the centre of the cube, which is no direction.
    point.try_normalize(1e-9).unwrap_or_else(Vector6::x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_directions_lie_in_no_hyperplane() {
        let directions: Vec<_> = (1..=48).map(direction).collect();
        let gram = directions
            .iter()
            .map(|d| d * d.transpose())
            .sum::<Matrix6<f64>>()
            / 48.0;
        // Evenly spread they would give a sixth of the identity.
        let least = gram.symmetric_eigenvalues().min();
        assert!(least > 0.05, "{least}");
    }
}
