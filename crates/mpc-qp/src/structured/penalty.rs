//! Multipliers as functions of the constraint values: the augmented Lagrangian that the careful pass minimises.
//!
//! With estimate y and weight omega, a violated or held inequality r <= 0 has z = max(0, y + omega r) (hard), the same cut off at
//! the price rho (exact penalty), or divided by 1 + omega / rho (quadratic penalty): in each case the maximiser of
//! z r - price*(z) - (z - y)^2 / (2 omega), so y = z exactly at a solution. The ellipsoid enters through the
//! convex function r = |M (x - center)| - 1. In the elastic problem soft constraints are free and y is zero.

use super::channel::{Channel, SIGN};
use super::cone::Cone;
use super::kernel::{Lanes, larger};
use super::soft::Price;

/// Weight of the augmented Lagrangian, and whether only violations count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Penalty {
    /// Weight.
    pub(super) omega: f64,
    /// True in the elastic problem: no cost, soft constraints free.
    pub(super) elastic: bool,
}

impl Penalty {
    /// Multiplier and its slope at residual r.
    fn law(&self, price: Price, y: f64, r: f64) -> (f64, f64) {
        let t = y + self.omega * r;
        match price {
            _ if t <= 0.0 || (self.elastic && price != Price::Hard) => (0.0, 0.0),
            Price::Hard => (t, self.omega),
            Price::Exact(rho) if t >= rho => (rho, 0.0),
            Price::Exact(_) => (t, self.omega),
            Price::Quadratic(rho) => {
                let factor = 1.0 / (1.0 + self.omega / rho);
                (factor * t, factor * self.omega)
            }
        }
    }
}

impl Channel {
    /// Weights and forces at the present values.
    pub(super) fn penalise(&mut self, penalty: Penalty) {
        self.omega = penalty.omega;
        self.weight.fill([0.0; 4]);
        self.force.fill([0.0; 4]);
        for side in (0..2).filter(|&side| self.used[side]) {
            for (l, lane) in self.sides[side].iter_mut().enumerate() {
                for i in 0..4 {
                    if lane.on[i] != 0.0 {
                        lane.r[i] = SIGN[side] * self.v[l][i] - lane.bound[i];
                        let (z, slope) = penalty.law(self.price, lane.z[i], lane.r[i]);
                        self.weight[l][i] += slope;
                        self.force[l][i] += SIGN[side] * z;
                    }
                }
            }
        }
        self.hold(true);
    }

    /// Zero multipliers, also after numbers that are not finite.
    pub(super) fn forget_multipliers(&mut self) {
        for lane in self.sides.iter_mut().flatten() {
            lane.z = [0.0; 4];
        }
        for fixed in &mut self.fixed {
            fixed.y = 0.0;
        }
    }

    /// Derivative along the step after the fraction `alpha` of it.
    pub(super) fn slope_along(&self, penalty: Penalty, alpha: f64) -> f64 {
        let mut sum = 0.0;
        for side in (0..2).filter(|&side| self.used[side]) {
            for (lane, dv) in self.sides[side].iter().zip(&self.dv) {
                for i in 0..4 {
                    if lane.on[i] != 0.0 {
                        let step = SIGN[side] * dv[i];
                        let r = lane.r[i] + alpha * step;
                        sum += step * penalty.law(self.price, lane.z[i], r).0;
                    }
                }
            }
        }
        for fixed in &self.fixed {
            let (l, i) = (fixed.index / 4, fixed.index % 4);
            let after = self.v[l][i] - fixed.target + alpha * self.dv[l][i];
            sum += self.dv[l][i] * (fixed.y + self.omega * after);
        }
        sum
    }

    /// Moves the values.
    pub(super) fn move_values(&mut self, alpha: f64) {
        for (v, dv) in self.v.iter_mut().zip(&self.dv) {
            for i in 0..4 {
                v[i] += alpha * dv[i];
            }
        }
    }

    /// Takes the multipliers of the present values as the estimates; returns the largest change over omega.
    pub(super) fn update_multipliers(&mut self, penalty: Penalty) -> f64 {
        let mut change: f64 = 0.0;
        for side in (0..2).filter(|&side| self.used[side]) {
            for (l, lane) in self.sides[side].iter_mut().enumerate() {
                for i in 0..4 {
                    if lane.on[i] != 0.0 {
                        let r = SIGN[side] * self.v[l][i] - lane.bound[i];
                        let z = penalty.law(self.price, lane.z[i], r).0;
                        change = larger((z - lane.z[i]).abs(), change);
                        lane.z[i] = z;
                    }
                }
            }
        }
        for fixed in &mut self.fixed {
            let step = penalty.omega * (self.v[fixed.index / 4][fixed.index % 4] - fixed.target);
            change = larger(step.abs(), change);
            fixed.y += step;
        }
        change / penalty.omega
    }
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

impl<const NX: usize> Cone<NX> {
    /// Adds curvature and force at x.
    pub(super) fn penalise<L: Lanes>(
        &self,
        lanes: L,
        x: &[f64; NX],
        penalty: Penalty,
        xx: &mut [[f64; NX]; NX],
        gx: &mut [f64; NX],
    ) {
        let offset = self.offset(x);
        let length = norm(&offset);
        let (z, slope) = penalty.law(self.price, self.z.head, length - 1.0);
        if z == 0.0 {
            return;
        }
        self.push_outward(lanes, &offset, (z, slope), Some(xx), gx);
    }

    /// Derivative along the step `dx` from x after the fraction `alpha` of it.
    pub(super) fn slope_along(
        &self,
        (x, dx): (&[f64; NX], &[f64; NX]),
        penalty: Penalty,
        alpha: f64,
    ) -> f64 {
        let mut after = *x;
        let mut ahead = *x;
        for i in 0..NX {
            after[i] += alpha * dx[i];
            ahead[i] += dx[i];
        }
        let (offset, from, to) = (self.offset(&after), self.offset(x), self.offset(&ahead));
        let length = norm(&offset);
        let z = penalty.law(self.price, self.z.head, length - 1.0).0;
        if z == 0.0 || length == 0.0 {
            return 0.0;
        }
        let along: f64 = (0..NX).map(|i| offset[i] * (to[i] - from[i])).sum();
        z * along / length
    }

    /// Takes the multiplier at x as the estimate; returns its change over omega.
    pub(super) fn update_multiplier(&mut self, x: &[f64; NX], penalty: Penalty) -> f64 {
        let offset = self.offset(x);
        let length = norm(&offset);
        let z = penalty.law(self.price, self.z.head, length - 1.0).0;
        let change = (z - self.z.head).abs() / penalty.omega;
        self.z.head = z;
        self.z.tail = offset.map(|entry| -z * entry / length.max(1e-300));
        self.e = (length - 1.0).max(0.0);
        self.place = self.place_of_multiplier();
        change
    }
}
