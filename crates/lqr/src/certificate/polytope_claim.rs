//! The claim that a polytope { Hx <= h } is invariant under a law and admissible, and its proof.
//!
//! With A_K = A + BK: H A_K x <= h over the set, invariance; f x <= b over the set for each constraint under the law, admissibility. How such a bound
//! is proved: [`Proof`].
//!
//! The maximal set touches its own image, so what is stored of it is invariant up to rounding only. [`PolytopeClaim::provable`] takes the maximal set of a
//! law that is slower by a margin under limits that are tighter by it. Left out: unbounded sets, proved only where r = 0, and limits of zero, which no margin moves (where they leave the origin only, the claim as it stands is proved).

use crate::arithmetic::dense::{add_scaled, identity, mul};
use crate::arithmetic::exact::Exact;
use crate::certificate::checks::{ExactLaw, malformed};
use crate::certificate::polytope_proof::{Proof, column};
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
use crate::terminal_set::simplex::optimum;
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
