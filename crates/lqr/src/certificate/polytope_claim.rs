//! The claim that a polytope { Hx <= h } is invariant under a law and admissible, and its proof.
//!
//! With A_K = A + BK: H A_K x <= h over the set, invariance; f x <= b over the set for each constraint under the law, admissibility. A bound g x <= b over the set
//! is proved by duality: y >= 0 gives g = y'H + r, hence g x <= y'h + sum |r_j| M_j with |x_j| <= M_j over the set. The linear
//! program supplies y in doubles; r, rounding in size, and the sum are then evaluated in exact integer arithmetic on the stored doubles. The M_j are proved the same way,
//! all at once: |x_j| <= y'h + sum |r_k| M_k t with t = max |x_j| / M_j gives t <= 1 where the right side is at most M_j at t = 1.
//!
//! The maximal set touches its own image, so what is stored of it is invariant up to rounding only. [`PolytopeClaim::provable`] takes the maximal set of a
//! law that is slower by a margin under limits that are tighter by it. Left out: unbounded sets, proved only where r = 0, and limits of zero, which no margin moves.

use crate::arithmetic::dense::{add_scaled, identity, mul};
use crate::arithmetic::exact::Exact;
use crate::certificate::checks::{ExactLaw, malformed};
use crate::certificate::record::{Certificate, Check, Rigour, Witness};
use crate::input::{self, InputError};
use crate::riccati::dare::Dare;
use crate::riccati::dare_solution::DareSolution;
use crate::riccati::problem::Problem;
use crate::terminal_set::constraints::{Constraints, LawRow};
use crate::terminal_set::ellipsoid::TerminalSetError;
use crate::terminal_set::polytope::{
    AdmissibleSet, Caps, Determination, IMPLIED, least_room, length,
};
use crate::terminal_set::simplex::{Optimum, optimum};
use faer::Mat;

/// Margins tried by `provable`: the first is ten times what `AdmissibleSet` takes for implied.
const MARGINS: [f64; 4] = [10.0 * IMPLIED, 1e-7, 1e-6, 1e-5];

/// A law, constraints and a polytope, and the claim that they fit together.
#[derive(Debug, Clone)]
pub struct PolytopeClaim {
    problem: Problem,
    constraints: Constraints,
    /// Gain of u = Kx, m x n.
    pub k: Mat<f64>,
    /// The polytope.
    pub set: AdmissibleSet,
}

impl PolytopeClaim {
    /// The maximal admissible invariant set under the law of a Riccati solution.
    ///
    /// # Errors
    /// [`TerminalSetError`] for data that do not fit, or a closed loop that is not stable.
    pub fn maximal(
        dare: &Dare<'_>,
        solution: &DareSolution,
        constraints: Constraints,
        caps: Caps,
    ) -> Result<Self, TerminalSetError> {
        let problem = dare.problem()?;
        let shape = (problem.b.ncols(), problem.states());
        let k = input::matrix("K", solution.k.as_ref(), shape)?;
        let rows = constraints.under_law(problem.a.as_ref(), problem.b.as_ref(), k.as_ref())?;
        let set = AdmissibleSet::maximal_within(problem.closed_loop(&k).as_ref(), &rows, caps)?;
        Ok(Self {
            problem,
            constraints,
            k,
            set,
        })
    }

    /// Checks every condition in floating point.
    #[must_use]
    pub fn certify(&self) -> Certificate {
        self.check(Rigour::Floating)
    }

    /// Proves every condition for the stored numbers. What is not proved fails, true or not; a witness shows a failure beyond rounding.
    #[must_use]
    pub fn prove(&self) -> Certificate {
        self.check(Rigour::Exact)
    }

    /// The nearest polytope that can be proved, within the same caps, with its exact certificate.
    ///
    /// # Errors
    /// The exact certificate of the last try, which says what is not proved.
    pub fn provable(&self, caps: Caps) -> Result<(Self, Certificate), Certificate> {
        let mut certificate = self.prove();
        if certificate.holds() {
            return Ok((self.clone(), certificate));
        }
        if self.validate().is_err() {
            return Err(certificate);
        }
        for margin in MARGINS {
            let slower = add_scaled(&self.closed_loop(), margin, &self.closed_loop());
            let tighter: Vec<LawRow> = self
                .rows()
                .into_iter()
                .map(|row| LawRow {
                    bound: row.bound * (1.0 - margin),
                    ..row
                })
                .collect();
            let Ok(set) = AdmissibleSet::maximal_within(slower.as_ref(), &tighter, caps) else {
                break;
            };
            let claim = Self {
                set,
                ..self.clone()
            };
            certificate = claim.prove();
            if certificate.holds() {
                return Ok((claim, certificate));
            }
        }
        Err(certificate)
    }

    fn closed_loop(&self) -> Mat<f64> {
        self.problem.closed_loop(&self.k)
    }

    fn rows(&self) -> Vec<LawRow> {
        let step = add_scaled(&self.closed_loop(), -1.0, &identity(self.problem.states()));
        self.constraints.half_spaces(&self.k, &mul(&self.k, &step))
    }

    /// The fields are public: whoever changed them, a certificate speaks of numbers that make a claim.
    fn validate(&self) -> Result<(), InputError> {
        let (n, m) = (self.problem.states(), self.problem.b.ncols());
        input::matrix("K", self.k.as_ref(), (m, n))?;
        for row in &self.set.rows {
            input::matrix("row", column(&row.row).as_ref(), (n, 1))?;
            input::finite_not_negative("bound", row.bound)?;
        }
        Ok(())
    }

