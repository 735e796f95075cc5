//! All bounds on one kind of value: lower and upper side, soft or hard, and fixed components.
//!
//! Bounds that coincide leave no interior. Such a component is an equality v = target with multiplier y, kept by
//! the method of multipliers: weight omega, force y + omega (v - target), y moved to that force with each step.

use super::bounds::{self, Lane, Reach};
use super::kernel::Lanes;
use super::soft::{self, Price, SlackLane};
use crate::validation::coincide;

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
    /// The values.
    pub(super) v: Vec<[f64; 4]>,
    /// Their step.
    pub(super) dv: Vec<[f64; 4]>,
    /// Curvature added to each.
    pub(super) weight: Vec<[f64; 4]>,
    /// Curvature before the last `hold_active`.
    pub(super) last_weight: Vec<[f64; 4]>,
    /// How many of the first values that changed for, at most.
    pub(super) reweighted: usize,
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
    /// Kept by `save`.
    pub(super) kept_v: Vec<[f64; 4]>,
    /// Kept by `save`.
    pub(super) kept: [Vec<Lane>; 2],
    /// Kept by `save`.
    pub(super) kept_y: Vec<f64>,
    /// Weight of the fixed components.
    pub(super) omega: f64,
}

/// Signs of the lower and the upper side.
pub(super) const SIGN: [f64; 2] = [-1.0, 1.0];

impl Channel {
    /// Memory for `len` values; the arrays are padded to a multiple of four.
    pub(super) fn new(len: usize, price: Price) -> Self {
        let lanes = len.div_ceil(4);
        let zeros = vec![[0.0; 4]; lanes];
        let slacks = if price == Price::Hard {
            Vec::new()
        } else {
            vec![SlackLane::ONE; lanes]
        };
        Self {
            v: zeros.clone(),
            dv: zeros.clone(),
            weight: zeros.clone(),
            last_weight: zeros.clone(),
            reweighted: 0,
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

    /// Distances of all pairs of bounds.
    pub(super) fn widths(&self) -> impl Iterator<Item = f64> {
        let [lower, upper] = &self.sides;
        lower.iter().zip(upper).flat_map(|(low, high)| {
            let both = (0..4).filter(|&i| low.on[i] * high.on[i] != 0.0);
            both.map(|i| high.bound[i] + low.bound[i])
        })
    }

    /// Forgets the bounds, before new ones are entered.
    pub(super) fn clear(&mut self, price: Price) {
        self.fixed.clear();
        self.price = price;
        self.reweighted = 0;
        for side in 0..2 {
            if self.used[side] {
                self.sides[side].fill(Lane::OFF);
            }
            self.used[side] = false;
        }
    }

    /// Enters the bounds of value `index`; infinite ones are absent.
    #[inline]
    pub(super) fn bound(&mut self, index: usize, lower: f64, upper: f64) {
        if lower > f64::NEG_INFINITY || upper < f64::INFINITY {
            self.bound_finite(index, lower, upper);
        }
    }

    fn bound_finite(&mut self, index: usize, lower: f64, upper: f64) {
        if self.price == Price::Hard && coincide(lower, upper, 1.0) {
            self.fixed.push(Fixed {
                index,
                target: 0.5 * (lower + upper),
                y: 0.0,
            });
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

    /// Zero values, multipliers and slacks.
    pub(super) fn reset(&mut self) {
        self.v.fill([0.0; 4]);
        self.sides
            .iter_mut()
            .flatten()
            .for_each(|lane| lane.z = [0.0; 4]);
        self.slacks
            .iter_mut()
            .flatten()
            .for_each(|slack| slack.e = [0.0; 4]);
        self.fixed.iter_mut().for_each(|fixed| fixed.y = 0.0);
    }

    /// Number of complementarity products.
    pub(super) fn count(&self) -> f64 {
        let each = if let Price::Exact(_) = self.price {
            2.0
        } else {
            1.0
        };
        let lanes = self
            .sides
            .iter()
            .zip(self.used)
            .filter(|(_, used)| *used)
            .flat_map(|(side, _)| side);
        each * lanes.map(|lane| lane.on.iter().sum::<f64>()).sum::<f64>()
    }

    /// Sum of multiplier times distance from the bound, and of soft slacks times theirs.
    pub(super) fn gap(&self) -> f64 {
        let mut gap = 0.0;
        for side in 0..2 {
            for (l, lane) in self.sides[side].iter().enumerate() {
                for i in 0..4 {
                    gap += lane.on[i] * (lane.z[i] * (lane.s[i] - lane.r[i])).abs();
                    if let Price::Exact(_) = self.price {
                        let slack = &self.slacks[side][l];
                        gap += lane.on[i] * slack.e[i] * slack.nu[i];
                    }
                }
            }
        }
        let held = self.fixed.iter().map(|fixed| {
            let v = self.v[fixed.index / 4][fixed.index % 4];
            (fixed.y * (v - fixed.target)).abs()
        });
        gap + held.sum::<f64>()
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

    /// Corrector: forces from scratch, for products `target_mu` or for those at hand.
    #[inline(always)]
    pub(super) fn correct<L: Lanes>(&mut self, lanes: L, target_mu: Option<f64>) {
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

    /// The direction, affine or corrected, and how far it may go.
    #[inline(always)]
    pub(super) fn aim<L: Lanes>(&mut self, lanes: L, corrected: bool) -> Reach {
        let mut reach = Reach::FREE;
        for side in (0..2).filter(|&side| self.used[side]) {
            let (sign, edge) = (SIGN[side], &mut self.sides[side]);
            reach = reach.and(match self.price {
                Price::Hard if corrected => bounds::aim(lanes, edge, sign, &self.dv),
                Price::Hard => bounds::predict(lanes, edge, sign, &self.dv),
                price => soft::aim((edge, &mut self.slacks[side]), sign, price, &self.dv),
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
            *v = lanes.store4(lanes.fma4(alpha, lanes.load4(*dv), lanes.load4(*v)));
        }
        let mut gap = 0.0;
        for side in 0..2 {
            if self.used[side] {
                gap += bounds::advance(lanes, &mut self.sides[side], alpha);
                gap += soft::advance(
                    (&self.sides[side], &mut self.slacks[side]),
                    self.price,
                    alpha,
                );
            }
        }
        gap
    }
}
