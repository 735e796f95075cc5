//! One-sided inequalities in bulk: slack and multiplier of every bound of one kind over the horizon.
//!
//! A side stands for sign v_i <= bound_i, i over the horizon, v being the inputs, their rates, the
//! states or the rows' values. With slack s and multiplier z the Newton step of s z = target is
//! ds = -(r + sign dv), dz = (target - s z - z ds) / s, r = sign v - bound + s,
//! so the side adds the weight z / s to the curvature in v and sign (target / s + r z / s) to the gradient.
//! Four neighbours are one lane; an infinite bound is switched off by `on = 0`, which keeps s = z = 1.

use super::kernel::{Lanes, larger};

/// Four inequalities.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lane {
    /// One where the bound is finite, zero where it is absent.
    pub(super) on: [f64; 4],
    /// sign times the bound.
    pub(super) bound: [f64; 4],
    /// Slack, positive.
    pub(super) s: [f64; 4],
    /// Multiplier, positive.
    pub(super) z: [f64; 4],
    /// Residual sign v - bound + s.
    pub(super) r: [f64; 4],
    pub(super) ds: [f64; 4],
    pub(super) dz: [f64; 4],
    pub(super) inv: [f64; 4],
    pub(super) w: [f64; 4],
    /// Place in the active-set guess, see `active`.
    pub(super) place: [f64; 4],
    pub(super) target: [f64; 4],
}

impl Lane {
    /// Four absent bounds.
    pub(super) const OFF: Self = Self {
        on: [0.0; 4],
        bound: [0.0; 4],
        s: [1.0; 4],
        z: [1.0; 4],
        r: [0.0; 4],
        ds: [0.0; 4],
        dz: [0.0; 4],
        inv: [1.0; 4],
        w: [0.0; 4],
        place: [0.0; 4],
        target: [0.0; 4],
    };

    /// Bound i, infinite if absent.
    #[inline(always)]
    pub(super) fn limit(&self, i: usize) -> f64 {
        if self.on[i] == 0.0 {
            f64::INFINITY
        } else {
            self.bound[i]
        }
    }
}

/// What a direction allows: the largest relative decrease and the second-order product.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Largest of -ds/s and -dz/z; the longest step is its reciprocal.
    pub(super) ratio: f64,
    /// Sum of ds dz.
    pub(super) product: f64,
}

impl Reach {
    /// No constraint.
    pub(super) const FREE: Self = Self {
        ratio: 0.0,
        product: 0.0,
    };

    /// Both.
    #[inline(always)]
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            ratio: larger(self.ratio, other.ratio),
            product: self.product + other.product,
        }
    }
}

/// Weights and affine forces of the predictor, added to those of the channel.
#[inline(always)]
pub(super) fn weigh<L: Lanes>(
    lanes: L,
    side: &mut [Lane],
    sign: f64,
    weight: &mut [[f64; 4]],
    force: &mut [[f64; 4]],
) {
    let (one, sign) = (lanes.load4([1.0; 4]), lanes.load4([sign; 4]));
    for ((lane, weight), force) in side.iter_mut().zip(weight).zip(force) {
        let inv = lanes.div4(one, lanes.load4(lane.s));
        let w = lanes.mul4(lanes.mul4(lanes.load4(lane.on), lanes.load4(lane.z)), inv);
        let pull = lanes.mul4(sign, w);
        *weight = lanes.store4(lanes.add4(lanes.load4(*weight), w));
        *force = lanes.store4(lanes.muladd4(pull, lanes.load4(lane.r), lanes.load4(*force)));
        (lane.inv, lane.w) = (lanes.store4(inv), lanes.store4(w));
    }
}

/// Affine direction from the values' step.
#[inline(always)]
pub(super) fn predict<L: Lanes>(lanes: L, side: &mut [Lane], sign: f64, dv: &[[f64; 4]]) -> Reach {
    let (mut ratio, mut product) = (lanes.load4([0.0; 4]), lanes.load4([0.0; 4]));
    for (lane, dv) in side.iter_mut().zip(dv) {
        let on = lanes.load4(lane.on);
        let off = lanes.neg4(on);
        let ds = lanes.mul4(off, lanes.fma4(sign, lanes.load4(*dv), lanes.load4(lane.r)));
        let spent = lanes.mul4(off, lanes.load4(lane.z));
        let dz = lanes.muladd4(lanes.neg4(lanes.load4(lane.w)), ds, spent);
        let change = lanes.mul4(ds, lanes.load4(lane.inv));
        // dz/z = -1 - ds/s in the affine direction: no second division.
        let largest = lanes.larger4(lanes.neg4(change), lanes.add4(on, change));
        ratio = lanes.larger4(ratio, largest);
        product = lanes.muladd4(ds, dz, product);
        (lane.ds, lane.dz) = (lanes.store4(ds), lanes.store4(dz));
    }
    reduce(lanes.store4(ratio), lanes.store4(product))
}

