//! The general conic solver behind the problem type: one sparse conic program
//! `min 1/2 z'P z + q'z, A z + s = b, s in K`, solved by Clarabel (Goulart & Chen).
//!
//! The unknowns are `z = (u_0, x_1, u_1, ..., x_N, slacks)`; `x_0` is data. The sparse pattern is made once with faer and the
//! values are written into it in place, then handed over by Clarabel's data update. A rebuild happens only if the structure
//! changes: another horizon or row count, a bound that was infinite when the pattern was made, a nonzero where all stages
//! had zero. [`ClarabelSolver::builds`] counts them.
//!
//! Clarabel restarts from its own initial point on every solve. There is no warm start: [`Start::Warm`] is accepted and has no
//! effect.

mod assembly;
mod extraction;
mod inequality;
mod layout;
mod pattern;
mod target;
#[cfg(test)]
mod tests;

use crate::error::SolveError;
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::solution::{Solution, SolveStatus};
use crate::solver::{OcpSolver, SolverSettings, Start, accurate_residual, usable_residual};
use crate::terminal::TerminalSet;
use assembly::{assemble, cost_scale};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SupportedConeT};
use layout::Layout;
use pattern::Pattern;
use std::time::{Duration, Instant};
use target::{Indices, Values};

/// Clarabel with the sparse pattern of one problem structure. Clarabel's own solver cannot be copied: a clone makes its own at its
/// first solve.
pub struct ClarabelSolver<const NX: usize, const NU: usize> {
    layout: Layout<NX, NU>,
    cost: Pattern,
    constraints: Pattern,
    linear: Vec<f64>,
    right: Vec<f64>,
    solver: Option<DefaultSolver<f64>>,
    settings: SolverSettings,
    cost_scale: f64,
    /// Spent on residuals in the present solve.
    judging: Duration,
    builds: usize,
}

impl<const NX: usize, const NU: usize> Clone for ClarabelSolver<NX, NU> {
    fn clone(&self) -> Self {
        Self {
            layout: self.layout.clone(),
            cost: self.cost.clone(),
            constraints: self.constraints.clone(),
            linear: self.linear.clone(),
            right: self.right.clone(),
            solver: None,
            ..*self
        }
    }
}

impl<const NX: usize, const NU: usize> std::fmt::Debug for ClarabelSolver<NX, NU> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("ClarabelSolver")
            .field("unknowns", &self.linear.len())
            .field("rows", &self.right.len())
            .field("settings", &self.settings)
            .field("builds", &self.builds)
            .finish_non_exhaustive()
    }
}

impl<const NX: usize, const NU: usize> ClarabelSolver<NX, NU> {
    /// Lays out the pattern for problems like `problem`.
    ///
    /// # Errors
    /// [`SolveError::Setting`], or what faer or Clarabel refuse.
    pub fn new(problem: &OcpQp<NX, NU>, settings: SolverSettings) -> Result<Self, SolveError> {
        settings.validate()?;
        Self::build(problem, Layout::new(problem), settings, 1)
    }

    /// How often the pattern was made: 1 as long as the structure stays; a clone counts on from here, and one more at its first solve.
    #[must_use]
    pub fn builds(&self) -> usize {
        self.builds
    }

    /// Nonzeros of the upper triangle of P and of A.
    #[must_use]
    pub fn nonzeros(&self) -> (usize, usize) {
        (self.cost.values().len(), self.constraints.values().len())
    }

    fn build(
        problem: &OcpQp<NX, NU>,
        layout: Layout<NX, NU>,
        settings: SolverSettings,
        builds: usize,
    ) -> Result<Self, SolveError> {
        let (columns, rows) = (layout.columns(), layout.rows());
        let mut indices = Indices::default();
        assemble(problem, &layout, &mut indices);
        let mut cost = Pattern::new(columns, columns, &indices.cost)?;
        let mut constraints = Pattern::new(rows, columns, &indices.constraints)?;
        let (mut linear, mut right) = (vec![0.0; columns], vec![0.0; rows]);
        let scale = cost_scale(problem);
        let mut values = Values::new(&mut cost, &mut constraints, &mut linear, &mut right, scale);
        assemble(problem, &layout, &mut values);
        let solver = DefaultSolver::new(
            &csc(&cost),
            &linear,
            &csc(&constraints),
            &right,
            &cones(&layout),
            clarabel_settings(&settings),
        )?;
        Ok(Self {
            layout,
            cost,
            constraints,
            linear,
            right,
            solver: Some(solver),
            settings,
            cost_scale: scale,
            judging: Duration::ZERO,
            builds,
        })
    }

    /// Brings the solver to the present values of `problem`.
    fn refill(&mut self, problem: &OcpQp<NX, NU>) -> Result<(), SolveError> {
        if self.solver.is_none() || !self.layout.covers(problem) {
            let layout = self.layout.extended_to(problem);
            *self = Self::build(problem, layout, self.settings, self.builds + 1)?;
            return Ok(());
        }
        self.cost_scale = cost_scale(problem);
        self.write(problem, self.cost_scale)
    }

