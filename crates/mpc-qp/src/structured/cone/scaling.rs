//! The ellipsoid in the interior point: starting point, Nesterov-Todd scaling, directions.

use super::Cone;
use super::point::Point;
use crate::structured::bounds::Reach;
use crate::structured::kernel::{Lanes, add_product, dot, larger};
use crate::structured::soft::Price;

impl<const NX: usize> Cone<NX> {
    /// Slack and multiplier to start from, with product about `mu`.
    pub(in crate::structured) fn start(&mut self, x: &[f64; NX], mu: f64) {
        let tail = self.offset(x);
        let norm = tail.iter().map(|t| t * t).sum::<f64>().sqrt();
        let head = larger(1.0, norm * 1.5);
        self.s = Point { head, tail };
        // z = mu s^-1: the product is exactly mu on the central path.
        let scale = mu / self.s.det();
        self.z = Point {
            head: scale * head,
            tail: tail.map(|t| -scale * t),
        };
        self.e = 0.0;
        match self.price {
            Price::Hard => {}
            Price::Quadratic(rho) => self.e = self.z.head / rho,
            Price::Exact(rho) => {
                let shrink = (0.5 * rho / self.z.head).min(1.0);
                self.z = Point {
                    head: shrink * self.z.head,
                    tail: self.z.tail.map(|t| shrink * t),
                };
                self.nu = rho - self.z.head;
                self.e = mu / self.nu;
            }
        }
        self.r = Point {
            head: head - 1.0 - self.e,
            tail: [0.0; NX],
        };
    }

    fn apply(&self, v: &Point<NX>, sign: f64) -> Point<NX> {
        let along = self.w.tail_inner(v);
        let factor = sign * v.head + along / (1.0 + self.w.head);
        let head = self.w.head * v.head + sign * along;
        let mut result = Point { head, tail: v.tail };
        for i in 0..NX {
            result.tail[i] += factor * self.w.tail[i];
        }
        result
    }

    /// W v.
    fn scale(&self, v: &Point<NX>) -> Point<NX> {
        let result = self.apply(v, 1.0);
        Point::ZERO.plus(self.eta, &result)
    }

    /// W^-1 v.
    fn unscale(&self, v: &Point<NX>) -> Point<NX> {
        let result = self.apply(v, -1.0);
        Point::ZERO.plus(1.0 / self.eta, &result)
    }

    /// Computes the scaling and adds M'W^-2 M (with e eliminated) to `xx`, the affine force to `gx`.
    #[inline(always)]
    pub(in crate::structured) fn weigh<L: Lanes>(
        &mut self,
        lanes: L,
        xx: &mut [[f64; NX]; NX],
        gx: &mut [f64; NX],
    ) {
        let (norm_s, norm_z) = (self.s.det().sqrt(), self.z.det().sqrt());
        let s = Point::ZERO.plus(1.0 / norm_s, &self.s);
        let z = Point::ZERO.plus(1.0 / norm_z, &self.z);
        let gamma = (0.5 * (1.0 + s.inner(&z))).sqrt();
        let mut w = Point {
            head: 0.5 * (s.head + z.head) / gamma,
            tail: [0.0; NX],
        };
        for i in 0..NX {
            w.tail[i] = 0.5 * (s.tail[i] - z.tail[i]) / gamma;
        }
        self.w = w;
        self.eta = (norm_s / norm_z).sqrt();
        self.lambda = self.scale(&self.z);
        let k = 1.0 / (self.eta * self.eta);
        (self.kappa, self.beta) = match self.price {
            Price::Hard => (0.0, 0.0),
            Price::Quadratic(rho) => (1.0 / rho, 0.0),
            Price::Exact(_) => (self.e / self.nu, -self.e),
        };
        self.theta = self.kappa / (1.0 + self.kappa * k * (2.0 * w.head * w.head - 1.0));
        let rank_one = 2.0 * k * (1.0 - 2.0 * self.theta * k * w.head * w.head);
        let mw = add_product(lanes, &self.m, &w.tail, &[0.0; NX]);
        for j in 0..NX {
            let mut column = add_product(lanes, &self.m, &self.columns[j], &[0.0; NX]);
            for i in 0..NX {
                column[i] = k * column[i] + rank_one * mw[j] * mw[i];
                xx[j][i] += column[i];
            }
        }
        self.aim = Point::ZERO.plus(-1.0, &self.z);
        self.push(lanes, gx);
    }

