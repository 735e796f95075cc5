//! The claim that a terminal cost, law and set fit together.
//!
//! For V = x'Px, a law u = Kx, a set { x'Sx <= c } and a fraction theta of the stage cost l (one unless said otherwise):
//! a <= V/|x|^2 <= b with a > 0; P - A_K'PA_K - theta (Q + SK + (SK)' + K'RK) >= 0, that is V(x+) - V(x) <= -theta l; S - A_K'SA_K >= 0, invariance; and
//! h^2 S - c f'f >= 0 for each row f x <= h under the law, admissibility.
//!
//! [`Rigour::Floating`] compares eigenvalues with zero up to rounding. [`Rigour::Exact`] decides every
//! matrix inequality in integer arithmetic on the stored doubles of A, B, Q, R, K, P, S, c and the rows: a proof, with no tolerance. A
//! Riccati solution in doubles misses equality by rounding in either direction, so its decrease is not provable as it stands:
//! [`TerminalClaim::provable`] adds to P a multiple of the sum of A_K'^j A_K^j, some roundings in size, and lowers c by as much as it takes.

use crate::arithmetic::dense::{add_scaled, congruence, identity, mul, norm, symmetrise};
use crate::certificate::checks::{
    ExactLaw, admissibility_check, admissible, bounds_of_cost, malformed, semidefinite,
};
use crate::certificate::record::{Certificate, Check, Rigour};
use crate::input::{self, InputError};
use crate::modes::spectrum::lyapunov_sum;
use crate::riccati::dare::Dare;
use crate::riccati::dare_solution::DareSolution;
use crate::riccati::problem::Problem;
use crate::terminal_set::constraints::{Constraints, LawRow};
use crate::terminal_set::ellipsoid::{Ellipsoid, TerminalSetError};
use faer::Mat;

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
        self.validate()?;
        Ok(self)
    }

    /// The fields are public: whoever changed them, a certificate speaks of numbers that make a claim.
    fn validate(&self) -> Result<(), InputError> {
        let (n, m) = (self.problem.states(), self.problem.b.ncols());
        input::matrix("K", self.k.as_ref(), (m, n))?;
        input::symmetric("P", self.cost.as_ref(), n)?;
        input::symmetric("set", self.set.as_ref(), n)?;
        input::finite_not_negative("level", self.level)?;
        // V must fall: a fraction of zero claims nothing.
        input::finite_not_negative("decrease_fraction", self.decrease_fraction)?;
        if self.decrease_fraction == 0.0 {
            return Err(InputError::Zero {
                name: "decrease_fraction",
            });
        }
        Ok(())
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
        if let Err(error) = self.validate() {
            return malformed(rigour, &error);
        }
        let exact = (rigour == Rigour::Exact).then(|| ExactLaw::new(&self.problem, &self.k));
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
        if let Err(error) = self.validate() {
            return Err(malformed(Rigour::Exact, &error));
        }
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
