//! Riccati recursion for the Newton system of one interior-point iteration.
//!
//! The system is the linear-quadratic problem
//! min sum of 1/2 [dx; du]' [Qk Sk'; Sk Rk] [dx; du] + weighted squares of the constraint values + gradient terms
//! subject to dx_{k+1} = A_k dx_k + B_k du_k, dx_0 = 0.
//! Rate limits couple u_k with u_{k-1} = p: the cost to go is a quadratic in (x, p). Instead of
//! carrying p as NU more states, the recursion uses that p enters only through the diagonal rate
//! weights W: with M the curvature in u_k before the rate term,
//! P_xp = Hxu (M + W)^-1 W and P_pp = M (M + W)^-1 W. Neither subtracts numbers of the size of W,
//! which grows without bound on active limits.

use super::kernel::{Lanes, add_product, dot, sub_product};

/// One stage's dynamics and cost, in the layouts that the products read.
#[derive(Clone, Debug)]
pub(super) struct Stage<const NX: usize, const NU: usize> {
    /// A by columns.
    pub(super) a: [[f64; NX]; NX],
    /// A by rows.
    pub(super) at: [[f64; NX]; NX],
    /// B by columns.
    pub(super) b: [[f64; NX]; NU],
    /// B by rows.
    pub(super) bt: [[f64; NU]; NX],
    /// Affine term of the dynamics.
    pub(super) c: [f64; NX],
    /// Q, symmetric.
    pub(super) q: [[f64; NX]; NX],
    /// S by rows: `s[i]` couples input i with the states.
    pub(super) s: [[f64; NX]; NU],
    /// R, symmetric.
    pub(super) r: [[f64; NU]; NU],
    /// Linear cost in x.
    pub(super) qv: [f64; NX],
    /// Linear cost in u.
    pub(super) rv: [f64; NU],
}

impl<const NX: usize, const NU: usize> Stage<NX, NU> {
    /// All zeros.
    pub(super) const ZERO: Self = Self {
        a: [[0.0; NX]; NX],
        at: [[0.0; NX]; NX],
        b: [[0.0; NX]; NU],
        bt: [[0.0; NU]; NX],
        c: [0.0; NX],
        q: [[0.0; NX]; NX],
        s: [[0.0; NX]; NU],
        r: [[0.0; NU]; NU],
        qv: [0.0; NX],
        rv: [0.0; NU],
    };
}

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

/// What the solves need of a factorised stage.
#[derive(Clone, Debug)]
pub(super) struct Gain<const NX: usize, const NU: usize> {
    /// Feedback on x by rows: du = -kx dx + ...
    pub(super) kx: [[f64; NX]; NU],
    /// Inverse of the curvature in u, symmetric.
    pub(super) inverse: [[f64; NU]; NU],
    /// Rate weights of the stage.
    pub(super) rate: [f64; NU],
}

