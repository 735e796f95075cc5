//! Certificates: each condition of the stability argument as a named check with its margin.
//!
//! For V = x'Px, a law u = Kx, a set { x'Sx <= c } and a fraction theta of the stage cost l (one unless said otherwise):
//! a <= V/|x|^2 <= b with a > 0; P - A_K'PA_K - theta (Q + SK + (SK)' + K'RK) >= 0, that is V(x+) - V(x) <= -theta l; S - A_K'SA_K >= 0, invariance; and
//! h^2 S - c f'f >= 0 for each row f x <= h under the law, admissibility.
//!
//! [`Rigour::Floating`] compares eigenvalues with zero up to rounding. [`Rigour::Exact`] decides every
//! matrix inequality in integer arithmetic on the stored doubles of A, B, Q, R, K, P, S, c and the rows: a proof, with no tolerance. A
//! Riccati solution in doubles misses equality by rounding in either direction, so its decrease is not provable as it stands:
//! [`TerminalClaim::provable`] adds to P a multiple of the sum of A_K'^j A_K^j, some roundings in size, and lowers c by as much as it takes.

use crate::constraints::{Constraints, LawRow};
use crate::dare::{Dare, DareSolution};
use crate::dense::{add_scaled, cholesky, congruence, identity, mul, norm, symmetrise};
use crate::ellipsoid::{Ellipsoid, TerminalSetError};
use crate::exact::Exact;
use crate::input::{self, InputError};
use crate::riccati::Problem;
use crate::spectrum::lyapunov_sum;
use faer::{Mat, Side};
use serde::{Deserialize, Serialize};

/// What a verdict rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Rigour {
    /// Floating-point eigenvalues, with a tolerance of the size of their rounding.
    Floating,
    /// Integer arithmetic on the stored doubles: proved or refuted, no tolerance.
    Exact,
}

/// A state that shows by how much a condition fails.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Witness {
    /// The state, length n.
    pub state: Vec<f64>,
    /// What is bounded, at that state.
    pub value: f64,
    /// Its bound.
    pub bound: f64,
    /// value / bound; infinite for a bound of zero.
    pub factor: f64,
}

/// One condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Its name, that of the constraint for admissibility.
    pub name: String,
    /// What was tested, as a formula.
    pub condition: String,
    /// The verdict, at the certificate's level of rigour.
    pub holds: bool,
    /// Distance from failing, in floating point: the least eigenvalue of the matrix in `condition`, the bound itself for
    /// `lower bound` and `upper bound`, and for a constraint 1 - (largest value in the set) / limit.
    pub margin: f64,
    /// Negative margins down to here counted as rounding; zero in an exact certificate.
    pub tolerance: f64,
    /// A state that violates the condition, where it fails.
    pub witness: Option<Witness>,
}

/// The checks of one claim.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// What the verdicts rest on.
    pub rigour: Rigour,
    /// The conditions in the order of the argument.
    pub checks: Vec<Check>,
}

impl Certificate {
    /// Whether every condition holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.checks.iter().all(|check| check.holds)
    }

    /// The conditions that fail.
    pub fn failures(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| !check.holds)
    }
}

