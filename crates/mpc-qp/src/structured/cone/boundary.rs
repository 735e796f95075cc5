//! The ellipsoid in active-set sweeps: its boundary as an equality, or a soft set left behind.
//!
//! Held, the set is f = (|M (x - center)|^2 - 1) / 2 = 0 with multiplier eta, linearised anew in each sweep. A soft set that x_N
//! leaves has the price of the growth |M (x - center)| - 1 as a convex term of the cost, expanded to second order.

use super::Cone;
use crate::structured::active::Verdict;
use crate::structured::kernel::{Lanes, add_product, dot, larger};
use crate::structured::soft::Price;

/// Place of the ellipsoid in the active-set guess.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::structured) enum Place {
    /// Inactive.
    Inside,
    /// Its boundary is an equality.
    Held,
    /// A soft set that is violated.
    Beyond,
}

/// Change of f or of the force that a linearisation may miss.
const ROUGH: f64 = 1e-11;

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

impl<const NX: usize> Cone<NX> {
    /// Adds curvature and force at x; the curvature only if `xx` is given.
    #[inline(always)]
    pub(in crate::structured) fn hold<L: Lanes>(
        &mut self,
        lanes: L,
        x: &[f64; NX],
        omega: f64,
        xx: Option<&mut [[f64; NX]; NX]>,
        gx: &mut [f64; NX],
    ) {
        let offset = self.offset(x);
        self.gradient = add_product(lanes, &self.m, &offset, &[0.0; NX]);
        self.excess = 0.5 * (dot(lanes, &offset, &offset) - 1.0);
        match self.place {
            Place::Inside => {}
            Place::Beyond => {
                let (z, slope) = self.price_beyond(norm(&offset));
                self.push_outward(lanes, &offset, (z, slope), xx, gx);
            }
            Place::Held => {
                let eta = self.z.head;
                if let Some(xx) = xx {
                    self.omega = omega / dot(lanes, &self.gradient, &self.gradient).max(1e-30);
                    for j in 0..NX {
                        let column = self.columns[j].map(|entry| eta * entry);
                        xx[j] = add_product(lanes, &self.m, &column, &xx[j]);
                        let rank_one = [self.omega * self.gradient[j]];
                        xx[j] = add_product(lanes, &[self.gradient], &rank_one, &xx[j]);
                    }
                }
                let force = [eta + self.omega * self.excess];
                *gx = add_product(lanes, &[self.gradient], &force, gx);
            }
        }
    }

    /// Multiplier and slope of the price at a violated soft set, by the length of the offset.
    fn price_beyond(&self, length: f64) -> (f64, f64) {
        match self.price {
            Price::Hard => (0.0, 0.0),
            Price::Exact(rho) => (rho, 0.0),
            Price::Quadratic(rho) => (rho * (length - 1.0).max(0.0), rho),
        }
    }

    /// Adds force and curvature of a convex function of |offset| with derivatives `z` and `slope`.
    pub(in crate::structured) fn push_outward<L: Lanes>(
        &self,
        lanes: L,
        offset: &[f64; NX],
        (z, slope): (f64, f64),
        xx: Option<&mut [[f64; NX]; NX]>,
        gx: &mut [f64; NX],
    ) {
        let length = norm(offset);
        if length == 0.0 {
            return;
        }
        let normal = add_product(lanes, &self.m, &offset.map(|t| t / length), &[0.0; NX]);
        if let Some(xx) = xx {
            for j in 0..NX {
                let column = self.columns[j].map(|entry| z / length * entry);
                xx[j] = add_product(lanes, &self.m, &column, &xx[j]);
                let rank_one = [(slope - z / length) * normal[j]];
                xx[j] = add_product(lanes, &[normal], &rank_one, &xx[j]);
            }
        }
        *gx = add_product(lanes, &[normal], &[z], gx);
    }

    /// Guesses from a multiplier's first component, in the problem's units.
    pub(in crate::structured) fn guess(&mut self, multiplier: f64) {
        self.z.head = multiplier.max(0.0) * self.radius;
        self.place = self.place_of_multiplier();
    }

    /// The place that the present multiplier asks for.
    pub(in crate::structured) fn place_of_multiplier(&self) -> Place {
        match self.price {
            _ if self.z.head <= 0.0 => Place::Inside,
            Price::Quadratic(_) => Place::Beyond,
            Price::Exact(rho) if self.z.head >= (1.0 - 1e-9) * rho => Place::Beyond,
            _ => Place::Held,
        }
    }