    fn check(&self, rigour: Rigour) -> Certificate {
        if let Err(error) = self.validate() {
            return malformed(rigour, &error);
        }
        let exact = (rigour == Rigour::Exact).then(|| ExactLaw::new(&self.problem, &self.k));
        let proof = exact
            .as_ref()
            .map(|_| Proof::of(&self.set, self.problem.states()));
        let transposed = self.closed_loop().transpose().to_owned();
        let limits = self.rows();
        let room = least_room(&limits);
        let images = self.set.rows.iter().map(|row| {
            let image = mul(&transposed, &column(&row.row));
            let target = exact
                .as_ref()
                .map(|e| Exact::of(&column(&row.row)).transpose().mul(&e.closed_loop));
            self.bound(
                image.col_as_slice(0),
                (row.bound, room),
                proof.as_ref().zip(target.as_ref()),
            )
        });
        let status = match self.set.determination {
            Determination::Determined { index } => format!("determined at t = {index}"),
            Determination::CapMet { steps } => format!("cap met after {steps} steps"),
            Determination::RowCapMet { rows, .. } => format!("cap met at {rows} rows"),
        };
        let worst = images.reduce(|x, y| if x.is_worse_than(&y) { x } else { y });
        let mut checks = vec![match worst {
            Some(bound) => bound.check(
                "invariance",
                format!("max H A_K x over the set <= h, {status}"),
            ),
            None => Bounded::of_nothing().check("invariance", status),
        }];
        let targets = exact.as_ref().map(|e| e.rows(&self.constraints, &e.change));
        checks.extend(limits.iter().enumerate().map(|(i, row)| {
            let target = targets.as_ref().map(|targets| &targets[i]);
            self.bound(&row.row, (row.bound, room), proof.as_ref().zip(target))
                .check(&row.name, format!("max over the set <= {}", row.bound))
        }));
        Certificate { rigour, checks }
    }

    /// Whether `row x <= limit` over the set: proved for the exact row where there is one, else up to twice what `AdmissibleSet` takes for implied,
    /// which is relative to the limit and to `room`, of rows at unit length. The margin is relative to the limit, or to the room where that is zero.
    fn bound(
        &self,
        row: &[f64],
        (limit, room): (f64, f64),
        proof: Option<(&Proof, &Exact)>,
    ) -> Bounded {
        let found = optimum(row, self.set.half_spaces());
        let value = found.as_ref().map_or(f64::INFINITY, |found| found.value);
        let room = room * length(row);
        let scale = [limit, room].into_iter().find(|&x| x > 0.0).unwrap_or(1.0);
        let margin = (limit - value) / scale;
        let rounding = 2.0 * IMPLIED * (limit + room) / scale;
        let tolerance = if proof.is_some() { 0.0 } else { rounding };
        let holds = match (proof, &found) {
            (Some((proof, target)), Some(found)) => proof.bounds(target, limit, found),
            (Some(_), None) => false,
            (None, _) => margin >= -tolerance,
        };
        // Below this a corner in doubles shows nothing.
        let witness = found
            .filter(|_| !holds && margin < -0.5 * rounding)
            .map(|found| Witness {
                value,
                bound: limit,
                factor: value / limit,
                state: found.point,
            });
        Bounded {
            holds,
            margin,
            tolerance,
            witness,
        }
    }
}

fn column(row: &[f64]) -> Mat<f64> {
    Mat::from_fn(row.len(), 1, |i, _| row[i])
}

/// The verdict on one bound.
struct Bounded {
    holds: bool,
    margin: f64,
    tolerance: f64,
    witness: Option<Witness>,
}

impl Bounded {
    /// No row, no condition.
    fn of_nothing() -> Self {
        Self {
            holds: true,
            margin: 1.0,
            tolerance: 0.0,
            witness: None,
        }
    }

    fn is_worse_than(&self, other: &Self) -> bool {
        (self.holds, self.margin) < (other.holds, other.margin)
    }

    fn check(self, name: &str, condition: String) -> Check {
        Check {
            name: name.to_owned(),
            condition,
            holds: self.holds,
            margin: self.margin,
            tolerance: self.tolerance,
            witness: self.witness,
        }
    }
}

/// The stored set in exact numbers, with proved bounds on its coordinates.
struct Proof {
    rows: Vec<(Exact, Exact)>,
    /// M_j, n x 1; `None` for a set that is not shown to be bounded.
    extents: Option<Exact>,
}

impl Proof {
    fn of(set: &AdmissibleSet, n: usize) -> Self {
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
        // More than twice the reach leaves room for rounding and residuals; a flat direction gets some extent as well.
        let mut extents = vec![1e-3 * largest; n];
        for (j, _, found) in &reaches {
            extents[*j] = extents[*j].max(3.0 * found.value);
        }
        let exact = Exact::of(&column(&extents));
        let proved = reaches.iter().all(|(j, axis, found)| {
            let (reach, rest) = self.split(axis, found);
            let rest = rest.modulus().mul(&exact);
            let half = Exact::number(0.5 * extents[*j]);
            // Both halves below M_j / 2, the second strictly: t <= 1/2 + t/2 with less than 1/2 before t.
            half.sub(&reach).is_definite(false) && half.sub(&rest).is_definite(true)
        });
        proved.then_some(exact)
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
    fn bounds(&self, target: &Exact, limit: f64, found: &Optimum) -> bool {
        let (reach, rest) = self.split(target, found);
        let slack = Exact::number(limit).sub(&reach);
        match &self.extents {
            _ if rest.is_zero() => slack.is_definite(false),
            Some(extents) => slack.sub(&rest.modulus().mul(extents)).is_definite(false),
            None => false,
        }
    }
}