    /// Writes the values, the cost multiplied by `cost_scale`, and hands them over.
    fn write(&mut self, problem: &OcpQp<NX, NU>, cost_scale: f64) -> Result<(), SolveError> {
        let mut values = Values::new(
            &mut self.cost,
            &mut self.constraints,
            &mut self.linear,
            &mut self.right,
            cost_scale,
        );
        assemble(problem, &self.layout, &mut values);
        // Clarabel reads an empty update as "no change": a matrix without entries is passed over.
        if let Some(solver) = &mut self.solver {
            solver.update_P(self.cost.values())?;
            solver.update_q(&self.linear)?;
            solver.update_A(self.constraints.values())?;
            solver.update_b(&self.right)?;
        }
        Ok(())
    }
}

impl<const NX: usize, const NU: usize> OcpSolver<NX, NU> for ClarabelSolver<NX, NU> {
    fn set_time_limit(&mut self, limit: Option<Duration>) {
        self.settings.time_limit = limit;
    }

    fn solve(
        &mut self,
        problem: &OcpQp<NX, NU>,
        _start: Start,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError> {
        solution.check_shape(problem)?;
        let clock = Instant::now();
        self.refill(problem)?;
        self.judging = Duration::ZERO;
        self.run(problem, solution);
        let gap = solution
            .residuals
            .complementarity
            .relative()
            .max(price_of_violation(problem, solution));
        let in_time = self
            .settings
            .time_limit
            .is_none_or(|limit| clock.elapsed() * 2 < limit);
        let rest = SolverSettings {
            max_iterations: self
                .settings
                .max_iterations
                .saturating_sub(solution.iterations),
            time_limit: self
                .settings
                .time_limit
                .map(|limit| limit.saturating_sub(clock.elapsed())),
            ..self.settings
        };
        let again = in_time && rest.max_iterations > 0;
        if solution.status == SolveStatus::Solved && gap > LOOSE * self.settings.tolerance && again
        {
            self.run_again(problem, gap, &rest, solution)?;
        } else if again && self.unproved(solution.status) {
            self.run_without_cost(problem, &rest, solution)?;
        }
        solution.time = clock.elapsed().saturating_sub(self.judging);
        solution.status = self.graded(solution);
        Ok(())
    }
}

impl<const NX: usize, const NU: usize> ClarabelSolver<NX, NU> {
    /// Solves with the values in place. The status is Clarabel's own, certificates checked.
    fn run(&mut self, problem: &OcpQp<NX, NU>, solution: &mut Solution<NX, NU>) {
        let Some(solver) = &mut self.solver else {
            return;
        };
        solver.solve();
        let price = self.cost_scale.recip();
        extraction::extract(problem, &self.layout, &solver.solution, price, solution);
        let judging = Instant::now();
        solution.evaluate(problem);
        self.judging += judging.elapsed();
        let usable = usable_residual(self.settings.tolerance);
        solution.status = extraction::status(problem, solver.solution.status, usable, solution);
    }

