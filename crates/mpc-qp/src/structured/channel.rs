//! All bounds on one kind of value: lower and upper side, soft or hard, and fixed components.
//!
//! Bounds that coincide leave no interior. Such a component is an equality v = target with multiplier y, kept by
//! the method of multipliers: weight omega, force y + omega (v - target), y moved to that force with each step.

use super::bounds::{self, Lane, Reach};
use super::kernel::Lanes;
use super::soft::{self, Price, SlackLane};

/// A component whose bounds coincide.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fixed {
    /// Position among the values.
    pub(super) index: usize,
    /// The value to hold.
    pub(super) target: f64,
    /// Multiplier, of either sign.
    pub(super) y: f64,
}

/// Values of one kind over the horizon, with their bounds.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    /// How many values (the arrays are longer, to a multiple of four).
    pub(super) len: usize,
    /// The values.
    pub(super) v: Vec<[f64; 4]>,
    /// Their step.
    pub(super) dv: Vec<[f64; 4]>,
    /// Curvature added to each.
    pub(super) weight: Vec<[f64; 4]>,
    /// Gradient added to each.
    pub(super) force: Vec<[f64; 4]>,
    /// Lower and upper side.
    pub(super) sides: [Vec<Lane>; 2],
    /// Their slacks; empty if hard.
    pub(super) slacks: [Vec<SlackLane>; 2],
    /// Whether a side has any finite bound.
    pub(super) used: [bool; 2],
    /// Price of the slacks.
    pub(super) price: Price,
    /// Components with coinciding bounds.
    pub(super) fixed: Vec<Fixed>,
    kept_v: Vec<[f64; 4]>,
    kept: [Vec<Lane>; 2],
    kept_y: Vec<f64>,
    /// Weight of the fixed components.
    pub(super) omega: f64,
}

/// Distance of the two bounds, or the size of the only one.
fn width(lane: &Lane, opposite: &Lane, i: usize) -> f64 {
    if opposite.on[i] != 0.0 { lane.bound[i] + opposite.bound[i] } else { 1.0 + lane.bound[i].abs() }
}

const SIGN: [f64; 2] = [-1.0, 1.0];

impl Channel {
    /// Memory for `len` values.
    pub(super) fn new(len: usize, price: Price) -> Self {
        let lanes = len.div_ceil(4);
        let zeros = vec![[0.0; 4]; lanes];
        let slacks = if price == Price::Hard { Vec::new() } else { vec![SlackLane::ONE; lanes] };
        Self {
            len,
            v: zeros.clone(),
            dv: zeros.clone(),
            weight: zeros.clone(),
            force: zeros.clone(),
            kept_v: zeros,
            kept: [vec![Lane::OFF; lanes], vec![Lane::OFF; lanes]],
            kept_y: Vec::with_capacity(len),
            sides: [vec![Lane::OFF; lanes], vec![Lane::OFF; lanes]],
            slacks: [slacks.clone(), slacks],
            used: [false; 2],
            price,
            fixed: Vec::with_capacity(len),
            omega: 0.0,
        }
    }

    /// True if it has any bound or fixed component.
    pub(super) fn any(&self) -> bool {
        self.used[0] || self.used[1] || !self.fixed.is_empty()
    }

    /// Forgets the bounds, before new ones are entered.
    pub(super) fn clear(&mut self, price: Price) {
        self.fixed.clear();
        self.price = price;
        for side in 0..2 {
            if self.used[side] {
                self.sides[side].fill(Lane::OFF);
            }
            self.used[side] = false;
        }
    }

    /// Enters the bounds of value `index`; infinite ones are absent.
    pub(super) fn bound(&mut self, index: usize, lower: f64, upper: f64) {
        let hard = self.price == Price::Hard;
        if hard && lower.is_finite() && upper.is_finite() && upper - lower <= 1e-11 * (1.0 + lower.abs()) {
            self.fixed.push(Fixed { index, target: 0.5 * (lower + upper), y: 0.0 });
            return;
        }
        for (side, bound) in [(0, -lower), (1, upper)] {
            if bound < f64::INFINITY {
                let lane = &mut self.sides[side][index / 4];
                lane.on[index % 4] = 1.0;
                lane.bound[index % 4] = bound;
                self.used[side] = true;
            }
        }
    }

    /// Number of complementarity products.
    pub(super) fn count(&self) -> f64 {
        let each = if let Price::Exact(_) = self.price { 2.0 } else { 1.0 };
        let lanes = self.sides.iter().zip(self.used).filter(|(_, used)| *used).flat_map(|(side, _)| side);
        each * lanes.map(|lane| lane.on.iter().sum::<f64>()).sum::<f64>()
    }

