//! One stage of the Newton system, and the solves with its factorisation (`elimination`): a step backward for the
//! feedforward input and the costate, a step forward for input and state.

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
