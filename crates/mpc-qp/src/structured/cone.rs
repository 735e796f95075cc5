//! The terminal ellipsoid |L'(x - center)| <= radius + growth as a second-order cone with Nesterov-Todd scaling.
//!
//! Everything is divided by the radius, so a tiny set is as well scaled as a large one: s = (1 + e, M (x - center)),
//! M = L' / radius, e = growth / radius. With the scaling point w (w'Jw = 1) and eta, W^-2 = (2 Jw (Jw)' - J) / eta^2
//! (Vandenberghe, The CVXOPT linear and quadratic cone program solvers, 2010, section 5), and the Newton step is
//! dz = W^-1 xi - W^-2 ds. A soft set adds the unknown e, eliminated through de = kappa dz_0 + beta:
//! kappa = beta = 0 (hard), 1 / rho and 0 (quadratic price), e / nu and target / nu - e (exact price).

use super::active::Verdict;
use super::bounds::Reach;
use super::kernel::{Lanes, add_product, dot, larger};
use super::soft::Price;

/// A point of the cone's space: first component, then the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point<const NX: usize> {
    /// First component.
    pub(super) head: f64,
    /// The others.
    pub(super) tail: [f64; NX],
}

impl<const NX: usize> Point<NX> {
    const ZERO: Self = Self {
        head: 0.0,
        tail: [0.0; NX],
    };

    fn norm(&self) -> f64 {
        self.tail.iter().map(|t| t * t).sum::<f64>().sqrt()
    }

    /// head^2 - |tail|^2.
    fn det(&self) -> f64 {
        let norm = self.norm();
        (self.head - norm) * (self.head + norm)
    }

    fn inner(&self, other: &Self) -> f64 {
        self.head * other.head + self.tail_inner(other)
    }

    fn tail_inner(&self, other: &Self) -> f64 {
        self.tail.iter().zip(&other.tail).map(|(a, b)| a * b).sum()
    }

    /// self + factor other.
    fn plus(&self, factor: f64, other: &Self) -> Self {
        let mut sum = *self;
        sum.head += factor * other.head;
        for (sum, other) in sum.tail.iter_mut().zip(&other.tail) {
            *sum += factor * other;
        }
        sum
    }

    /// Distance inside the cone.
    fn depth(&self) -> f64 {
        self.head - self.norm()
    }

    /// The reciprocal of the longest step along `d`.
    fn ratio(&self, d: &Self) -> f64 {
        let a = d.det();
        let b = self.head * d.head - self.tail_inner(d);
        let c = self.det();
        let discriminant = b * b - a * c;
        if discriminant < 0.0 {
            0.0
        } else {
            ((discriminant.sqrt() - b) / c).max(0.0)
        }
    }
}

/// The cone constraint with its slack, multiplier, direction and scaling.
#[derive(Clone, Debug)]
pub(super) struct Cone<const NX: usize> {
    /// Rows of M.
    pub(super) m: [[f64; NX]; NX],
    columns: [[f64; NX]; NX],
    center: [f64; NX],
    radius: f64,
    /// Price of e (already in units of the radius).
    pub(super) price: Price,
    /// Slack.
    pub(super) s: Point<NX>,
    /// Multiplier.
    pub(super) z: Point<NX>,
    /// s - (1 + e, M (x - center)).
    pub(super) r: Point<NX>,
    ds: Point<NX>,
    dz: Point<NX>,
    w: Point<NX>,
    eta: f64,
    lambda: Point<NX>,
    /// Growth over radius.
    pub(super) e: f64,
    /// Multiplier of e >= 0.
    pub(super) nu: f64,
    de: f64,
    kappa: f64,
    beta: f64,
    theta: f64,
    aim: Point<NX>,
    /// Whether the active-set guess has the boundary as an equality.
    pub(super) held: bool,
    gradient: [f64; NX],
    excess: f64,
    omega: f64,
}

impl<const NX: usize> Cone<NX> {
    /// The cone of `shape = L L'`, given L by columns.
    pub(super) fn new(l: &[[f64; NX]; NX], center: [f64; NX], radius: f64, price: Price) -> Self {
        let mut m = *l;
        m.as_flattened_mut()
            .iter_mut()
            .for_each(|entry| *entry /= radius);
        let mut columns = [[0.0; NX]; NX];
        for i in 0..NX {
            for j in 0..NX {
                columns[j][i] = m[i][j];
            }
        }
        let price = match price {
            Price::Hard => Price::Hard,
            Price::Exact(rho) => Price::Exact(rho * radius),
            Price::Quadratic(rho) => Price::Quadratic(rho * radius * radius),
        };
        Self {
            m,
            columns,
            center,
            radius,
            price,
            s: Point {
                head: 1.0,
                tail: [0.0; NX],
            },
            z: Point {
                head: 1.0,
                tail: [0.0; NX],
            },
            r: Point::ZERO,
            ds: Point::ZERO,
            dz: Point::ZERO,
            w: Point::ZERO,
            eta: 1.0,
            lambda: Point::ZERO,
            e: 0.0,
            nu: 0.0,
            de: 0.0,
            kappa: 0.0,
            beta: 0.0,
            theta: 0.0,
            aim: Point::ZERO,
            held: false,
            gradient: [0.0; NX],
            excess: 0.0,
            omega: 0.0,
        }
    }

