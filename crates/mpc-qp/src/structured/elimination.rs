//! One stage of the Riccati recursion: the elimination of an input from the Newton system.
//!
//! The system is the linear-quadratic problem
//! min sum of 1/2 [dx; du]' [Qk Sk'; Sk Rk] [dx; du] + weighted squares of the constraint values + gradient terms
//! subject to dx_{k+1} = A_k dx_k + B_k du_k, dx_0 = 0.
//! Rate limits couple u_k with u_{k-1} = p: the cost to go is a quadratic in (x, p). Instead of
//! carrying p as NU more states, the recursion uses that p enters only through the diagonal rate
//! weights W: with M the curvature in u_k before the rate term,
//! P_xp = Hxu (M + W)^-1 W and P_pp = M (M + W)^-1 W. Neither subtracts numbers of the size of W,
//! which grows without bound on active limits.

use super::kernel::{Lanes, add_product, sub_product};
use super::riccati::{Gain, Stage};

/// Curvature of the cost to go in (x, p).
#[derive(Clone, Copy, Debug)]
pub(super) struct Value<const NX: usize, const NU: usize> {
    /// Block in x.
    pub(super) xx: [[f64; NX]; NX],
    /// Coupling: `xp[j]` is the column for component j of the last input.
    pub(super) xp: [[f64; NX]; NU],
    /// Block in p.
    pub(super) pp: [[f64; NU]; NU],
}

impl<const NX: usize, const NU: usize> Value<NX, NU> {
    /// All zeros.
    pub(super) const ZERO: Self = Self {
        xx: [[0.0; NX]; NX],
        xp: [[0.0; NX]; NU],
        pp: [[0.0; NU]; NU],
    };
}

/// Hessian of one stage, the general rows' weights in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curvature<'a, const NX: usize, const NU: usize> {
    /// Block in x.
    pub(super) q: &'a [[f64; NX]; NX],
    /// Rows of the cross block.
    pub(super) s: &'a [[f64; NX]; NU],
    /// Block in u.
    pub(super) r: &'a [[f64; NU]; NU],
    /// Diagonal added to the block in u by the input bounds.
    pub(super) u_weight: [f64; NU],
    /// Weights on u_k - u_{k-1}.
    pub(super) rate_weight: [f64; NU],
    /// Whether weights on states, or a stiff ellipsoid, force the closed-loop form.
    pub(super) closed_loop: bool,
}

/// Inverse of a symmetric positive definite matrix by L D L'; a direction without
/// curvature (pivot below rounding of its diagonal entry) gets inverse zero: it is left where it is.
#[inline(always)]
pub(super) fn inverse<L: Lanes, const NU: usize>(lanes: L, m: &[[f64; NU]; NU]) -> [[f64; NU]; NU] {
    // t[j] is column j of L^-1, built along with the elimination.
    let mut work = *m;
    let mut t = [[0.0; NU]; NU];
    let mut reciprocal = [0.0; NU];
    for j in 0..NU {
        t[j][j] = 1.0;
        reciprocal[j] = if work[j][j] > 1e-14 * m[j][j] {
            1.0 / work[j][j]
        } else {
            0.0
        };
        for i in j + 1..NU {
            let factor = work[j][i] * reciprocal[j];
            for k in i..NU {
                work[i][k] = lanes.fma1(-factor, work[j][k], work[i][k]);
            }
            for k in 0..=j {
                t[k][i] = lanes.fma1(-factor, t[k][j], t[k][i]);
            }
        }
    }
    let mut result = [[0.0; NU]; NU];
    for i in 0..NU {
        for j in 0..=i {
            let mut sum = 0.0;
            for k in i..NU {
                sum = lanes.fma1(t[i][k] * reciprocal[k], t[j][k], sum);
            }
            result[i][j] = sum;
            result[j][i] = sum;
        }
    }
    result
}

/// The upper triangle from the lower one.
#[inline(always)]
fn mirror<const N: usize>(m: &mut [[f64; N]; N]) {
    for j in 0..N {
        for i in j + 1..N {
            m[i][j] = m[j][i];
        }
    }
}

/// The mean of both triangles in each.
#[inline(always)]
fn average<const N: usize>(m: &mut [[f64; N]; N]) {
    for j in 0..N {
        for i in j + 1..N {
            let mean = 0.5 * (m[j][i] + m[i][j]);
            (m[j][i], m[i][j]) = (mean, mean);
        }
    }
}