impl<const NX: usize, const NU: usize> Gain<NX, NU> {
    /// All zeros.
    pub(super) const ZERO: Self = Self {
        kx: [[0.0; NX]; NU],
        inverse: [[0.0; NU]; NU],
        rate: [0.0; NU],
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

/// Column j of the symmetric part.
#[inline(always)]
fn symmetric_column<const N: usize>(m: &[[f64; N]; N], j: usize) -> [f64; N] {
    let mut column = [0.0; N];
    for i in 0..N {
        column[i] = 0.5 * (m[j][i] + m[i][j]);
    }
    column
}

/// Eliminates u_k: from the value at k+1 to the value at k, leaving the gain behind.
///
/// The value's block in x is summed in closed-loop form (Joseph's): with F = A - B K and the next value's blocks P, Pxp, Ppp,
/// Q + F'(P F - Pxp K) - S K - K'(S' + Ppx F - Ppp K - (R + W) K).
/// An active state bound makes P huge in a direction that F all but cancels; the textbook A'PA - K'HK would subtract two numbers of
/// the size of P there, this form multiplies P by the square of what is left.
#[inline(always)]
pub(super) fn eliminate<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    cost: &Curvature<'_, NX, NU>,
    value: &mut Value<NX, NU>,
    gain: &mut Gain<NX, NU>,
) {
    let mut hxu = [[0.0; NX]; NU];
    let mut m = *cost.r;
    for j in 0..NU {
        let column = add_product(lanes, &value.xx, &stage.b[j], &value.xp[j]);
        hxu[j] = add_product(lanes, &stage.at, &column, &cost.s[j]);
        for i in 0..=j {
            m[j][i] += dot(lanes, &stage.b[i], &column)
                + dot(lanes, &value.xp[i], &stage.b[j])
                + value.pp[j][i];
        }
        m[j][j] += cost.u_weight[j];
    }
    for j in 0..NU {
        for i in 0..j {
            m[i][j] = m[j][i];
        }
    }
    let mut total = m;
    for j in 0..NU {
        total[j][j] += cost.rate_weight[j];
    }
    let inv = inverse(lanes, &total);
    let mut kx = [[0.0; NX]; NU];
    for i in 0..NU {
        kx[i] = add_product(lanes, &hxu, &inv[i], &[0.0; NX]);
    }
    value.xx = closed_loop(lanes, stage, cost, value, &kx);
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
    gain.kx = kx;
    gain.inverse = inv;
    gain.rate = cost.rate_weight;
}

/// The value's block in x under the feedback -kx.
#[inline(always)]
fn closed_loop<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    cost: &Curvature<'_, NX, NU>,
    value: &Value<NX, NU>,
    kx: &[[f64; NX]; NU],
) -> [[f64; NX]; NX] {
    // Rows of F, and of the factor of -K'.
    let mut rows = [[0.0; NX]; NX];
    for i in 0..NX {
        rows[i] = sub_product(lanes, kx, &stage.bt[i], &stage.at[i]);
    }
    let mut rest = [[0.0; NX]; NU];
    for i in 0..NU {
        let mut weights = [0.0; NU];
        for l in 0..NU {
            weights[l] = value.pp[i][l] + cost.r[i][l];
        }
        weights[i] += cost.u_weight[i] + cost.rate_weight[i];
        rest[i] = add_product(
            lanes,
            &rows,
            &value.xp[i],
            &sub_product(lanes, kx, &weights, &cost.s[i]),
        );
    }
    let mut xx = [[0.0; NX]; NX];
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
            &value.xp,
            &k,
            &add_product(lanes, &value.xx, &f, &[0.0; NX]),
        );
        let open = sub_product(lanes, cost.s, &k, &sub_product(lanes, kx, &g, &cost.q[j]));
        xx[j] = add_product(lanes, &rows, &column, &open);
    }
    let mut symmetric = xx;
    for j in 0..NX {
        symmetric[j] = symmetric_column(&xx, j);
    }
    symmetric
}

/// Backward step of a solve: costate and rate costate from k+1 to k; returns the feedforward input.
#[inline(always)]
pub(super) fn backward<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    gain: &Gain<NX, NU>,
    gradient: (&[f64; NX], &[f64; NU], &[f64; NU]),
    costate: &mut ([f64; NX], [f64; NU]),
) -> [f64; NU] {
    let (gx, gu, gr) = gradient;
    let (y, yu) = *costate;
    let mut ru = [0.0; NU];
    for i in 0..NU {
        ru[i] = gu[i] + gr[i] + yu[i];
    }
    let ru = add_product(lanes, &stage.bt, &y, &ru);
    let px = add_product(lanes, &stage.at, &y, gx);
    costate.0 = sub_product(lanes, &gain.kx, &ru, &px);
    let feedforward = add_product(lanes, &gain.inverse, &ru, &[0.0; NU]);
    for j in 0..NU {
        costate.1[j] = lanes.fma1(gain.rate[j], feedforward[j], -gr[j]);
    }
    feedforward
}

/// Forward step: the input step at k from the state step and the input step at k-1.
#[inline(always)]
pub(super) fn forward<L: Lanes, const NX: usize, const NU: usize>(
    lanes: L,
    stage: &Stage<NX, NU>,
    gain: &Gain<NX, NU>,
    feedforward: &[f64; NU],
    dx: &mut [f64; NX],
    dp: &[f64; NU],
) -> [f64; NU] {
    let mut weighted = [0.0; NU];
    for j in 0..NU {
        weighted[j] = gain.rate[j] * dp[j];
    }
    let mut du = add_product(lanes, &gain.inverse, &weighted, &[0.0; NU]);
    for i in 0..NU {
        du[i] -= feedforward[i] + dot(lanes, &gain.kx[i], dx);
    }
    let next = add_product(lanes, &stage.a, dx, &[0.0; NX]);
    *dx = add_product(lanes, &stage.b, &du, &next);
    du
}
