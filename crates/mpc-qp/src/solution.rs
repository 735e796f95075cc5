//! What a solve gives back, in memory laid out once.

use crate::error::SolveError;
use crate::infeasibility::{Blame, InfeasibilityCertificate};
use crate::multipliers::{Multipliers, Slacks, TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::residuals::Residuals;
use crate::terminal::TerminalSet;
use nalgebra::SVector;
use std::time::Duration;

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a boxed blame would allocate inside a solve"
)]
pub enum SolveStatus {
    /// Optimal to the tolerance asked for, in the solver's scaling: no shared residual exceeds 100 times the tolerance or 1e-4,
    /// whichever is less (but not less than the tolerance itself). Stationarity counts relative to a tenth of the largest term of all
    /// gradients at least ([`Residuals::worst`]), everything else relative to its own condition.
    Solved,
    /// Optimal to a looser tolerance, 1000 times as large, between 1e-5 and 1e-3; read [`Solution::residuals`].
    SolvedInaccurate,
    /// No trajectory satisfies the hard constraints; [`Solution::multipliers`] is a ray that proves it of every trajectory with a
    /// 1-norm up to 1e6 (in the units of the solve) and up to ten times that of the trajectory in here; the certificate's residual says up to
    /// which in the given units.
    PrimalInfeasible {
        /// How good the proof is.
        certificate: InfeasibilityCertificate,
        /// The constraints in conflict.
        blame: Blame,
    },
    /// Stopped at the iteration limit.
    IterationLimit,
    /// Stopped at the time limit.
    TimeLimit,
    /// Stopped for lack of progress or a failed factorisation, or because the cost has no lower bound.
    NumericalTrouble,
}

impl SolveStatus {
    /// True for [`Self::Solved`] and [`Self::SolvedInaccurate`]: the trajectory may be used.
    #[must_use]
    pub fn has_solution(&self) -> bool {
        matches!(self, Self::Solved | Self::SolvedInaccurate)
    }

    /// An answer as good as was asked for, or a proof that there is none.
    pub(crate) fn is_settled(&self) -> bool {
        matches!(self, Self::Solved | Self::PrimalInfeasible { .. })
    }
}

/// Trajectory, multipliers and account of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution<const NX: usize, const NU: usize> {
    /// States `x_0..=x_N`.
    pub x: Vec<SVector<f64, NX>>,
    /// Inputs `u_0..u_{N-1}`.
    pub u: Vec<SVector<f64, NU>>,
    /// Multipliers; after [`SolveStatus::PrimalInfeasible`] the Farkas ray.
    pub multipliers: Multipliers<NX, NU>,
    /// Violations of soft constraints.
    pub slacks: Slacks<NX>,
    /// How the solve ended.
    pub status: SolveStatus,
    /// Cost at the solution, penalties included.
    pub objective: f64,
    /// Factorisations: active-set sweeps, interior-point iterations and Newton steps together; Clarabel's iterations of all its passes.
    pub iterations: usize,
    /// Optimality conditions, recomputed from the problem.
    pub residuals: Residuals,
    /// Wall time of the solve, assembly and extraction included; the time in which objective and residuals are recomputed is taken off.
    pub time: Duration,
}

impl<const NX: usize, const NU: usize> Solution<NX, NU> {
    /// Memory for the solutions of problems of this structure.
    #[must_use]
    pub fn new(problem: &OcpQp<NX, NU>) -> Self {
        Self {
            x: vec![SVector::zeros(); problem.horizon() + 1],
            u: vec![SVector::zeros(); problem.horizon()],
            multipliers: Multipliers::zeros(problem),
            slacks: Slacks::zeros(problem),
            status: SolveStatus::NumericalTrouble,
            objective: f64::NAN,
            iterations: 0,
            residuals: Residuals::default(),
            time: Duration::ZERO,
        }
    }