    /// Guesses from an interior-point iterate: active where the depth shrinks faster than the multiplier. (Depth over length tells
    /// nothing: near the central path it is the same for slack and multiplier, active or not.)
    /// True if the guess is not the one before.
    pub(in crate::structured) fn guess_from_iterate(&mut self) -> bool {
        let before = self.place;
        let depth = self.s.depth();
        let outward = self.s.tail_inner(&self.ds) / self.s.norm().max(f64::MIN_POSITIVE);
        let active = (self.ds.head - outward) * self.z.head < self.dz.head * depth;
        self.place = match self.price {
            _ if !active => Place::Inside,
            Price::Quadratic(_) => Place::Beyond,
            Price::Exact(_) if self.e * self.z.head > depth.max(1e-12) * self.nu => Place::Beyond,
            _ => Place::Held,
        };
        self.place != before
    }

    /// Judges the guess after the step `dx` to `x`; a guess whose linearisation was too coarse is wrong too. A step that was `cut` is not
    /// that of the linearisation: times a weight of 1e10, what it misses would pass for a multiplier.
    pub(in crate::structured) fn settle<L: Lanes>(
        &mut self,
        lanes: L,
        x: &[f64; NX],
        dx: &[f64; NX],
        cut: bool,
    ) -> Verdict {
        let offset = self.offset(x);
        let after = 0.5 * (dot(lanes, &offset, &offset) - 1.0);
        self.e = 0.0;
        let verdict = match self.place {
            Place::Inside => self.settle_inside(after),
            Place::Held if cut => Verdict {
                rough: true,
                ..Verdict::default()
            },
            Place::Held => self.settle_held(after, self.excess + dot(lanes, &self.gradient, dx)),
            Place::Beyond => self.settle_beyond(lanes, &offset, dx),
        };
        // Held, the offset has length one.
        let length = if self.e > 0.0 { 1.0 + self.e } else { 1.0 };
        self.z.tail = offset.map(|t| -self.z.head * t / length);
        verdict
    }

    fn settle_inside(&mut self, after: f64) -> Verdict {
        self.z.head = 0.0;
        if after > 1e-12 {
            self.place = match self.price {
                Price::Quadratic(_) => Place::Beyond,
                _ => Place::Held,
            };
        }
        Verdict {
            changes: usize::from(self.place != Place::Inside),
            ..Verdict::default()
        }
    }

    fn settle_held(&mut self, after: f64, linear: f64) -> Verdict {
        let eta = self.z.head + self.omega * linear;
        let steepest = self.gradient.iter().map(|g| g.abs()).fold(0.0, f64::max);
        let drift = (eta - self.z.head).abs() * steepest;
        let missed = (after - linear).abs();
        self.z.head = eta.max(0.0);
        self.place = match self.price {
            _ if eta <= 0.0 => Place::Inside,
            Price::Exact(rho) if eta > rho => {
                self.z.head = rho;
                Place::Beyond
            }
            _ => Place::Held,
        };
        let rough = missed > ROUGH || drift * missed.sqrt() > 1e-9;
        Verdict {
            changes: usize::from(self.place != Place::Held),
            rough,
            distance: linear.abs(),
            gap: self.z.head * after.abs(),
        }
    }

    fn settle_beyond<L: Lanes>(&mut self, lanes: L, offset: &[f64; NX], dx: &[f64; NX]) -> Verdict {
        // What the expansion at x - dx foretold, against the force at x.
        let step = add_product(lanes, &self.columns, dx, &[0.0; NX]);
        let mut before = *offset;
        for (before, step) in before.iter_mut().zip(&step) {
            *before -= step;
        }
        let (mut curvature, mut foretold) = ([[0.0; NX]; NX], [0.0; NX]);
        let expansion = self.price_beyond(norm(&before));
        self.push_outward(
            lanes,
            &before,
            expansion,
            Some(&mut curvature),
            &mut foretold,
        );
        foretold = add_product(lanes, &curvature, dx, &foretold);
        let length = norm(offset);
        let (z, _) = self.price_beyond(length);
        let mut force = [0.0; NX];
        self.push_outward(lanes, offset, (z, 0.0), None, &mut force);
        let (mut missed, mut size): (f64, f64) = (0.0, 0.0);
        for (force, foretold) in force.iter().zip(&foretold) {
            missed = larger((force - foretold).abs(), missed);
            size = larger(force.abs(), size);
        }
        self.z.head = z;
        if length < 1.0 {
            self.place = match self.price {
                Price::Exact(_) => Place::Held,
                _ => Place::Inside,
            };
        } else {
            self.e = length - 1.0;
        }
        Verdict {
            changes: usize::from(self.place != Place::Beyond),
            rough: missed > ROUGH * size,
            ..Verdict::default()
        }
    }
}
