//! Bounds on linear functions over a polytope { Hx <= h }, proved in exact integer arithmetic on the stored doubles.
//!
//! By duality: y >= 0 gives g = y'H + r, hence g x <= y'h + sum |r_j| M_j with |x_j| <= M_j over the set. The linear program supplies y in doubles; r,
//! rounding in size, and the sum are then evaluated exactly. The M_j are proved the same way, all at once:
//! |x_j| <= y'h + sum |r_k| M_k t with t = max |x_j| / M_j gives t <= 1 where the right side is at most M_j at t = 1.

use crate::arithmetic::exact::Exact;
use crate::terminal_set::polytope::AdmissibleSet;
use crate::terminal_set::simplex::{Optimum, optimum};
use faer::Mat;

pub(crate) fn column(row: &[f64]) -> Mat<f64> {
    Mat::from_fn(row.len(), 1, |i, _| row[i])
}

/// The stored set in exact numbers, with proved bounds on its coordinates.
pub(crate) struct Proof {
    rows: Vec<(Exact, Exact)>,
    /// M_j, n x 1; `None` for a set that is not shown to be bounded.
    extents: Option<Exact>,
}

impl Proof {
    pub(crate) fn of(set: &AdmissibleSet, n: usize) -> Self {
        let rows = set.rows.iter();
        let rows = rows.map(|r| {
            (
                Exact::of(&column(&r.row)).transpose(),
                Exact::number(r.bound),
            )
        });
        let mut proof = Self {
            rows: rows.collect(),
            extents: None,
        };
        proof.extents = proof.coordinate_extents(set, n);
        proof
    }

    fn coordinate_extents(&self, set: &AdmissibleSet, n: usize) -> Option<Exact> {
        let axes = (0..n).flat_map(|j| [(j, 1.0), (j, -1.0)]);
        let reaches: Vec<(usize, Exact, Optimum)> = axes
            .map(|(j, sign)| {
                let axis: Vec<f64> = (0..n).map(|i| if i == j { sign } else { 0.0 }).collect();
                let found = optimum(&axis, set.half_spaces())?;
                Some((j, Exact::of(&column(&axis)).transpose(), found))
            })
            .collect::<Option<_>>()?;
        let largest = reaches
            .iter()
            .map(|(_, _, found)| found.value)
            .fold(0.0, f64::max);
        // More than twice the reach leaves room for rounding and residuals; a flat direction gets some extent as well, and so does the origin alone.
        let some = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
        let mut extents = vec![some; n];
        for (j, _, found) in &reaches {
            extents[*j] = extents[*j].max(3.0 * found.value);
        }
        let exact = Exact::of(&column(&extents));
        let mut origin_only = true;
        for (j, axis, found) in &reaches {
            let (reach, rest) = self.split(axis, found);
            origin_only &= reach.is_zero();
            let rest = rest.modulus().mul(&exact);
            let half = Exact::number(0.5 * extents[*j]);
            // Both halves below M_j / 2, the second strictly: t <= 1/2 + t/2 with less than 1/2 before t.
            if !half.sub(&reach).is_definite(false) || !half.sub(&rest).is_definite(true) {
                return None;
            }
        }
        // Without the first half t <= t/2 leaves t = 0 only.
        Some(if origin_only {
            exact.times(&Exact::number(0.0))
        } else {
            exact
        })
    }

    /// y'h and r = g - y'H. Multipliers that are not positive prove nothing and are left out.
    fn split(&self, target: &Exact, found: &Optimum) -> (Exact, Exact) {
        let (mut reach, mut rest) = (Exact::number(0.0), target.clone());
        for &(i, y) in found.multipliers.iter().filter(|(_, y)| *y > 0.0) {
            let (row, bound) = &self.rows[i];
            let y = Exact::number(y);
            reach = reach.add(&bound.times(&y));
            rest = rest.sub(&row.times(&y));
        }
        (reach, rest)
    }

    /// Whether `target x <= limit` over the set is proved.
    pub(crate) fn bounds(&self, target: &Exact, limit: f64, found: &Optimum) -> bool {
        let (reach, rest) = self.split(target, found);
        let slack = Exact::number(limit).sub(&reach);
        match &self.extents {
            _ if rest.is_zero() => slack.is_definite(false),
            Some(extents) => slack.sub(&rest.modulus().mul(extents)).is_definite(false),
            None => false,
        }
    }
}