    /// Predictor: weights and affine forces from scratch.
    #[inline(always)]
    pub(super) fn weigh<L: Lanes>(&mut self, lanes: L) {
        self.weight.fill([0.0; 4]);
        self.force.fill([0.0; 4]);
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            let (weight, force) = (&mut self.weight, &mut self.force);
            if self.price == Price::Hard {
                bounds::weigh(lanes, &mut self.sides[side], SIGN[side], weight, force);
            } else {
                let both = (&mut self.sides[side][..], &mut self.slacks[side][..]);
                soft::weigh(both, SIGN[side], self.price, weight, force);
            }
        }
        self.hold(true);
    }

    pub(super) fn hold(&mut self, with_weight: bool) {
        for fixed in &self.fixed {
            let (lane, i) = (fixed.index / 4, fixed.index % 4);
            if with_weight {
                self.weight[lane][i] += self.omega;
            }
            self.force[lane][i] += fixed.y + self.omega * (self.v[lane][i] - fixed.target);
        }
    }

    /// Affine direction.
    #[inline(always)]
    pub(super) fn predict<L: Lanes>(&mut self, lanes: L) -> Reach {
        let mut reach = Reach::FREE;
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            reach = reach.and(if self.price == Price::Hard {
                bounds::predict(lanes, &mut self.sides[side], SIGN[side], &self.dv)
            } else {
                soft::aim((&mut self.sides[side], &mut self.slacks[side]), SIGN[side], self.price, &self.dv)
            });
        }
        reach
    }

    /// Corrector: forces from scratch.
    #[inline(always)]
    pub(super) fn correct<L: Lanes>(&mut self, lanes: L, target_mu: f64) {
        self.force.fill([0.0; 4]);
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            let force = &mut self.force;
            if self.price == Price::Hard {
                bounds::correct(lanes, &mut self.sides[side], SIGN[side], target_mu, force);
            } else {
                let both = (&mut self.sides[side][..], &mut self.slacks[side][..]);
                soft::correct(both, SIGN[side], self.price, target_mu, force);
            }
        }
        self.hold(false);
    }

    /// Corrected direction.
    #[inline(always)]
    pub(super) fn aim<L: Lanes>(&mut self, lanes: L) -> Reach {
        let mut reach = Reach::FREE;
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            reach = reach.and(if self.price == Price::Hard {
                bounds::aim(lanes, &mut self.sides[side], SIGN[side], &self.dv)
            } else {
                soft::aim((&mut self.sides[side], &mut self.slacks[side]), SIGN[side], self.price, &self.dv)
            });
        }
        reach
    }

    /// Moves values, slacks and multipliers; returns the sum of the complementarity products.
    #[inline(always)]
    pub(super) fn advance<L: Lanes>(&mut self, lanes: L, alpha: f64) -> f64 {
        for fixed in &mut self.fixed {
            let (lane, i) = (fixed.index / 4, fixed.index % 4);
            let residual = self.v[lane][i] - fixed.target;
            fixed.y += alpha * self.omega * (residual + self.dv[lane][i]);
        }
        for (v, dv) in self.v.iter_mut().zip(&self.dv) {
            for i in 0..4 {
                v[i] = lanes.fma1(alpha, dv[i], v[i]);
            }
        }
        let mut gap = 0.0;
        for side in 0..2 {
            if self.used[side] {
                gap += bounds::advance(lanes, &mut self.sides[side], alpha);
                gap += soft::advance((&self.sides[side], &mut self.slacks[side]), self.price, alpha);
            }
        }
        gap
    }

    /// Guesses from an interior-point iterate: held where the multiplier outweighs the slack.
    pub(super) fn guess_from_iterate(&mut self) {
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            for (l, lane) in self.sides[side].iter_mut().enumerate() {
                for i in 0..4 {
                    // Compare the relative changes that complementarity forces on each: scale-free.
                    let held = lane.on[i] != 0.0 && lane.ds[i] * lane.z[i] < lane.dz[i] * lane.s[i];
                    lane.place[i] = match self.price {
                        _ if !held => 0.0,
                        Price::Hard => 1.0,
                        Price::Quadratic(_) => 2.0,
                        Price::Exact(_) => {
                            let slack = &self.slacks[side][l];
                            if slack.e[i] * lane.z[i] > lane.s[i].max(1e-12) * slack.nu[i] { 2.0 } else { 1.0 }
                        }
                    };
                    if !held {
                        lane.z[i] = 0.0;
                    }
                }
            }
        }
    }

    /// Keeps values, multipliers and slacks, to come back to them.
    pub(super) fn save(&mut self) {
        self.kept_v.copy_from_slice(&self.v);
        for side in 0..2 {
            if self.used[side] {
                self.kept[side].copy_from_slice(&self.sides[side]);
            }
        }
        self.kept_y.clear();
        self.kept_y.extend(self.fixed.iter().map(|fixed| fixed.y));
    }

    /// Comes back to what was kept.
    pub(super) fn restore(&mut self) {
        self.v.copy_from_slice(&self.kept_v);
        for side in 0..2 {
            if self.used[side] {
                self.sides[side].copy_from_slice(&self.kept[side]);
            }
        }
        for (fixed, y) in self.fixed.iter_mut().zip(&self.kept_y) {
            fixed.y = *y;
        }
    }

    /// Slacks of soft bounds from the values, after an active-set answer.
    pub(super) fn finish_soft(&mut self) {
        for side in 0..2 {
            for (l, slack) in self.slacks[side].iter_mut().enumerate() {
                let lane = &self.sides[side][l];
                for i in 0..4 {
                    slack.e[i] = (SIGN[side] * self.v[l][i] - lane.bound[i]).max(0.0) * lane.on[i];
                }
            }
        }
    }

    /// Multiplies all multipliers.
    pub(super) fn scale_multipliers(&mut self, factor: f64) {
        for side in 0..2 {
            if self.used[side] {
                self.sides[side].iter_mut().for_each(|lane| lane.z.iter_mut().for_each(|z| *z *= factor));
            }
        }
        self.fixed.iter_mut().for_each(|fixed| fixed.y *= factor);
    }

    /// Forces of the present multipliers.
    pub(super) fn present(&mut self) {
        self.force.fill([0.0; 4]);
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            for (force, lane) in self.force.iter_mut().zip(&self.sides[side]) {
                for i in 0..4 {
                    force[i] += SIGN[side] * lane.on[i] * lane.z[i];
                }
            }
        }
        for fixed in &self.fixed {
            self.force[fixed.index / 4][fixed.index % 4] += fixed.y;
        }
    }

    /// Weights `rho / width^2` toward the middle of every pair of bounds, as forces at zero values: for the starting point.
    pub(super) fn center(&mut self, rho: f64) {
        self.weight.fill([0.0; 4]);
        self.force.fill([0.0; 4]);
        let [lower, upper] = &self.sides;
        for (l, (low, high)) in lower.iter().zip(upper).enumerate() {
            for i in 0..4 {
                if low.on[i] * high.on[i] != 0.0 {
                    let width = high.bound[i] + low.bound[i];
                    let weight = rho / (width * width).max(1e-16);
                    self.weight[l][i] = weight;
                    self.force[l][i] = -0.5 * weight * (high.bound[i] - low.bound[i]);
                }
            }
        }
        for fixed in &self.fixed {
            self.weight[fixed.index / 4][fixed.index % 4] = self.omega;
            self.force[fixed.index / 4][fixed.index % 4] = -self.omega * fixed.target;
        }
    }

    /// Slacks and multipliers at the present values: slack at least `least` times the width, products `mu`.
    pub(super) fn enter(&mut self, least: f64, mu: f64) {
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            for l in 0..self.v.len() {
                for i in 0..4 {
                    let opposite = self.sides[1 - side][l];
                    let v = self.v[l][i];
                    let lane = &mut self.sides[side][l];
                    if lane.on[i] == 0.0 {
                        (lane.s[i], lane.z[i], lane.r[i]) = (1.0, 1.0, 0.0);
                        continue;
                    }
                    let slack = lane.bound[i] - SIGN[side] * v;
                    lane.s[i] = slack.max(least * width(lane, &opposite, i)).max(1e-8);
                    lane.z[i] = mu / lane.s[i];
                    lane.r[i] = lane.s[i] - slack;
                }
            }
            if self.price != Price::Hard {
                soft::enter(&mut self.sides[side], &mut self.slacks[side], self.price);
            }
        }
    }

    /// Sum of multiplier times width over the positive multipliers, and their number: the size of the products to start from.
    pub(super) fn product_scale(&self) -> (f64, f64) {
        let (mut sum, mut count) = (0.0, 0.0);
        for side in 0..2 {
            if self.used[side] {
                for (lane, opposite) in self.sides[side].iter().zip(&self.sides[1 - side]) {
                    for i in 0..4 {
                        if lane.place[i] > 0.0 && lane.z[i] > 0.0 {
                            sum += lane.z[i] * width(lane, opposite, i);
                            count += 1.0;
                        }
                    }
                }
            }
        }
        (sum, count)
    }

    /// Cancels a gradient with the multiplier of the bound that it pushes against, if that bound is finite.
    pub(super) fn absorb(&mut self, index: usize, gradient: f64) {
        let (l, i) = (index / 4, index % 4);
        if let Some(fixed) = self.fixed.iter_mut().find(|fixed| fixed.index == index) {
            fixed.y -= gradient;
            return;
        }
        let [lower, upper] = &mut self.sides;
        let (push, relief) = if gradient > 0.0 { (&mut lower[l], &mut upper[l]) } else { (&mut upper[l], &mut lower[l]) };
        if push.on[i] != 0.0 {
            push.z[i] += gradient.abs();
            let both = relief.on[i] * push.z[i].min(relief.z[i]);
            push.z[i] -= both;
            relief.z[i] -= both;
        }
    }

    /// Largest residual of the fixed components.
    pub(super) fn fixed_residual(&self) -> f64 {
        self.fixed.iter().map(|f| (self.v[f.index / 4][f.index % 4] - f.target).abs()).fold(0.0, f64::max)
    }
}
