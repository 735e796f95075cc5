//! The terminal ellipsoid |L'(x - center)| <= radius + growth as a second-order cone with Nesterov-Todd scaling.
//!
//! Everything is divided by the radius, so a tiny set is as well scaled as a large one: s = (1 + e, M (x - center)),
//! M = L' / radius, e = growth / radius. With the scaling point w (w'Jw = 1) and eta, W^-2 = (2 Jw (Jw)' - J) / eta^2
//! (Vandenberghe, The CVXOPT linear and quadratic cone program solvers, 2010, section 5), and the Newton step is
//! dz = W^-1 xi - W^-2 ds. A soft set adds the unknown e, eliminated through de = kappa dz_0 + beta:
//! kappa = beta = 0 (hard), 1 / rho and 0 (quadratic price), e / nu and target / nu - e (exact price).

mod boundary;
mod point;
mod scaling;

use super::soft::Price;
pub(super) use boundary::Place;
use point::Point;

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
    /// Place in the active-set guess.
    pub(super) place: Place,
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
            place: Place::Inside,
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

    /// Multiplier times distance, and the slack of a soft set times its own.
    pub(super) fn gap(&self) -> f64 {
        let distance = self.s.plus(-1.0, &self.r);
        let own = if let Price::Exact(_) = self.price {
            self.e * self.nu
        } else {
            0.0
        };
        distance.inner(&self.z).abs() + own
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