    /// M (x - center).
    pub(super) fn offset(&self, x: &[f64; NX]) -> [f64; NX] {
        let mut offset = [0.0; NX];
        for j in 0..NX {
            offset[j] = (0..NX)
                .map(|i| self.m[j][i] * (x[i] - self.center[i]))
                .sum();
        }
        offset
    }

    /// Slack and multiplier to start from, with product about `mu`.
    pub(super) fn start(&mut self, x: &[f64; NX], mu: f64) {
        let tail = self.offset(x);
        let norm = tail.iter().map(|t| t * t).sum::<f64>().sqrt();
        let head = larger(1.0, norm * 1.1);
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

    /// Zero multiplier and growth.
    pub(super) fn reset(&mut self) {
        self.z = Point::ZERO;
        self.e = 0.0;
    }

    /// Number of complementarity products.
    pub(super) fn count(&self) -> f64 {
        if let Price::Exact(_) = self.price {
            2.0
        } else {
            1.0
        }
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
    pub(super) fn weigh<L: Lanes>(
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
    pub(super) fn direction<L: Lanes>(&mut self, lanes: L, dx: &[f64; NX]) -> Reach {
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
    pub(super) fn correct<L: Lanes>(&mut self, lanes: L, target_mu: f64, gx: &mut [f64; NX]) {
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
    pub(super) fn advance(&mut self, alpha: f64) -> f64 {
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

    /// Active-set sweep: the boundary as f = (|M (x - center)|^2 - 1) / 2 = 0 with multiplier z.head, linearised at x.
    #[inline(always)]
    pub(super) fn hold<L: Lanes>(
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
        if !self.held {
            return;
        }
        let eta = self.z.head;
        if let Some(xx) = xx {
            self.omega = omega / dot(lanes, &self.gradient, &self.gradient).max(1e-30);
            for j in 0..NX {
                let column = self.columns[j].map(|entry| eta * entry);
                xx[j] = add_product(lanes, &self.m, &column, &xx[j]);
                xx[j] = add_product(
                    lanes,
                    &[self.gradient],
                    &[self.omega * self.gradient[j]],
                    &xx[j],
                );
            }
        }
        *gx = add_product(
            lanes,
            &[self.gradient],
            &[eta + self.omega * self.excess],
            gx,
        );
    }

    /// Guesses from a multiplier's first component, in the problem's units.
    pub(super) fn guess(&mut self, multiplier: f64) {
        self.z.head = multiplier.max(0.0) * self.radius;
        self.held = self.z.head > 0.0;
    }

    /// Guesses from an interior-point iterate: held where the slack shrinks faster than the multiplier.
    pub(super) fn guess_from_iterate(&mut self) {
        self.held = self.s.depth() * self.z.head < self.z.depth().max(self.s.depth()) * self.s.head
            && self.z.head > self.s.depth();
        if !self.held {
            self.z.head = 0.0;
        }
    }

    /// Judges the active-set guess after the step `dx` to `x`; a guess whose linearisation was too coarse is wrong too.
    pub(super) fn settle(&mut self, x: &[f64; NX], dx: &[f64; NX]) -> Verdict {
        let linear = self.excess
            + self
                .gradient
                .iter()
                .zip(dx)
                .map(|(g, d)| g * d)
                .sum::<f64>();
        let offset = self.offset(x);
        let after = 0.5 * (offset.iter().map(|t| t * t).sum::<f64>() - 1.0);
        let mut verdict = Verdict {
            changes: 0,
            distance: 0.0,
        };
        if self.held {
            let eta = self.z.head + self.omega * linear;
            let drift = (eta - self.z.head).abs()
                * self.gradient.iter().map(|g| g.abs()).fold(0.0, f64::max);
            let move_sizes = (after - linear).abs().sqrt();
            self.held = eta > 0.0;
            let rough = (after - linear).abs() > 1e-11 || drift * move_sizes > 1e-9;
            verdict.changes = usize::from(!self.held || rough);
            verdict.distance = linear.abs();
            self.z.head = eta.max(0.0);
        } else {
            self.z.head = 0.0;
            self.held = after > 1e-12;
            verdict.changes = usize::from(self.held);
        }
        self.z.tail = offset.map(|t| -self.z.head * t);
        verdict
    }

    /// The multiplier in the problem's units: (radius, offset).
    pub(super) fn multiplier(&self) -> (f64, [f64; NX]) {
        (
            self.z.head / self.radius,
            self.z.tail.map(|t| t / self.radius),
        )
    }

    /// Growth of the radius.
    pub(super) fn growth(&self) -> f64 {
        if self.price == Price::Hard {
            0.0
        } else {
            self.e * self.radius
        }
    }

    /// -M'z, the multiplier's force on x_N.
    pub(super) fn force(&self) -> [f64; NX] {
        let mut force = [0.0; NX];
        for j in 0..NX {
            for i in 0..NX {
                force[i] -= self.m[j][i] * self.z.tail[j];
            }
        }
        force
    }
}
