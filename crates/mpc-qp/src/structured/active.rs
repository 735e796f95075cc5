//! Active-set sweeps: guess which bounds hold with equality, solve one equality-constrained problem, correct the guess.
//!
//! A bound in the guess is held by the method of multipliers: weight omega, force z + omega r with r = sign v - bound,
//! and z moves to z + omega (r + sign dv), computed from the step so that omega never multiplies a rounding error of v. A bound
//! outside the guess has z = 0. The set that the answer asks for (multiplier positive, or bound violated) is the next guess:
//! a primal-dual active-set (semismooth Newton) method (Hintermueller, Ito, Kunisch, 2003). It may cycle; the caller
//! limits the sweeps and falls back to the interior point. A soft bound that is violated has z = rho r (quadratic price)
//! or z = rho (exact price).

use super::bounds::Lane;
use super::channel::{Channel, SIGN};
use super::kernel::{Lanes, larger};
use super::soft::Price;

/// What an active-set sweep found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Verdict {
    /// Bounds whose place in the guess was wrong.
    pub(super) changes: usize,
    /// Whether the ellipsoid's linearisation was too coarse.
    pub(super) rough: bool,
    /// Largest distance of a held value from its bound.
    pub(super) distance: f64,
    /// Sum of multiplier times distance over the held values.
    pub(super) gap: f64,
}

impl Verdict {
    /// Both.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            changes: self.changes + other.changes,
            rough: self.rough || other.rough,
            distance: larger(self.distance, other.distance),
            gap: self.gap + other.gap,
        }
    }
}

/// Lane's place in the guess: outside, held at the bound, or beyond a soft bound.
pub(super) const OUTSIDE: f64 = 0.0;
pub(super) const HELD: f64 = 1.0;
pub(super) const BEYOND: f64 = 2.0;
/// Outside, and met by the clipped feedback.
pub(super) const MET: f64 = -1.0;

/// Violation of a bound, relative to one and the bound, that may be rounding.
pub(super) const ROUNDING: f64 = 1e-12;

impl Channel {
    /// Guesses that no bound is active.
    pub(super) fn guess_nothing(&mut self) {
        for side in (0..2).filter(|&side| self.used[side]) {
            for lane in &mut self.sides[side] {
                (lane.place, lane.z) = ([OUTSIDE; 4], [0.0; 4]);
            }
        }
    }

    /// Guesses from the present values: a violated bound is held.
    pub(super) fn guess_from_values(&mut self) {
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            let beyond = if self.price == Price::Hard {
                HELD
            } else {
                BEYOND
            };
            for (lane, v) in self.sides[side].iter_mut().zip(&self.v) {
                for i in 0..4 {
                    let violated = lane.on[i] != 0.0 && SIGN[side] * v[i] > lane.bound[i];
                    lane.place[i] = if violated { beyond } else { OUTSIDE };
                    lane.z[i] = 0.0;
                }
            }
        }
    }

    /// Guesses from the present multipliers: a positive one is held.
    pub(super) fn guess_from_multipliers(&mut self) {
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            for lane in &mut self.sides[side] {
                for i in 0..4 {
                    lane.place[i] = match self.price {
                        _ if lane.on[i] == 0.0 || lane.z[i] <= 0.0 => OUTSIDE,
                        Price::Quadratic(_) => BEYOND,
                        Price::Exact(rho) if lane.z[i] >= (1.0 - 1e-9) * rho => BEYOND,
                        _ => HELD,
                    };
                }
            }
        }
    }

    /// Weights and forces of the guess.
    #[inline(always)]
    pub(super) fn hold_active<L: Lanes>(&mut self, lanes: L) {
        std::mem::swap(&mut self.weight, &mut self.last_weight);
        self.weight.fill([0.0; 4]);
        self.force.fill([0.0; 4]);
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            let sign = SIGN[side];
            let places = self.sides[side]
                .iter_mut()
                .zip(&self.v)
                .zip(&mut self.weight)
                .zip(&mut self.force);
            if self.price == Price::Hard {
                let signs = lanes.load4([sign; 4]);
                for (((lane, v), weight), force) in places {
                    let (place, bound) = (lanes.load4(lane.place), lanes.load4(lane.bound));
                    let r = lanes.fma4(sign, lanes.load4(*v), lanes.neg4(bound));
                    let pull = lanes.fma4(self.omega, r, lanes.load4(lane.z));
                    let way = lanes.mul4(signs, place);
                    lane.r = lanes.store4(r);
                    *weight = lanes.store4(lanes.fma4(self.omega, place, lanes.load4(*weight)));
                    *force = lanes.store4(lanes.muladd4(way, pull, lanes.load4(*force)));
                }
            } else {
                for (((lane, v), weight), force) in places {
                    for i in 0..4 {
                        lane.r[i] = sign * v[i] - lane.bound[i];
                        let (slope, z) = soft_law(lane, i, self.price, self.omega);
                        weight[i] += slope;
                        force[i] += sign * (z + slope * lane.r[i]);
                    }
                }
            }
        }
        self.hold(true);
        let mut weights = self.weight.iter().zip(&self.last_weight);
        let last = weights.rposition(|(new, old)| new != old);
        self.reweighted = last.map_or(0, |lane| 4 * (lane + 1));
    }

    /// Judges the guess after the step `dv`, corrects it, and moves the values.
    #[inline(always)]
    pub(super) fn settle<L: Lanes>(&mut self, lanes: L) -> Verdict {
        let mut verdict = Verdict::default();
        for side in 0..2 {
            if !self.used[side] {
                continue;
            }
            let (sign, omega) = (SIGN[side], self.omega);
            if self.price == Price::Hard {
                verdict = verdict.and(settle_hard(
                    lanes,
                    &mut self.sides[side],
                    sign,
                    omega,
                    &self.dv,
                ));
            } else {
                for (lane, dv) in self.sides[side].iter_mut().zip(&self.dv) {
                    for i in 0..4 {
                        verdict =
                            verdict.and(settle_soft(lane, i, sign * dv[i], self.price, omega));
                    }
                }
            }
        }
        for fixed in &mut self.fixed {
            let (lane, i) = (fixed.index / 4, fixed.index % 4);
            let after = self.v[lane][i] - fixed.target + self.dv[lane][i];
            fixed.y += self.omega * after;
            verdict.distance = larger(verdict.distance, after.abs());
            verdict.gap += (fixed.y * after).abs();
        }
        for (v, dv) in self.v.iter_mut().zip(&self.dv) {
            for i in 0..4 {
                v[i] += dv[i];
            }
        }
        verdict
    }
}