    /// Checks that this memory fits `problem`.
    ///
    /// # Errors
    /// [`SolveError::SolutionShape`] names what differs.
    pub fn check_shape(&self, problem: &OcpQp<NX, NU>) -> Result<(), SolveError> {
        let n = problem.horizon();
        let compare = |field, expected: usize, found: usize| match expected == found {
            true => Ok(()),
            false => Err(SolveError::SolutionShape {
                field,
                expected,
                found,
            }),
        };
        compare("x", n + 1, self.x.len())?;
        compare("u", n, self.u.len())?;
        compare("multipliers.costates", n, self.multipliers.costates.len())?;
        compare("multipliers.stages", n, self.multipliers.stages.len())?;
        compare("slacks.stages", n, self.slacks.stages.len())?;
        for (k, stage) in problem.stages().iter().enumerate() {
            compare(
                "multipliers.stages.rows",
                stage.rows.len(),
                self.multipliers.stages[k].rows.len(),
            )?;
            compare(
                "slacks.stages.rows",
                stage.rows.len(),
                self.slacks.stages[k].rows.len(),
            )?;
        }
        let (multipliers, slacks) = (&self.multipliers.terminal.set, &self.slacks.terminal.set);
        let fits = match (&problem.terminal().set, multipliers, slacks) {
            (
                TerminalSet::Polytope { faces },
                TerminalSetMultipliers::Polytope(m),
                TerminalSetSlacks::Polytope(s),
            ) => {
                compare("terminal set", faces.len(), m.len())?;
                s.len() == m.len()
            }
            (TerminalSet::None, TerminalSetMultipliers::None, TerminalSetSlacks::None)
            | (
                TerminalSet::Equality { .. },
                TerminalSetMultipliers::Equality(_),
                TerminalSetSlacks::Equality(_),
            )
            | (
                TerminalSet::Ellipsoid { .. },
                TerminalSetMultipliers::Ellipsoid { .. },
                TerminalSetSlacks::Ellipsoid(_),
            ) => true,
            _ => false,
        };
        compare("terminal set", 1, usize::from(fits))
    }

    /// Moves everything one stage ahead, as a guess for the next sample: stage k takes the values of k + 1, the last input is
    /// held, and `x_N` follows the last stage's dynamics. Multipliers move along; a stage whose row count differs from its
    /// successor's starts with zero row multipliers. Does not allocate. Status and residuals are those of the old problem.
    ///
    /// `problem` is the problem just solved.
    ///
    /// # Errors
    /// [`SolveError::SolutionShape`].
    pub fn shift(&mut self, problem: &OcpQp<NX, NU>) -> Result<(), SolveError> {
        self.check_shape(problem)?;
        let n = problem.horizon();
        self.x.copy_within(1.., 0);
        self.u.copy_within(1.., 0);
        self.x[n] = problem.stages()[n - 1].successor(&self.x[n - 1], &self.u[n - 1]);
        self.multipliers.costates.copy_within(1.., 0);
        for k in 0..n - 1 {
            let (head, tail) = self.multipliers.stages.split_at_mut(k + 1);
            let (to, from) = (&mut head[k], &tail[0]);
            let mut rows = std::mem::take(&mut to.rows);
            move_rows(&mut rows, &from.rows);
            *to = crate::multipliers::StageMultipliers { rows, ..*from };
            let (head, tail) = self.slacks.stages.split_at_mut(k + 1);
            let (to, from) = (&mut head[k], &tail[0]);
            move_rows(&mut to.rows, &from.rows);
            (to.x_min, to.x_max) = (from.x_min, from.x_max);
        }
        let first = &mut self.multipliers.stages[0];
        (first.x_min, first.x_max) = (SVector::zeros(), SVector::zeros());
        let first = &mut self.slacks.stages[0];
        (first.x_min, first.x_max) = (SVector::zeros(), SVector::zeros());
        Ok(())
    }
}

fn move_rows(to: &mut [f64], from: &[f64]) {
    if to.len() == from.len() {
        to.copy_from_slice(from);
    } else {
        to.fill(0.0);
    }
}