/// Eliminates u_k: from the value at k+1, `next`, to the value at k and the gain.
///
/// Where weights on states can make P huge, the value's block in x is summed in closed-loop form (Joseph's): with F = A - B K and
/// the next value's blocks P, Pxp, Ppp,
/// Q + F'(P F - Pxp K) - S K - K'(S' + Ppx F - Ppp K - (R + W) K).
/// It multiplies P by the square of what F leaves of a direction, where the textbook's Q + A'PA - Hxu K subtracts two numbers of the
/// size of P. Where only inputs, rates and an ellipsoid that is not stiff have weights, the shorter textbook form is taken unless it loses
/// more than three digits on its diagonal.
#[inline(always)]
pub(super) fn eliminate<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    cost: &Curvature<'_, NX, NU>,
    next: &Value<NX, NU>,
    (value, gain): (&mut Value<NX, NU>, &mut Gain<NX, NU>),
) {
    let mut hxu = [[0.0; NX]; NU];
    let mut m = *cost.r;
    for j in 0..NU {
        let column = add_product(lanes, &next.xx, &stage.b[j], &next.xp[j]);
        hxu[j] = add_product(lanes, &stage.at, &column, &cost.s[j]);
        // The coupling twice: the mean of both triangles makes of it B'Pxp and its transpose.
        let mut coupled = column;
        for i in 0..NX {
            coupled[i] += next.xp[j][i];
        }
        m[j] = add_product(lanes, &stage.bt, &coupled, &m[j]);
        for i in 0..NU {
            m[j][i] += next.pp[j][i];
        }
        m[j][j] += cost.u_weight[j];
    }
    average(&mut m);
    let mut total = m;
    for j in 0..NU {
        total[j][j] += cost.rate_weight[j];
    }
    let inv = inverse(lanes, &total);
    for i in 0..NU {
        gain.kx[i] = add_product(lanes, &hxu, &inv[i], &[0.0; NX]);
    }
    let kx = &gain.kx;
    // Written in place: a block of states handed around is a copy that the next loads wait for.
    if cost.closed_loop || !textbook(lanes, stage, cost.q, next, (&hxu, kx), &mut value.xx) {
        closed_loop(lanes, stage, cost, next, kx, &mut value.xx);
    }
    for j in 0..NU {
        for i in 0..NX {
            value.xp[j][i] = kx[j][i] * cost.rate_weight[j];
        }
    }
    let mut mi = [[0.0; NU]; NU];
    for j in 0..NU {
        mi[j] = add_product(lanes, &m, &inv[j], &[0.0; NU]);
    }
    for j in 0..NU {
        for i in 0..NU {
            value.pp[j][i] =
                0.5 * (mi[j][i] * cost.rate_weight[j] + mi[i][j] * cost.rate_weight[i]);
        }
    }
    gain.inverse = inv;
    gain.rate = cost.rate_weight;
}

/// The value's block in x under the feedback -kx.
#[inline(always)]
fn closed_loop<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    cost: &Curvature<'_, NX, NU>,
    next: &Value<NX, NU>,
    kx: &[[f64; NX]; NU],
    xx: &mut [[f64; NX]; NX],
) {
    // Rows of F, and of the factor of -K'.
    let mut rows = [[0.0; NX]; NX];
    for i in 0..NX {
        rows[i] = sub_product(lanes, kx, &stage.bt[i], &stage.at[i]);
    }
    let mut rest = [[0.0; NX]; NU];
    for i in 0..NU {
        let mut weights = [0.0; NU];
        for l in 0..NU {
            weights[l] = next.pp[i][l] + cost.r[i][l];
        }
        weights[i] += cost.u_weight[i] + cost.rate_weight[i];
        rest[i] = add_product(
            lanes,
            &rows,
            &next.xp[i],
            &sub_product(lanes, kx, &weights, &cost.s[i]),
        );
    }
    for j in 0..NX {
        let (mut f, mut k, mut g) = ([0.0; NX], [0.0; NU], [0.0; NU]);
        for l in 0..NX {
            f[l] = rows[l][j];
        }
        for l in 0..NU {
            (k[l], g[l]) = (kx[l][j], rest[l][j]);
        }
        let column = sub_product(
            lanes,
            &next.xp,
            &k,
            &add_product(lanes, &next.xx, &f, &[0.0; NX]),
        );
        let open = sub_product(lanes, cost.s, &k, &sub_product(lanes, kx, &g, &cost.q[j]));
        xx[j] = add_product(lanes, &rows, &column, &open);
    }
    average(xx);
}

/// Part of a diagonal entry that the subtraction must leave over.
const LEAST_LEFT: f64 = 1e-3;

/// Q + A'PA - Hxu K; false where the difference is too small beside its terms.
#[inline(always)]
fn textbook<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    q: &[[f64; NX]; NX],
    next: &Value<NX, NU>,
    (hxu, kx): (&[[f64; NX]; NU], &[[f64; NX]; NU]),
    xx: &mut [[f64; NX]; NX],
) -> bool {
    // Product by product: the columns of one matrix stay in registers.
    let mut ahead = [[0.0; NX]; NX];
    for j in 0..NX {
        ahead[j] = add_product(lanes, &next.xx, &stage.a[j], &[0.0; NX]);
    }
    let mut kept = true;
    for j in 0..NX {
        let mut gain = [0.0; NU];
        for i in 0..NU {
            gain[i] = kx[i][j];
        }
        let open = add_product(lanes, &stage.at, &ahead[j], &q[j]);
        xx[j] = sub_product(lanes, hxu, &gain, &open);
        kept &= xx[j][j] >= LEAST_LEFT * open[j];
    }
    mirror(xx);
    kept
}