    /// A second pass with tolerances that ask in the problem's units what the first asked in scaled ones: where the
    /// optimal cost is small beside the largest weight, 1e-8 of the scaled cost is too loose, and where it is small beside a costate,
    /// so is 1e-8 in the dynamics. The better answer is kept.
    fn run_again(
        &mut self,
        problem: &OcpQp<NX, NU>,
        gap: f64,
        rest: &SolverSettings,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError> {
        let first = solution.clone();
        let tighter = (self.settings.tolerance * self.settings.tolerance / gap).max(1e-14);
        self.set(rest, tighter)?;
        self.run(problem, solution);
        let usual = self.settings;
        self.set(&usual, usual.tolerance)?;
        let iterations = first.iterations + solution.iterations;
        let stopped_short = !solution.status.has_solution();
        let error = |solution: &Solution<NX, NU>| {
            let price = price_of_violation(problem, solution);
            solution.residuals.worst().max(price)
        };
        if stopped_short || error(&first) < error(solution) {
            *solution = first;
        }
        // Both are solved to the tolerance asked for, though not to the tighter one; the residuals have the last word.
        solution.status = SolveStatus::Solved;
        solution.iterations = iterations;
        Ok(())
    }

    /// Whether the solve broke down, or ended with a ray that proves less than it might.
    fn unproved(&self, status: SolveStatus) -> bool {
        match status {
            SolveStatus::PrimalInfeasible { certificate, .. } => {
                certificate.residual > ACCURATE * self.settings.tolerance
            }
            status => status == SolveStatus::NumericalTrouble,
        }
    }

    /// A pass with zero cost: whether the constraints contradict each other does not depend on the cost, and without it
    /// Clarabel measures the ray against nothing but the ray. The better proof is kept.
    fn run_without_cost(
        &mut self,
        problem: &OcpQp<NX, NU>,
        rest: &SolverSettings,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError> {
        let first = solution.clone();
        self.write(problem, 0.0)?;
        self.set(rest, rest.tolerance)?;
        self.run(problem, solution);
        let usual = self.settings;
        self.set(&usual, usual.tolerance)?;
        let iterations = first.iterations + solution.iterations;
        if proof_residual(solution.status) >= proof_residual(first.status) {
            *solution = first;
        }
        solution.iterations = iterations;
        Ok(())
    }

    /// Sets limits, and the tolerances of gap and feasibility apart from the others.
    fn set(&mut self, limits: &SolverSettings, tolerance: f64) -> Result<(), SolveError> {
        let mut settings = clarabel_settings(limits);
        (settings.tol_gap_abs, settings.tol_gap_rel) = (tolerance, tolerance);
        settings.tol_feas = tolerance;
        if let Some(solver) = &mut self.solver {
            let updated = solver.update_settings(settings);
            updated.map_err(clarabel::solver::SolverError::from)?;
        }
        Ok(())
    }

    /// The status that the shared residuals support, for all statuses that claim an answer or stopped short of one.
    fn graded(&self, solution: &Solution<NX, NU>) -> SolveStatus {
        let worst = solution.residuals.worst();
        let tolerance = self.settings.tolerance;
        match solution.status {
            // Clarabel measures stationarity relative to |x|: an unbounded problem can drive x up until it says `Solved`.
            SolveStatus::Solved if worst > usable_residual(tolerance) => {
                SolveStatus::NumericalTrouble
            }
            SolveStatus::Solved if worst > accurate_residual(tolerance) => {
                SolveStatus::SolvedInaccurate
            }
            SolveStatus::PrimalInfeasible { certificate, .. }
                if certificate.residual > LEAST_PROOF
                    || certificate.sign_violation > PROOF_SIGNS =>
            {
                SolveStatus::NumericalTrouble
            }
            SolveStatus::SolvedInaccurate if worst <= self.settings.tolerance => {
                SolveStatus::Solved
            }
            status => status,
        }
    }
}

/// What the violated equalities are worth, relative to the objective: the sum of |multiplier| times violation. By so much the cost of an
/// almost feasible point may lie beside the optimal one; the inequalities' part is in the complementarity already.
fn price_of_violation<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
) -> f64 {
    let (x, u) = (&solution.x, &solution.u);
    let of_dynamics: f64 = (problem.stages().iter().enumerate())
        .map(|(k, stage)| {
            let violation = stage.successor(&x[k], &u[k]) - x[k + 1];
            violation.abs().dot(&solution.multipliers.costates[k].abs())
        })
        .sum();
    let of_target = match (
        &problem.terminal().set,
        &solution.multipliers.terminal.set,
        &solution.slacks.terminal.set,
    ) {
        (
            TerminalSet::Equality { target },
            TerminalSetMultipliers::Equality(multiplier),
            TerminalSetSlacks::Equality(slack),
        ) => (x[problem.horizon()] - target - slack)
            .abs()
            .dot(&multiplier.abs()),
        _ => 0.0,
    };
    (of_dynamics + of_target) / solution.objective.abs().max(1.0)
}

/// Residual of the ray, infinite without one.
fn proof_residual(status: SolveStatus) -> f64 {
    match status {
        SolveStatus::PrimalInfeasible { certificate, .. } => certificate.residual,
        _ => f64::INFINITY,
    }
}

/// Multiple of the tolerance at which the relative duality gap calls for a second pass.
const LOOSE: f64 = 10.0;

/// Residual of a ray above which it proves nothing: trajectories of a 1-norm of 1e4 might be feasible.
const LEAST_PROOF: f64 = 1e-4;

/// Wrong signs above which a ray proves nothing.
const PROOF_SIGNS: f64 = 1e-7;

/// Multiple of the tolerance that the residual of a ray may reach without a second look.
const ACCURATE: f64 = 100.0;

fn csc(pattern: &Pattern) -> CscMatrix<f64> {
    let (rows, columns) = pattern.shape();
    CscMatrix::new(
        rows,
        columns,
        pattern.column_starts().to_vec(),
        pattern.row_indices().to_vec(),
        pattern.values().clone(),
    )
}

fn cones<const NX: usize, const NU: usize>(layout: &Layout<NX, NU>) -> Vec<SupportedConeT<f64>> {
    let mut cones = vec![
        SupportedConeT::ZeroConeT(layout.equalities()),
        SupportedConeT::NonnegativeConeT(layout.scalar_rows()),
    ];
    if layout.has_cone() {
        cones.push(SupportedConeT::SecondOrderConeT(NX + 1));
    }
    cones
}

/// Presolve and zero dropping would forbid updates. Refinement stays at its defaults: it is what keeps Clarabel right.
fn clarabel_settings(settings: &SolverSettings) -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        presolve_enable: false,
        input_sparse_dropzeros: false,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        max_iter: u32::try_from(settings.max_iterations).unwrap_or(u32::MAX),
        time_limit: settings
            .time_limit
            .map_or(f64::INFINITY, |limit| limit.as_secs_f64()),
        tol_gap_abs: settings.tolerance,
        tol_gap_rel: settings.tolerance,
        tol_feas: settings.tolerance,
        tol_infeas_abs: settings.tolerance,
        tol_infeas_rel: settings.tolerance,
        ..DefaultSettings::default()
    }
}
