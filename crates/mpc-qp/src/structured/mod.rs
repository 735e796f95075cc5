//! Structured interior point with an active-set path, on memory allocated once.
//!
//! See `docs/solver.md` for the derivation. A solve tries active-set sweeps first (`active`): from the last answer if there is one,
//! else from the feedback without bounds, clipped. Where they do not settle, Mehrotra's predictor-corrector (`interior`) takes over
//! and hands its guess of the active set back as soon as it has one. What that leaves open, a slower method of multipliers
//! decides (`careful`). Every answer is checked against the optimality
//! conditions before it is called solved.

mod active;
mod bounds;
mod careful;
mod channel;
mod clipping;
mod cone;
mod elimination;
mod handover;
mod interior;
mod kernel;
mod lanes;
mod load;
mod newton;
mod parts;
mod passes;
mod penalty;
mod read;
mod riccati;
mod soft;
mod solves;
mod start;
mod sweeps;
mod terms;
mod verdict;
mod write;

#[cfg(test)]
mod tests;

use crate::error::SolveError;
use crate::problem::OcpQp;
use crate::solution::{Solution, SolveStatus};
use crate::solver::{OcpSolver, SolverSettings, Start, graded};
use crate::units::Natural;
use kernel::{Lanes, Phase, run};
use newton::Newton;
use solves::Costates;
use std::time::{Duration, Instant};
use verdict::all_finite;

/// Structured interior-point solver.
#[derive(Clone, Debug)]
pub struct StructuredSolver<const NX: usize, const NU: usize> {
    settings: SolverSettings,
    newton: Newton<NX, NU>,
    costates: Vec<nalgebra::SVector<f64, NX>>,
    /// The answer before the careful pass.
    first: Solution<NX, NU>,
    /// The problem in its own units, there except during a solve in them.
    natural: Option<Box<Natural<NX, NU>>>,
    started: Instant,
    /// Spent on residuals.
    judging: Duration,
    iterations: usize,
    /// The largest unit of the values at hand, at least one: their distances from bounds count in the given units too.
    unit: f64,
}

