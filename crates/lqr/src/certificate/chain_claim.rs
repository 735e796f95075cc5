//! Certificates of a chain: V(i, x) = x'P_i x, laws K_i, sets X_i = { V(i, x) <= c_i }.
//!
//! The last cost is positive definite. For each stage i: V(i+1, x+) - V(i, x) <= -l, that is P_i - A_i'P_{i+1}A_i - l_i >= 0 with A_i the closed loop; c_i <= c_{i+1}, so that X_i maps into X_{i+1};
//! and every row of the constraints over X_i. A rate there is K_{i+1}x+ - K_i x; after the last stage its own gain is taken to go on.
//! What follows the last set is the caller's: a terminal set certified on its own.

use crate::arithmetic::dense::{add_scaled, congruence, identity, mul, norm, symmetrise};
use crate::arithmetic::exact::Exact;
use crate::certificate::checks::{
    ExactLaw, admissibility_check, admissible, bounds_of_cost, malformed, semidefinite,
};
use crate::certificate::record::{Certificate, Check, Rigour};
use crate::chain::backward::{BackwardChain, Stage, validated};
use crate::chain::error::ChainError;
use crate::input::{self, InputError};
use crate::riccati::problem::Problem;
use crate::terminal_set::constraints::{Constraints, LawRow};
use crate::terminal_set::ellipsoid::{Ellipsoid, TerminalSetError, chain_levels};
use faer::Mat;

/// Costs, laws and sets of a chain, and the claim that they fit together.
#[derive(Debug, Clone)]
pub struct ChainClaim {
    problems: Vec<Problem>,
    constraints: Constraints,
    /// P_0..P_T, n x n.
    pub p: Vec<Mat<f64>>,
    /// K_0..K_{T-1}, m x n.
    pub k: Vec<Mat<f64>>,
    /// c_0..c_T.
    pub levels: Vec<f64>,
}

/// Why a chain could not be sized.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChainClaimError {
    /// The stages are malformed.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// A P is not positive definite, or the shapes do not fit.
    #[error(transparent)]
    Set(#[from] TerminalSetError),
}