impl std::fmt::Display for Certificate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let width = self
            .checks
            .iter()
            .map(|check| check.name.len())
            .max()
            .unwrap_or(0)
            .max(5);
        let level = match self.rigour {
            Rigour::Floating => "floating point",
            Rigour::Exact => "exact",
        };
        writeln!(f, "{:width$} | {level:14} | margin    | condition", "check")?;
        for check in &self.checks {
            let verdict = if check.holds { "holds" } else { "FAILS" };
            write!(
                f,
                "{:width$} | {verdict:14} | {:9.2e} | {}",
                check.name, check.margin, check.condition
            )?;
            if let Some(witness) = &check.witness {
                write!(
                    f,
                    "; {:.4e} against {:.4e}, factor {:.4e}, at {:.4?}",
                    witness.value, witness.bound, witness.factor, witness.state
                )?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// Terminal cost, law and set, and what is claimed of them.
#[derive(Debug, Clone)]
pub struct TerminalClaim {
    problem: Problem,
    constraints: Constraints,
    /// Gain of u = Kx, m x n.
    pub k: Mat<f64>,
    /// P of the terminal cost V = x'Px, n x n.
    pub cost: Mat<f64>,
    /// Shape S of the set { x'Sx <= level }, n x n; P for a level set of the cost.
    pub set: Mat<f64>,
    /// Level of the set.
    pub level: f64,
    /// The fraction theta of the stage cost by which V is claimed to fall.
    pub decrease_fraction: f64,
}

impl TerminalClaim {
    /// The level set of the Riccati solution, as large as the constraints allow.
    ///
    /// # Errors
    /// [`TerminalSetError`] for data that do not fit, or a P that is not positive definite.
    pub fn largest(
        dare: &Dare<'_>,
        solution: &DareSolution,
        constraints: Constraints,
    ) -> Result<Self, TerminalSetError> {
        let mut claim = Self::new(dare, solution, 0.0, constraints)?;
        let level = Ellipsoid::largest(claim.set.as_ref(), &claim.rows())?.level;
        // Nothing constrains the set: certify the unit level in its place.
        claim.level = if level.is_finite() { level } else { 1.0 };
        Ok(claim)
    }

    /// The level set of the Riccati solution at a given level, true or not.
    ///
    /// # Errors
    /// [`InputError`] for data that do not fit.
    pub fn new(
        dare: &Dare<'_>,
        solution: &DareSolution,
        level: f64,
        constraints: Constraints,
    ) -> Result<Self, InputError> {
        let problem = dare.problem()?;
        let (n, m) = (problem.states(), problem.b.ncols());
        let cost = input::symmetric("P", solution.p.as_ref(), n)?;
        let k = input::matrix("K", solution.k.as_ref(), (m, n))?;
        constraints.under_law(problem.a.as_ref(), problem.b.as_ref(), k.as_ref())?;
        let claim = Self {
            problem,
            constraints,
            k,
            set: cost.clone(),
            cost,
            level,
            decrease_fraction: 1.0,
        };
        claim.validated()
    }

    /// The same law and cost with another set, such as the one of largest volume.
    ///
    /// # Errors
    /// [`InputError`] for another size.
    pub fn with_set(mut self, set: &Ellipsoid) -> Result<Self, InputError> {
        self.set = set.p.clone();
        self.level = set.level;
        self.validated()
    }

    fn validated(self) -> Result<Self, InputError> {
        input::symmetric("set", self.set.as_ref(), self.problem.states())?;
        for (name, value) in [
            ("level", self.level),
            ("decrease_fraction", self.decrease_fraction),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(InputError::NotFinite {
                    name,
                    row: 0,
                    col: 0,
                    value,
                });
            }
        }
        Ok(self)
    }

    fn closed_loop(&self) -> Mat<f64> {
        self.problem.closed_loop(&self.k)
    }

    fn rows(&self) -> Vec<LawRow> {
        let step = add_scaled(&self.closed_loop(), -1.0, &identity(self.problem.states()));
        self.constraints.half_spaces(&self.k, &mul(&self.k, &step))
    }

    /// Checks every condition in floating point.
    #[must_use]
    pub fn certify(&self) -> Certificate {
        self.check(Rigour::Floating)
    }

    /// Proves or refutes every condition for the stored numbers.
    #[must_use]
    pub fn prove(&self) -> Certificate {
        self.check(Rigour::Exact)
    }

    fn check(&self, rigour: Rigour) -> Certificate {
        let exact = (rigour == Rigour::Exact).then(|| ExactLaw::of(self));
        let stage = self.problem.stage_cost(&self.k);
        let closed_loop = self.closed_loop();
        let fall = |p: &Mat<f64>| add_scaled(p, -1.0, &congruence(&closed_loop, p));
        let decrease = add_scaled(&fall(&self.cost), -self.decrease_fraction, &stage);
        let mut checks = bounds_of_cost(&self.cost, rigour);
        checks.push(semidefinite(
            "decrease",
            "P - A_K'PA_K - theta l >= 0",
            &decrease,
            norm(&self.cost),
            exact
                .as_ref()
                .map(|e| e.decrease(&self.cost, &self.cost, self.decrease_fraction)),
        ));
        checks.push(semidefinite(
            "invariance",
            "S - A_K'SA_K >= 0",
            &fall(&self.set),
            norm(&self.set),
            exact
                .as_ref()
                .map(|e| e.decrease(&self.set, &self.set, 0.0)),
        ));
        checks.extend(self.admissibility(exact.as_ref()));
        Certificate { rigour, checks }
    }

    fn admissibility(&self, exact: Option<&ExactLaw>) -> Vec<Check> {
        let set = Ellipsoid::with_level(self.set.as_ref(), self.level).ok();
        let rows = self.rows();
        let exact_rows = exact.map(|e| e.rows(&self.constraints, &e.change));
        rows.iter()
            .enumerate()
            .map(|(i, row)| {
                let proof = exact_rows
                    .as_ref()
                    .map(|rows| admissible(&self.set, self.level, &rows[i], row.bound));
                admissibility_check(set.as_ref(), row, proof)
            })
            .collect()
    }

    /// The nearest claim that can be proved: P raised and the level lowered by some roundings, with its exact certificate.
    ///
    /// # Errors
    /// The exact certificate of the last try, which says what stays false.
    pub fn provable(&self) -> Result<(Self, Certificate), Certificate> {
        let mut claim = self.clone();
        let shared = norm(&add_scaled(&self.set, -1.0, &self.cost)) == 0.0;
        let closed_loop = self.closed_loop();
        let Some(sum) = lyapunov_sum(&closed_loop, &identity(self.problem.states())) else {
            return Err(self.prove());
        };
        let grown = 1.0 + norm(&closed_loop).powi(2);
        let unit =
            |p: &Mat<f64>| 8.0 * self.problem.states() as f64 * f64::EPSILON * grown * norm(p);
        let mut certificate = claim.prove();
        let mut raise = 1.0;
        for _ in 0..16 {
            if certificate.holds() {
                return Ok((claim, certificate));
            }
            let raised = |p: &Mat<f64>| {
                let mut raised = add_scaled(p, raise * unit(p), &sum);
                symmetrise(&mut raised);
                raised
            };
            claim.cost = raised(&self.cost);
            claim.set = if shared {
                claim.cost.clone()
            } else {
                raised(&self.set)
            };
            // Raising S only shrinks the set, so the level needs no more than its own rounding.
            claim.level = self.level * (1.0 - raise * 64.0 * f64::EPSILON);
            certificate = claim.prove();
            raise *= 4.0;
        }
        Err(certificate)
    }
}

/// Exact A_K, stage cost and the change of the input under the law.
#[derive(Debug)]
pub(crate) struct ExactLaw {
    pub(crate) closed_loop: Exact,
    stage: Exact,
    pub(crate) k: Exact,
    change: Exact,
}

impl ExactLaw {
    fn of(claim: &TerminalClaim) -> Self {
        Self::new(&claim.problem, &claim.k)
    }

    pub(crate) fn new(problem: &Problem, k: &Mat<f64>) -> Self {
        let k = Exact::of(k);
        let closed_loop = Exact::of(&problem.a).add(&Exact::of(&problem.b).mul(&k));
        let mut stage = Exact::of(&problem.q).add(&Exact::of(&problem.r).congruence(&k));
        if let Some(s) = &problem.s {
            let sk = Exact::of(s).mul(&k);
            stage = stage.add(&sk).add(&sk.transpose());
        }
        let change = k.mul(&closed_loop.sub(&Exact::identity(problem.states())));
        Self {
            closed_loop,
            stage,
            k,
            change,
        }
    }

    /// Whether p - A_K' next A_K - theta l is positive semidefinite.
    pub(crate) fn decrease(&self, p: &Mat<f64>, next: &Mat<f64>, theta: f64) -> bool {
        let fall = Exact::of(p).sub(&Exact::of(next).congruence(&self.closed_loop));
        fall.sub(&self.stage.times(&Exact::number(theta)))
            .is_definite(false)
    }

    /// The rows f of the constraints for u = Kx and u+ - u = change x.
    pub(crate) fn rows(&self, constraints: &Constraints, change: &Exact) -> Vec<Exact> {
        let row = |values: &[f64]| Exact::of(&Mat::from_fn(1, values.len(), |_, j| values[j]));
        constraints
            .rows()
            .iter()
            .map(|c| {
                row(&c.on_x)
                    .add(&row(&c.on_u).mul(&self.k))
                    .add(&row(&c.on_rate).mul(change))
            })
            .collect()
    }
}

/// h^2 S - c f'f >= 0, decided exactly.
pub(crate) fn admissible(set: &Mat<f64>, level: f64, row: &Exact, bound: f64) -> bool {
    let bound = Exact::number(bound);
    let outer = row.transpose().mul(row).times(&Exact::number(level));
    Exact::of(set)
        .times(&bound.mul(&bound))
        .sub(&outer)
        .is_definite(false)
}

pub(crate) fn admissibility_check(
    set: Option<&Ellipsoid>,
    row: &LawRow,
    proof: Option<bool>,
) -> Check {
    let tolerance = if proof.is_some() { 0.0 } else { 1e-9 };
    let value = set
        .and_then(|set| set.support(&row.row).ok())
        .unwrap_or(f64::INFINITY);
    let factor = if value == 0.0 { 0.0 } else { value / row.bound };
    let margin = 1.0 - factor;
    let holds = proof.unwrap_or(margin >= -tolerance);
    let witness = set
        .filter(|_| !holds)
        .and_then(|set| set.extreme_point(&row.row).ok())
        .map(|state| Witness {
            state,
            value,
            bound: row.bound,
            factor,
        });
    Check {
        name: row.name.clone(),
        condition: format!("max over the set <= {}", row.bound),
        holds,
        margin,
        tolerance,
        witness,
    }
}

/// a <= V / |x|^2 <= b with the extreme eigenvalues, moved outwards past their rounding.
fn bounds_of_cost(p: &Mat<f64>, rigour: Rigour) -> Vec<Check> {
    let n = p.nrows();
    let values = p.self_adjoint_eigenvalues(Side::Lower).unwrap_or_default();
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = values.iter().copied().fold(0.0, f64::max);
    let rounding = 8.0 * n as f64 * f64::EPSILON * largest;
    let (lower, upper) = (least - rounding, largest + rounding);
    let scaled = |c: f64| Exact::identity(n).times(&Exact::number(c));
    let (below, above) = match rigour {
        Rigour::Floating => (cholesky(p).is_some() && least > 0.0, upper.is_finite()),
        Rigour::Exact if lower.is_finite() && upper.is_finite() => (
            // Where rounding hides the least eigenvalue the bound is not shown but P > 0 still is.
            Exact::of(p)
                .sub(&scaled(lower.max(0.0)))
                .is_definite(lower <= 0.0),
            scaled(upper).sub(&Exact::of(p)).is_definite(false),
        ),
        Rigour::Exact => (false, false),
    };
    let check = |name: &str, condition: &str, holds, margin| Check {
        name: name.to_owned(),
        condition: condition.to_owned(),
        holds,
        margin,
        tolerance: 0.0,
        witness: None,
    };
    vec![
        check(
            "lower bound",
            "V(x) >= margin |x|^2, V(x) > 0",
            below,
            lower.max(0.0),
        ),
        check("upper bound", "V(x) <= margin |x|^2", above, upper),
    ]
}

/// A check that `m` is positive semidefinite; `proof` overrides the floating-point verdict.
pub(crate) fn semidefinite(
    name: &str,
    condition: &str,
    m: &Mat<f64>,
    scale: f64,
    proof: Option<bool>,
) -> Check {
    let n = m.nrows();
    let tolerance = if proof.is_some() {
        0.0
    } else {
        64.0 * n as f64 * f64::EPSILON * scale
    };
    let mut margin = f64::NEG_INFINITY;
    let mut state = Vec::new();
    if let Ok(eigen) = m.self_adjoint_eigen(Side::Lower) {
        let values = eigen.S().column_vector();
        if let Some(least) = (0..n).min_by(|&i, &j| values[i].total_cmp(&values[j])) {
            margin = values[least];
            state = (0..n).map(|i| eigen.U()[(i, least)]).collect();
        }
    }
    let holds = proof.unwrap_or(margin >= -tolerance);
    let witness = (!holds).then(|| Witness {
        state,
        value: -margin,
        bound: 0.0,
        factor: f64::INFINITY,
    });
    Check {
        name: name.to_owned(),
        condition: condition.to_owned(),
        holds,
        margin,
        tolerance,
        witness,
    }
}