struct Load<'a, const NX: usize, const NU: usize>(&'a mut Newton<NX, NU>, &'a OcpQp<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for Load<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.load(lanes, self.1);
    }
}

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Memory for problems of the structure of `problem`.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for settings outside their ranges.
    pub fn new(problem: &OcpQp<NX, NU>, settings: SolverSettings) -> Result<Self, SolveError> {
        settings.validate()?;
        Ok(Self {
            settings,
            newton: Newton::new(problem),
            costates: vec![nalgebra::SVector::zeros(); problem.horizon()],
            first: Solution::new(problem),
            natural: Some(Box::new(Natural::new(problem))),
            started: Instant::now(),
            judging: Duration::ZERO,
            iterations: 0,
            unit: 1.0,
        })
    }

    /// Writes the iterate and judges it; the status is what the recomputed residuals support.
    fn conclude(
        &mut self,
        problem: &OcpQp<NX, NU>,
        status: SolveStatus,
        solution: &mut Solution<NX, NU>,
    ) {
        if !matches!(status, SolveStatus::PrimalInfeasible { .. }) {
            self.write(status, solution);
        }
        let judging = Instant::now();
        solution.evaluate(problem);
        self.judging += judging.elapsed();
        let tolerance = self.settings.tolerance;
        solution.status = graded(status, &solution.residuals, solution.objective, tolerance);
    }

    /// The careful pass after an answer that is not good enough; the better of the two stays.
    fn try_again(&mut self, problem: &OcpQp<NX, NU>, solution: &mut Solution<NX, NU>) {
        std::mem::swap(solution, &mut self.first);
        let status = self.careful(problem, solution);
        self.conclude(problem, status, solution);
        let ended = solution.status;
        let worse = solution.residuals.worst() >= self.first.residuals.worst();
        let lost = self.first.status.has_solution() && !ended.has_solution();
        if !ended.is_settled() && (worse || lost) {
            std::mem::swap(solution, &mut self.first);
            // Two stops without an answer: what ended the second is what ended the solve.
            if !solution.status.has_solution() {
                solution.status = ended;
            }
        }
    }

    /// Solves what was loaded, without account.
    fn solve_loaded(
        &mut self,
        problem: &OcpQp<NX, NU>,
        start: Start,
        solution: &mut Solution<NX, NU>,
    ) {
        let kept = match start {
            Start::Warm if all_finite(solution) => self.warm_sweeps(solution),
            Start::Warm | Start::Cold => false,
        };
        let status = if kept {
            SolveStatus::Solved
        } else {
            let cuts = self.clipped_feedback();
            if self.cold_sweeps(&cuts) {
                SolveStatus::Solved
            } else {
                self.interior_point(problem, solution, &cuts)
            }
        };
        self.conclude(problem, status, solution);
        let doubtful = matches!(
            solution.status,
            SolveStatus::SolvedInaccurate
                | SolveStatus::NumericalTrouble
                | SolveStatus::IterationLimit
        );
        if doubtful && !self.stopped() {
            self.try_again(problem, solution);
        }
    }

    /// Solves the problem in its own units and judges the answer in the given ones; false, and nothing solved, where those do as well.
    fn solve_in_own_units(
        &mut self,
        problem: &OcpQp<NX, NU>,
        start: Start,
        solution: &mut Solution<NX, NU>,
    ) -> bool {
        let Some(mut natural) = self.natural.take() else {
            return false;
        };
        let guess = (start == Start::Warm).then_some(&*solution);
        let entered = natural.enter(problem, guess, 1.0);
        if entered {
            run(Load(&mut self.newton, &natural.problem));
            self.unit = natural.largest_unit().max(1.0);
            self.solve_loaded(&natural.problem, start, &mut natural.solution);
            self.judging += natural.leave(problem, self.settings.tolerance, solution);
            self.mend_as_given(problem, &mut natural, solution);
        }
        self.natural = Some(natural);
        entered
    }

    /// Solves the problem in its given units if the answer in others is not good enough for them; the better of the two in the worse of
    /// the units stays.
    fn mend_as_given(
        &mut self,
        problem: &OcpQp<NX, NU>,
        natural: &mut Natural<NX, NU>,
        solution: &mut Solution<NX, NU>,
    ) {
        if solution.status.is_settled() || self.stopped() {
            return;
        }
        let worst = solution.residuals.worst();
        let worst = worst.max(natural.solution.residuals.worst());
        self.unit = 1.0;
        run(Load(&mut self.newton, problem));
        self.solve_loaded(problem, Start::Cold, &mut natural.solution);
        let ended = natural.solution.status;
        let judging = Instant::now();
        let (status, found) =
            natural.judged_inside(&natural.solution, &mut self.first, self.settings.tolerance);
        self.judging += judging.elapsed();
        let mended = &mut natural.solution;
        mended.status = status;
        let better = mended.residuals.worst().max(found) < worst;
        if mended.status.is_settled() || (better && mended.status.has_solution()) {
            std::mem::swap(mended, solution);
        } else if !solution.status.has_solution() && !ended.has_solution() && !ended.is_settled() {
            // Two stops without an answer: what ended the second is what ended the solve.
            solution.status = ended;
        }
    }

    fn out_of_time(&self) -> bool {
        self.settings
            .time_limit
            .is_some_and(|limit| self.started.elapsed() >= limit)
    }

    /// Whether a limit is reached.
    fn stopped(&self) -> bool {
        self.out_of_time() || self.iterations >= self.settings.max_iterations
    }

    /// Writes the iterate if it is finite, else zeros, which the residuals then refuse.
    fn write(&mut self, status: SolveStatus, solution: &mut Solution<NX, NU>) {
        if !status.has_solution() {
            self.stationary(1.0);
        }
        self.newton.write(solution);
        for (to, from) in solution.multipliers.costates.iter_mut().zip(&self.costates) {
            *to = from * self.newton.cost_unit;
        }
        if !all_finite(solution) {
            self.newton.reset();
            self.newton.write(solution);
            solution
                .multipliers
                .costates
                .fill(nalgebra::SVector::zeros());
        }
    }

    /// Computes the costates; true if stationarity holds to `tolerance`.
    fn stationary(&mut self, tolerance: f64) -> bool {
        [false, true].into_iter().any(|feedback| {
            let (residual, scale) = run(Costates {
                newton: &mut self.newton,
                costates: &mut self.costates,
                feedback,
            });
            residual <= tolerance * scale
        })
    }
}

impl<const NX: usize, const NU: usize> OcpSolver<NX, NU> for StructuredSolver<NX, NU> {
    fn set_time_limit(&mut self, limit: Option<Duration>) {
        self.settings.time_limit = limit;
    }

    fn solve(
        &mut self,
        problem: &OcpQp<NX, NU>,
        start: Start,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError> {
        self.started = Instant::now();
        self.judging = Duration::ZERO;
        self.iterations = 0;
        self.unit = 1.0;
        self.newton.check_shape(problem)?;
        solution.check_shape(problem)?;
        run(Load(&mut self.newton, problem));
        let foreign = self.newton.depends_on_units();
        if !(foreign && self.solve_in_own_units(problem, start, solution)) {
            self.solve_loaded(problem, start, solution);
        }
        solution.time = self.started.elapsed().saturating_sub(self.judging);
        solution.iterations = self.iterations;
        Ok(())
    }
}
