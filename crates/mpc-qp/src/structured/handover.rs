//! What passes between the phases of a solve: starting slacks and multipliers, guesses, kept iterates, rays.

use super::active::{BEYOND, HELD, OUTSIDE};
use super::bounds::Lane;
use super::channel::{Channel, SIGN};
use super::kernel::larger;
use super::soft::{self, Price};

/// Distance of the two bounds, or the size of the only one.
pub(super) fn width(lane: &Lane, opposite: &Lane, i: usize) -> f64 {
    if opposite.on[i] != 0.0 {
        lane.bound[i] + opposite.bound[i]
    } else {
        1.0 + lane.bound[i].abs()
    }
}

impl Channel {
    /// Guesses from an interior-point iterate: held where the multiplier outweighs the slack. True if the guess is not the one before.
    pub(super) fn guess_from_iterate(&mut self) -> bool {
        let mut changed = false;
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            for (l, lane) in self.sides[side].iter_mut().enumerate() {
                for i in 0..4 {
                    // Compare the relative changes that complementarity forces on each: scale-free.
                    let held = lane.on[i] != 0.0 && lane.ds[i] * lane.z[i] < lane.dz[i] * lane.s[i];
                    let place = match self.price {
                        _ if !held => OUTSIDE,
                        Price::Hard => HELD,
                        Price::Quadratic(_) => BEYOND,
                        Price::Exact(_) => {
                            let slack = &self.slacks[side][l];
                            if slack.e[i] * lane.z[i] > lane.s[i].max(1e-12) * slack.nu[i] {
                                BEYOND
                            } else {
                                HELD
                            }
                        }
                    };
                    changed |= place != lane.place[i];
                    lane.place[i] = place;
                }
            }
        }
        changed
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
                self.sides[side]
                    .iter_mut()
                    .for_each(|lane| lane.z.iter_mut().for_each(|z| *z *= factor));
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

    /// Weights `rho / width^2` toward the middle of every pair of bounds, as forces at zero values: for the starting point. A soft equality has no
    /// width, and must not weigh more than all the inputs together.
    pub(super) fn center(&mut self, rho: f64) {
        let least = if self.price == Price::Hard { 1e-8 } else { 1.0 };
        self.weight.fill([0.0; 4]);
        self.force.fill([0.0; 4]);
        let [lower, upper] = &self.sides;
        let terms = self.weight.iter_mut().zip(&mut self.force);
        if rho > 0.0 && self.used == [true; 2] {
            for ((weight, force), (low, high)) in terms.zip(lower.iter().zip(upper)) {
                for i in 0..4 {
                    let width = larger(high.bound[i] + low.bound[i], least);
                    let both = rho * low.on[i] * high.on[i];
                    weight[i] = both / (width * width);
                    force[i] = -0.5 * weight[i] * (high.bound[i] - low.bound[i]);
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
            let [lower, upper] = &mut self.sides;
            let (near, far) = if side == 0 {
                (lower, upper)
            } else {
                (upper, lower)
            };
            for ((lane, opposite), v) in near.iter_mut().zip(far).zip(&self.v) {
                for i in 0..4 {
                    let slack = lane.bound[i] - SIGN[side] * v[i];
                    let room = larger(least * width(lane, opposite, i), 1e-8);
                    let s = larger(slack, room);
                    // An absent bound keeps s = z = 1.
                    let on = lane.on[i] != 0.0;
                    lane.s[i] = if on { s } else { 1.0 };
                    lane.z[i] = if on { mu / s } else { 1.0 };
                    lane.r[i] = if on { s - slack } else { 0.0 };
                }
            }
            if self.price != Price::Hard {
                soft::enter(
                    &mut self.sides[side],
                    &mut self.slacks[side],
                    self.price,
                    mu,
                );
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

    /// Sum of violation times the multiplier that its price gives it over the soft bounds that the present values violate, and their number.
    pub(super) fn priced_products(&self) -> (f64, f64) {
        let (mut sum, mut count) = (0.0, 0.0);
        for side in (0..2).filter(|&side| self.used[side]) {
            for (lane, v) in self.sides[side].iter().zip(&self.v) {
                for i in 0..4 {
                    let violation = lane.on[i] * (SIGN[side] * v[i] - lane.bound[i]);
                    let multiplier = match self.price {
                        Price::Hard => return (0.0, 0.0),
                        Price::Exact(rho) => rho,
                        Price::Quadratic(rho) => rho * violation,
                    };
                    sum += multiplier * violation.max(0.0);
                    count += f64::from(u8::from(violation > 0.0));
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
        let (push, relief) = if gradient > 0.0 {
            (&mut lower[l], &mut upper[l])
        } else {
            (&mut upper[l], &mut lower[l])
        };
        if push.on[i] != 0.0 {
            push.z[i] += gradient.abs();
            let both = relief.on[i] * push.z[i].min(relief.z[i]);
            push.z[i] -= both;
            relief.z[i] -= both;
        }
    }

    /// Largest residual of the fixed components.
    pub(super) fn fixed_residual(&self) -> f64 {
        self.fixed
            .iter()
            .map(|f| (self.v[f.index / 4][f.index % 4] - f.target).abs())
            .fold(0.0, f64::max)
    }
}