/// Forces of the corrector: complementarity products aim at `target_mu` less the predictor's second-order term, or stay what they are
/// if there is none.
#[inline(always)]
pub(super) fn correct<L: Lanes>(
    lanes: L,
    side: &mut [Lane],
    sign: f64,
    target_mu: Option<f64>,
    force: &mut [[f64; 4]],
) {
    let Some(target_mu) = target_mu else {
        for (lane, force) in side.iter_mut().zip(force) {
            for i in 0..4 {
                lane.target[i] = lane.on[i] * lane.z[i];
                let z = lanes.fma1(lane.w[i], lane.r[i], lane.target[i]);
                force[i] = lanes.fma1(sign, z, force[i]);
            }
        }
        return;
    };
    let target_mu = lanes.load4([target_mu; 4]);
    for (lane, force) in side.iter_mut().zip(force) {
        let (ds, dz) = (lanes.load4(lane.ds), lanes.load4(lane.dz));
        let aim = lanes.muladd4(lanes.neg4(ds), dz, target_mu);
        let target = lanes.mul4(lanes.mul4(lanes.load4(lane.on), aim), lanes.load4(lane.inv));
        let z = lanes.muladd4(lanes.load4(lane.w), lanes.load4(lane.r), target);
        *force = lanes.store4(lanes.fma4(sign, z, lanes.load4(*force)));
        lane.target = lanes.store4(target);
    }
}

/// Corrected direction from the values' step.
#[inline(always)]
pub(super) fn aim<L: Lanes>(lanes: L, side: &mut [Lane], sign: f64, dv: &[[f64; 4]]) -> Reach {
    let (mut ratio, mut product) = (lanes.load4([0.0; 4]), lanes.load4([0.0; 4]));
    for (lane, dv) in side.iter_mut().zip(dv) {
        let (off, z) = (lanes.neg4(lanes.load4(lane.on)), lanes.load4(lane.z));
        let ds = lanes.mul4(off, lanes.fma4(sign, lanes.load4(*dv), lanes.load4(lane.r)));
        let aim = lanes.muladd4(off, z, lanes.load4(lane.target));
        let dz = lanes.muladd4(lanes.neg4(lanes.load4(lane.w)), ds, aim);
        let slack = lanes.mul4(lanes.neg4(ds), lanes.load4(lane.inv));
        let largest = lanes.larger4(slack, lanes.div4(lanes.neg4(dz), z));
        ratio = lanes.larger4(ratio, largest);
        product = lanes.muladd4(ds, dz, product);
        (lane.ds, lane.dz) = (lanes.store4(ds), lanes.store4(dz));
    }
    reduce(lanes.store4(ratio), lanes.store4(product))
}

/// Moves along the direction; returns the new sum of s z.
#[inline(always)]
pub(super) fn advance<L: Lanes>(lanes: L, side: &mut [Lane], alpha: f64) -> f64 {
    let mut gap = lanes.load4([0.0; 4]);
    let left = lanes.load4([1.0 - alpha; 4]);
    for lane in side {
        let s = lanes.fma4(alpha, lanes.load4(lane.ds), lanes.load4(lane.s));
        let z = lanes.fma4(alpha, lanes.load4(lane.dz), lanes.load4(lane.z));
        gap = lanes.muladd4(lanes.mul4(lanes.load4(lane.on), s), z, gap);
        lane.r = lanes.store4(lanes.mul4(lanes.load4(lane.r), left));
        (lane.s, lane.z) = (lanes.store4(s), lanes.store4(z));
    }
    let gap = lanes.store4(gap);
    (gap[0] + gap[1]) + (gap[2] + gap[3])
}

#[inline(always)]
fn reduce(ratio: [f64; 4], product: [f64; 4]) -> Reach {
    Reach {
        ratio: larger(larger(ratio[0], ratio[1]), larger(ratio[2], ratio[3])),
        product: (product[0] + product[1]) + (product[2] + product[3]),
    }
}
