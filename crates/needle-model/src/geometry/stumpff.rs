//! Stumpff functions C_n(x) = sum over i of (-x)^i / (2i + n)!, the coefficients of every closed
//! form of the exponential map: with x = theta^2, C_0 = cos theta, C_1 = sin theta / theta,
//! C_2 = (1 - cos theta) / theta^2, C_3 = (theta - sin theta) / theta^3, and so on.
//!
//! Source: K. Stumpff, Himmelsmechanik I, 1959; C_n = 1/n! - x C_{n+2}. Written this way no
//! formula divides by an angle, so a straight needle and a needle at rest are ordinary cases.

/// Above this x the trigonometric forms lose less than two digits; below it the series converges
/// to rounding within [`SERIES_TERMS`] terms.
const SERIES_LIMIT: f64 = 1.0;

/// 1/n! for n = 0..=22: the coefficients of the two series at the top of the recurrence.
const INVERSE_FACTORIAL: [f64; 23] = {
    let mut table = [1.0; 23];
    let mut n = 1;
    while n < 23 {
        table[n] = table[n - 1] / n as f64;
        n += 1;
    }
    table
};

/// The remainder at x = 1 is below 1 / 22! = 1e-21 of the leading term 1 / 5!.
const SERIES_TERMS: usize = 9;

/// C_0 .. C_5 at one argument.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stumpff {
    pub(crate) c0: f64,
    pub(crate) c1: f64,
    pub(crate) c2: f64,
    pub(crate) c3: f64,
    pub(crate) c4: f64,
    pub(crate) c5: f64,
}

impl Stumpff {
    /// Evaluates at `x = theta^2 >= 0`.
    pub(crate) fn at_squared_angle(x: f64) -> Self {
        if x < SERIES_LIMIT {
            let c5 = series(5, x);
            let c4 = series(4, x);
            let c3 = 1.0 / 6.0 - x * c5;
            let c2 = 0.5 - x * c4;
            Self {
                c0: 1.0 - x * c2,
                c1: 1.0 - x * c3,
                c2,
                c3,
                c4,
                c5,
            }
        } else {
            let theta = x.sqrt();
            let (sin, cos) = theta.sin_cos();
            let c1 = sin / theta;
            let c2 = (1.0 - cos) / x;
            let c3 = (1.0 - c1) / x;
            Self {
                c0: cos,
                c1,
                c2,
                c3,
                c4: (0.5 - c2) / x,
                c5: (1.0 / 6.0 - c3) / x,
            }
        }
    }
}

/// Horner's scheme for C_n(x), |x| below [`SERIES_LIMIT`].
fn series(n: usize, x: f64) -> f64 {
    let mut sum = 0.0;
    for i in (0..SERIES_TERMS).rev() {
        sum = INVERSE_FACTORIAL[2 * i + n] - x * sum;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_and_trigonometric_forms_meet_at_the_border() {
        let below = Stumpff::at_squared_angle(SERIES_LIMIT * (1.0 - 1e-15));
        let above = Stumpff::at_squared_angle(SERIES_LIMIT);
        for (a, b) in [
            (below.c0, above.c0),
            (below.c1, above.c1),
            (below.c2, above.c2),
            (below.c3, above.c3),
            (below.c4, above.c4),
            (below.c5, above.c5),
        ] {
            // The trigonometric form divides rounding errors of order 1e-16 by x = 1.
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
    }

    #[test]
    fn values_at_zero_are_inverse_factorials() {
        let s = Stumpff::at_squared_angle(0.0);
        assert_eq!(
            [s.c0, s.c1, s.c2, s.c3, s.c4, s.c5],
            [1.0, 1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0]
        );
    }
}