#[inline(always)]
fn settle_hard<L: Lanes>(
    lanes: L,
    side: &mut [Lane],
    sign: f64,
    omega: f64,
    dv: &[[f64; 4]],
) -> Verdict {
    let (nothing, one) = (lanes.load4([0.0; 4]), lanes.load4([1.0; 4]));
    let (mut changes, mut distance, mut gap) = (nothing, nothing, nothing);
    for (lane, dv) in side.iter_mut().zip(dv) {
        let place = lanes.load4(lane.place);
        let held = lanes.larger4(place, nothing);
        let after = lanes.fma4(sign, lanes.load4(*dv), lanes.load4(lane.r));
        let size = lanes.abs4(after);
        let z = lanes.mul4(held, lanes.fma4(omega, after, lanes.load4(lane.z)));
        // Rounding of the value itself must not call for a bound that holds with equality.
        let slack = lanes.add4(one, lanes.abs4(lanes.load4(lane.bound)));
        let excess = lanes.fma4(-ROUNDING, slack, after);
        let met = lanes.fma4(-1.0, place, nothing);
        let asked = lanes.choose4(held, z, lanes.choose4(met, one, excess));
        let next = lanes.choose4(asked, lanes.load4(lane.on), nothing);
        let z = lanes.mul4(next, z);
        (lane.place, lane.z) = (lanes.store4(next), lanes.store4(z));
        changes = lanes.add4(changes, lanes.abs4(lanes.fma4(-1.0, held, next)));
        distance = lanes.larger4(distance, lanes.mul4(held, size));
        gap = lanes.add4(gap, lanes.mul4(z, size));
    }
    Verdict {
        changes: lanes.store4(changes).iter().sum::<f64>() as usize,
        distance: lanes.store4(distance).into_iter().fold(0.0, larger),
        gap: lanes.store4(gap).iter().sum(),
        ..Verdict::default()
    }
}

/// Slope and offset of z = offset + slope r in the present place.
fn soft_law(lane: &Lane, i: usize, price: Price, omega: f64) -> (f64, f64) {
    match price {
        _ if lane.place[i] == OUTSIDE => (0.0, 0.0),
        Price::Quadratic(rho) => (rho, 0.0),
        Price::Exact(rho) if lane.place[i] == BEYOND => (0.0, rho),
        _ => (omega, lane.z[i]),
    }
}

fn settle_soft(lane: &mut Lane, i: usize, dv: f64, price: Price, omega: f64) -> Verdict {
    let after = lane.r[i] + dv;
    let (slope, offset) = soft_law(lane, i, price, omega);
    let z = offset + slope * after;
    let (place, slack) = (lane.place[i], 1e-12 * (1.0 + lane.bound[i].abs()));
    let next = match price {
        _ if lane.on[i] == 0.0 => OUTSIDE,
        Price::Quadratic(_) => {
            if after > 0.0 {
                BEYOND
            } else {
                OUTSIDE
            }
        }
        Price::Exact(rho) if place == HELD => {
            if z <= 0.0 {
                OUTSIDE
            } else if z >= rho {
                BEYOND
            } else {
                HELD
            }
        }
        _ if place == BEYOND => {
            if after < 0.0 {
                HELD
            } else {
                BEYOND
            }
        }
        _ => {
            if after > slack {
                HELD
            } else {
                OUTSIDE
            }
        }
    };
    let distance = if place == HELD { after.abs() } else { 0.0 };
    lane.place[i] = next;
    lane.z[i] = match (price, next) {
        (_, OUTSIDE) => 0.0,
        (Price::Exact(rho), _) => z.clamp(0.0, rho),
        _ => z,
    };
    Verdict {
        changes: usize::from(next != place),
        distance,
        gap: lane.z[i] * distance,
        ..Verdict::default()
    }
}
