//! The passes of a solve: the first, and what follows where it leaves something open.
//!
//! A gap or an error in the dynamics that is worth too much calls for a second pass with tighter tolerances, an end without answer or proof
//! for a pass without cost. The shared residuals have the last word on the status.

use super::{ClarabelSolver, clarabel_settings, extraction};
use crate::error::SolveError;
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::solution::{Solution, SolveStatus};
use crate::solver::{SolverSettings, graded, usable_residual};
use crate::terminal::TerminalSet;
use crate::units::Natural;
use clarabel::solver::IPSolver;
use std::time::{Duration, Instant};

impl<const NX: usize, const NU: usize> ClarabelSolver<NX, NU> {
    /// Solves a problem in the units that it is in, within what `clock` leaves of the time limit; `error` is the error of an answer
    /// in the units that count.
    pub(super) fn solve_in(
        &mut self,
        clock: &Instant,
        problem: &OcpQp<NX, NU>,
        solution: &mut Solution<NX, NU>,
        mut error: impl FnMut(&Solution<NX, NU>) -> f64,
    ) -> Result<(), SolveError> {
        self.refill(problem)?;
        let usual = self.settings;
        self.set(&usual, usual.tolerance)?;
        self.run(problem, solution);
        let found = error(solution);
        if solution.status.has_solution()
            && found > LOOSE * usual.tolerance
            && let Some(rest) = self.rest(clock, solution)
        {
            self.run_again(problem, found, &rest, solution, error)?;
        }
        solution.status = self.graded(solution);
        if solution.status == SolveStatus::NumericalTrouble
            && let Some(rest) = self.rest(clock, solution)
        {
            self.run_without_cost(problem, &rest, solution)?;
        }
        Ok(())
    }

    /// Solves a problem as given, with an equilibration of its own, where own units ended neither solved nor refuted; the better answer is
    /// kept.
    pub(super) fn mend_as_given(
        &mut self,
        clock: &Instant,
        problem: &OcpQp<NX, NU>,
        natural: &Natural<NX, NU>,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError> {
        if solution.status.is_settled() || self.rest(clock, solution).is_none() {
            return Ok(());
        }
        if self.as_given.is_none() {
            let second = Self::build(problem, self.layout.clone(), self.settings, 1)?;
            self.as_given = Some(Box::new(second));
        }
        // Only now: making it takes time.
        let Some(rest) = self.rest(clock, solution) else {
            return Ok(());
        };
        let Some(mut second) = self.as_given.take() else {
            return Ok(());
        };
        let mut other = solution.clone();
        (second.settings, second.judging) = (rest, Duration::ZERO);
        second.solve_in(&Instant::now(), problem, &mut other, |found| {
            error(problem, found)
        })?;
        self.judging += second.judging;
        self.as_given = Some(second);
        let iterations = solution.iterations + other.iterations;
        let judging = Instant::now();
        let (status, worst) = natural.judged_inside(&other, &mut other.clone(), rest.tolerance);
        self.judging += judging.elapsed();
        other.status = status;
        let nearer = other.residuals.worst().max(worst) < solution.residuals.worst();
        let answered = solution.status.has_solution();
        match other.status {
            SolveStatus::Solved => *solution = other,
            SolveStatus::SolvedInaccurate if nearer || !answered => *solution = other,
            SolveStatus::PrimalInfeasible { .. } if !answered => *solution = other,
            // Two stops without an answer: what ended the second is what ended the solve.
            SolveStatus::TimeLimit | SolveStatus::IterationLimit if !answered => {
                solution.status = other.status;
            }
            _ => {}
        }
        solution.iterations = iterations;
        Ok(())
    }

    /// What is left of the limits, if it is worth another pass.
    fn rest(&self, clock: &Instant, solution: &Solution<NX, NU>) -> Option<SolverSettings> {
        let (usual, elapsed) = (self.settings, clock.elapsed());
        let in_time = usual.time_limit.is_none_or(|limit| elapsed * 2 < limit);
        let max_iterations = usual.max_iterations.saturating_sub(solution.iterations);
        (in_time && max_iterations > 0).then_some(SolverSettings {
            max_iterations,
            time_limit: usual.time_limit.map(|limit| limit.saturating_sub(elapsed)),
            ..usual
        })
    }

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
        found: f64,
        rest: &SolverSettings,
        solution: &mut Solution<NX, NU>,
        mut error: impl FnMut(&Solution<NX, NU>) -> f64,
    ) -> Result<(), SolveError> {
        let first = solution.clone();
        let tighter = (self.settings.tolerance * self.settings.tolerance / found).max(1e-14);
        self.set(rest, tighter)?;
        self.run(problem, solution);
        let iterations = first.iterations + solution.iterations;
        let stopped_short = !solution.status.has_solution();
        let status = first.status;
        if stopped_short || found < error(solution) {
            *solution = first;
        }
        // The first is solved to the tolerance asked for, though not to the tighter one; the residuals have the last word.
        if status == SolveStatus::Solved {
            solution.status = SolveStatus::Solved;
        }
        solution.iterations = iterations;
        Ok(())
    }

    /// A pass with zero cost: whether the constraints contradict each other does not depend on the cost, and without it
    /// Clarabel measures the ray against nothing but the ray. Only a proof is kept.
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
        let iterations = first.iterations + solution.iterations;
        solution.status = self.graded(solution);
        if !matches!(solution.status, SolveStatus::PrimalInfeasible { .. }) {
            *solution = first;
        }
        solution.iterations = iterations;
        Ok(())
    }

    /// Sets limits, and the tolerances of gap and feasibility apart from the others.
    fn set(&mut self, limits: &SolverSettings, tolerance: f64) -> Result<(), SolveError> {
        let settings = clarabel_settings(limits, tolerance);
        if let Some(solver) = &mut self.solver {
            let updated = solver.update_settings(settings);
            updated.map_err(clarabel::solver::SolverError::from)?;
        }
        Ok(())
    }

    /// The status that the shared residuals support: Clarabel measures stationarity relative to |x|, and an unbounded problem can drive x up
    /// until it says `Solved`.
    fn graded(&self, solution: &Solution<NX, NU>) -> SolveStatus {
        let tolerance = self.settings.tolerance;
        graded(
            solution.status,
            &solution.residuals,
            solution.objective,
            tolerance,
        )
    }
}

/// What is wrong with an answer: the gap and the price of violated equalities, and a tenth of the worst residual.
pub(super) fn error<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
) -> f64 {
    let residuals = &solution.residuals;
    let gap = residuals.complementarity.absolute / cost_size(solution);
    gap.max(price_of_violation(problem, solution))
        .max(0.1 * residuals.worst())
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
    (of_dynamics + of_target) / cost_size(solution)
}

/// What errors in the cost are compared with: the cost itself, unless it is next to nothing.
fn cost_size<const NX: usize, const NU: usize>(solution: &Solution<NX, NU>) -> f64 {
    solution.objective.abs().max(1e-5)
}

/// Multiple of the tolerance at which the relative duality gap calls for a second pass.
const LOOSE: f64 = 10.0;