    /// Adds the force for the present aim: -M'(z + dz) at dx = 0.
    #[inline(always)]
    fn push<L: Lanes>(&self, lanes: L, gx: &mut [f64; NX]) {
        let dz = self.multiplier_step(&[0.0; NX]).0;
        let total = self.z.plus(1.0, &dz);
        *gx = add_product(lanes, &self.m, &total.tail.map(|t| -t), gx);
    }

    /// dz, ds and de for M dx.
    fn multiplier_step(&self, mdx: &[f64; NX]) -> (Point<NX>, Point<NX>, f64) {
        let k = 1.0 / (self.eta * self.eta);
        let w = &self.w;
        let mut ds = Point {
            head: self.beta - self.r.head,
            tail: *mdx,
        };
        for i in 0..NX {
            ds.tail[i] -= self.r.tail[i];
        }
        // Row 0 of W^-2 ds without the part of de that depends on dz.
        let row = k * ((2.0 * w.head * w.head - 1.0) * ds.head - 2.0 * w.head * w.tail_inner(&ds));
        let de = self.theta * (self.aim.head - row);
        ds.head += de;
        let along = 2.0 * (w.head * ds.head - w.tail_inner(&ds));
        let mut dz = self.aim;
        dz.head -= k * (along * w.head - ds.head);
        for i in 0..NX {
            dz.tail[i] -= k * (ds.tail[i] - along * w.tail[i]);
        }
        (dz, ds, de + self.beta)
    }

    /// The direction for the present aim, and how far it may go.
    #[inline(always)]
    pub(in crate::structured) fn direction<L: Lanes>(&mut self, lanes: L, dx: &[f64; NX]) -> Reach {
        let mdx = add_product(lanes, &self.columns, dx, &[0.0; NX]);
        (self.dz, self.ds, self.de) = self.multiplier_step(&mdx);
        let mut reach = Reach {
            ratio: larger(self.s.ratio(&self.ds), self.z.ratio(&self.dz)),
            product: self.ds.head * self.dz.head + dot(lanes, &self.ds.tail, &self.dz.tail),
        };
        if let Price::Exact(_) = self.price {
            reach.ratio = larger(
                reach.ratio,
                larger(-self.de / self.e, self.dz.head / self.nu),
            );
            reach.product -= self.de * self.dz.head;
        }
        reach
    }

    /// Aim of the corrector, and its force added to `gx`.
    #[inline(always)]
    pub(in crate::structured) fn correct<L: Lanes>(
        &mut self,
        lanes: L,
        target_mu: Option<f64>,
        gx: &mut [f64; NX],
    ) {
        let Some(target_mu) = target_mu else {
            (self.aim, self.beta) = (Point::ZERO, 0.0);
            self.push(lanes, gx);
            return;
        };
        let (a, b) = (self.unscale(&self.ds), self.scale(&self.dz));
        let l = self.lambda;
        let mut d = Point {
            head: target_mu - l.inner(&l) - a.inner(&b),
            tail: [0.0; NX],
        };
        for i in 0..NX {
            d.tail[i] = -2.0 * l.head * l.tail[i] - a.head * b.tail[i] - b.head * a.tail[i];
        }
        let head = (l.head * d.head - l.tail_inner(&d)) / l.det();
        let mut xi = Point {
            head,
            tail: [0.0; NX],
        };
        for i in 0..NX {
            xi.tail[i] = (d.tail[i] - head * l.tail[i]) / l.head;
        }
        self.aim = self.unscale(&xi);
        if let Price::Exact(_) = self.price {
            self.beta = (target_mu + self.de * self.dz.head) / self.nu - self.e;
        }
        self.push(lanes, gx);
    }

    /// Moves along the direction; returns the new complementarity products' sum.
    pub(in crate::structured) fn advance(&mut self, alpha: f64) -> f64 {
        self.s = self.s.plus(alpha, &self.ds);
        self.z = self.z.plus(alpha, &self.dz);
        self.r = Point::ZERO.plus(1.0 - alpha, &self.r);
        let mut gap = self.s.inner(&self.z);
        if let Price::Exact(_) = self.price {
            self.e += alpha * self.de;
            self.nu -= alpha * self.dz.head;
            gap += self.e * self.nu;
        } else if let Price::Quadratic(rho) = self.price {
            self.e = self.z.head / rho;
        }
        gap
    }
}
