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
    for ((lane, weight), force) in side.iter_mut().zip(weight).zip(force) {
        for i in 0..4 {
            lane.inv[i] = 1.0 / lane.s[i];
            lane.w[i] = lane.on[i] * lane.z[i] * lane.inv[i];
            weight[i] += lane.w[i];
            force[i] = lanes.fma1(sign * lane.w[i], lane.r[i], force[i]);
        }
    }
}

/// Affine direction from the values' step.
#[inline(always)]
pub(super) fn predict<L: Lanes>(lanes: L, side: &mut [Lane], sign: f64, dv: &[[f64; 4]]) -> Reach {
    let mut ratio = [0.0; 4];
    let mut product = [0.0; 4];
    for (lane, dv) in side.iter_mut().zip(dv) {
        for i in 0..4 {
            let ds = -lane.on[i] * lanes.fma1(sign, dv[i], lane.r[i]);
            let dz = lanes.fma1(-lane.w[i], ds, -lane.on[i] * lane.z[i]);
            let change = ds * lane.inv[i];
            // dz/z = -1 - ds/s in the affine direction: no second division.
            ratio[i] = larger(ratio[i], larger(-change, lane.on[i] + change));
            product[i] = lanes.fma1(ds, dz, product[i]);
            lane.ds[i] = ds;
            lane.dz[i] = dz;
        }
    }
    reduce(ratio, product)
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
    for (lane, force) in side.iter_mut().zip(force) {
        for i in 0..4 {
            let target = lane.on[i] * lanes.fma1(-lane.ds[i], lane.dz[i], target_mu) * lane.inv[i];
            force[i] = lanes.fma1(sign, lanes.fma1(lane.w[i], lane.r[i], target), force[i]);
            lane.target[i] = target;
        }
    }
}

/// Corrected direction from the values' step.
#[inline(always)]
pub(super) fn aim<L: Lanes>(lanes: L, side: &mut [Lane], sign: f64, dv: &[[f64; 4]]) -> Reach {
    let mut ratio = [0.0; 4];
    let mut product = [0.0; 4];
    for (lane, dv) in side.iter_mut().zip(dv) {
        for i in 0..4 {
            let ds = -lane.on[i] * lanes.fma1(sign, dv[i], lane.r[i]);
            let dz = lanes.fma1(
                -lane.w[i],
                ds,
                lanes.fma1(-lane.on[i], lane.z[i], lane.target[i]),
            );
            ratio[i] = larger(ratio[i], larger(-ds * lane.inv[i], -dz / lane.z[i]));
            product[i] = lanes.fma1(ds, dz, product[i]);
            lane.ds[i] = ds;
            lane.dz[i] = dz;
        }
    }
    reduce(ratio, product)
}

/// Moves along the direction; returns the new sum of s z.
#[inline(always)]
pub(super) fn advance<L: Lanes>(lanes: L, side: &mut [Lane], alpha: f64) -> f64 {
    let mut gap = [0.0; 4];
    for lane in side {
        for i in 0..4 {
            lane.s[i] = lanes.fma1(alpha, lane.ds[i], lane.s[i]);
            lane.z[i] = lanes.fma1(alpha, lane.dz[i], lane.z[i]);
            lane.r[i] *= 1.0 - alpha;
            gap[i] = lanes.fma1(lane.on[i] * lane.s[i], lane.z[i], gap[i]);
        }
    }
    (gap[0] + gap[1]) + (gap[2] + gap[3])
}

#[inline(always)]
fn reduce(ratio: [f64; 4], product: [f64; 4]) -> Reach {
    Reach {
        ratio: larger(larger(ratio[0], ratio[1]), larger(ratio[2], ratio[3])),
        product: (product[0] + product[1]) + (product[2] + product[3]),
    }
}