impl ChainClaim {
    /// The largest nested level sets of a chain under the same constraints at every stage, the last at most `terminal_level`.
    ///
    /// # Errors
    /// [`ChainClaimError`] for data that do not fit, a P that is not positive definite, a `terminal_level` that is NaN or negative.
    pub fn largest(
        stages: &[Stage<'_>],
        chain: &BackwardChain,
        constraints: Constraints,
        terminal_level: f64,
    ) -> Result<Self, ChainClaimError> {
        let problems = validated(stages)?;
        let mut claim = Self {
            problems,
            constraints,
            p: chain.p.clone(),
            k: chain.k.clone(),
            levels: Vec::new(),
        };
        claim.validate_matrices().map_err(TerminalSetError::from)?;
        input::not_negative("terminal_level", terminal_level).map_err(TerminalSetError::from)?;
        for (problem, k) in claim.problems.iter().zip(&claim.k) {
            claim
                .constraints
                .under_law(problem.a.as_ref(), problem.b.as_ref(), k.as_ref())
                .map_err(TerminalSetError::from)?;
        }
        let horizon = claim.problems.len();
        let rows: Vec<Vec<LawRow>> = (0..=horizon)
            .map(|i| {
                if i < horizon {
                    claim.rows(i)
                } else {
                    Vec::new()
                }
            })
            .collect();
        let mut sets = chain_levels(&claim.p, &rows)?;
        let mut next = terminal_level;
        for set in sets.iter_mut().rev() {
            set.level = set.level.min(next);
            next = set.level;
        }
        claim.levels = sets.iter().map(|set| set.level).collect();
        Ok(claim)
    }

    /// As many P and K as the stages ask for, each of its shape.
    fn validate_matrices(&self) -> Result<(), InputError> {
        let horizon = self.problems.len();
        counted("P", self.p.len(), horizon + 1)?;
        counted("K", self.k.len(), horizon)?;
        let n = self.problems[0].states();
        for p in &self.p {
            input::symmetric("P", p.as_ref(), n)?;
        }
        for (problem, k) in self.problems.iter().zip(&self.k) {
            input::matrix("K", k.as_ref(), (problem.b.ncols(), n))?;
        }
        Ok(())
    }

    /// The fields are public: whoever changed them, a certificate speaks of numbers that make a claim.
    fn validate(&self) -> Result<(), InputError> {
        self.validate_matrices()?;
        counted("levels", self.levels.len(), self.p.len())?;
        for &level in &self.levels {
            input::finite_not_negative("level", level)?;
        }
        Ok(())
    }

    /// Checks every stage in floating point.
    #[must_use]
    pub fn certify(&self) -> Certificate {
        self.check(Rigour::Floating)
    }

    /// Proves or refutes every stage for the stored numbers.
    #[must_use]
    pub fn prove(&self) -> Certificate {
        self.check(Rigour::Exact)
    }

    /// The nearest chain that can be proved: each P_i raised by a multiple of S_i = A_i'S_{i+1}A_i + I, some roundings in size.
    ///
    /// # Errors
    /// The exact certificate of the last try.
    pub fn provable(&self) -> Result<(Self, Certificate), Certificate> {
        if let Err(error) = self.validate() {
            return Err(malformed(Rigour::Exact, &error));
        }
        let horizon = self.problems.len();
        let n = self.p[0].nrows();
        let mut sums = vec![identity(n); horizon + 1];
        let mut size = norm(&self.p[horizon]);
        for i in (0..horizon).rev() {
            let closed_loop = self.problems[i].closed_loop(&self.k[i]);
            sums[i] = add_scaled(&congruence(&closed_loop, &sums[i + 1]), 1.0, &identity(n));
            size = size.max(norm(&self.p[i]) * (1.0 + norm(&closed_loop).powi(2)));
        }
        let unit = 8.0 * n as f64 * f64::EPSILON * size;
        let (mut claim, mut raise) = (self.clone(), 1.0);
        let mut certificate = claim.prove();
        for _ in 0..16 {
            if certificate.holds() {
                return Ok((claim, certificate));
            }
            for i in 0..=horizon {
                claim.p[i] = add_scaled(&self.p[i], raise * unit, &sums[i]);
                symmetrise(&mut claim.p[i]);
                claim.levels[i] = self.levels[i] * (1.0 - raise * 64.0 * f64::EPSILON);
            }
            certificate = claim.prove();
            raise *= 4.0;
        }
        Err(certificate)
    }

    /// The gain after stage i: the next stage's, or the same where there is none.
    fn gain_after(&self, i: usize) -> &Mat<f64> {
        self.k.get(i + 1).unwrap_or(&self.k[i])
    }

    fn rows(&self, i: usize) -> Vec<LawRow> {
        let after = mul(
            self.gain_after(i),
            &self.problems[i].closed_loop(&self.k[i]),
        );
        self.constraints
            .half_spaces(&self.k[i], &add_scaled(&after, -1.0, &self.k[i]))
    }

    fn check(&self, rigour: Rigour) -> Certificate {
        if let Err(error) = self.validate() {
            return malformed(rigour, &error);
        }
        // The decrease carries the bounds of the last cost back through the chain.
        let mut checks = bounds_of_cost(&self.p[self.problems.len()], rigour);
        for (i, problem) in self.problems.iter().enumerate() {
            let exact = (rigour == Rigour::Exact).then(|| ExactLaw::new(problem, &self.k[i]));
            let (p, next) = (&self.p[i], &self.p[i + 1]);
            let fall = add_scaled(p, -1.0, &congruence(&problem.closed_loop(&self.k[i]), next));
            checks.push(semidefinite(
                &format!("decrease {i} to {}", i + 1),
                "P_i - A_i'P_{i+1}A_i - l_i >= 0",
                &add_scaled(&fall, -1.0, &problem.stage_cost(&self.k[i])),
                norm(p).max(norm(next)),
                exact.as_ref().map(|e| e.decrease(p, next, 1.0)),
            ));
            checks.push(nested(i, self.levels[i], self.levels[i + 1]));
            checks.extend(self.admissibility(i, exact.as_ref()));
        }
        Certificate { rigour, checks }
    }

    fn admissibility(&self, i: usize, exact: Option<&ExactLaw>) -> Vec<Check> {
        let set = Ellipsoid::with_level(self.p[i].as_ref(), self.levels[i]).ok();
        let proofs: Option<Vec<Exact>> = exact.map(|e| {
            let after = Exact::of(self.gain_after(i)).mul(&e.closed_loop);
            e.rows(&self.constraints, &after.sub(&e.k))
        });
        let check = |(at, row): (usize, &LawRow)| {
            let proof = proofs
                .as_ref()
                .map(|rows| admissible(&self.p[i], self.levels[i], &rows[at], row.bound));
            let mut check = admissibility_check(set.as_ref(), row, proof);
            check.name = format!("{} at {i}", check.name);
            check
        };
        self.rows(i).iter().enumerate().map(check).collect()
    }
}

fn counted(name: &'static str, found: usize, expected: usize) -> Result<(), InputError> {
    if found == expected {
        return Ok(());
    }
    Err(InputError::Shape {
        name,
        expected: (expected, 1),
        found: (found, 1),
    })
}

fn nested(i: usize, level: f64, next: f64) -> Check {
    Check {
        name: format!("level {i} to {}", i + 1),
        condition: "c_i <= c_{i+1}".to_owned(),
        holds: level <= next,
        margin: next - level,
        tolerance: 0.0,
        witness: None,
    }
}
