//! A problem in units in which its numbers are near one, for solvers whose constants are numbers without a unit.
//!
//! With diagonal D, E and the cost's factor g the problem in `x = D x'`, `u = E u'` has the matrices `D^-1 A D`, `D^-1 B E`,
//! `g D Q D`, ...; hard rows are divided by their length. A multiplier of a constraint whose unit is d comes back as
//! `y = y' / (g d)`. Tolerances, starting points, weights of the method of multipliers and the test of infeasibility are then statements
//! about the data's own sizes.

mod choice;
mod conversion;

use crate::certificate::examine_certificate;
use crate::problem::OcpQp;
use crate::residuals::Residuals;
use crate::solution::{Solution, SolveStatus};
use crate::solver::{downgraded, usable_residual};
use crate::terminal::TerminalSet;
use nalgebra::SVector;
use std::time::{Duration, Instant};

/// What one is, in given units. Rows and faces are multiplied by their factors, the cost by its own.
#[derive(Clone, Debug)]
pub(crate) struct Units<const NX: usize, const NU: usize> {
    state: SVector<f64, NX>,
    input: SVector<f64, NU>,
    cost: f64,
    rows: Vec<f64>,
    faces: Vec<f64>,
    /// Memory for the choice, one number a stage.
    distances: Vec<f64>,
}

/// Memory for a problem in its own units, and for its solution.
#[derive(Clone, Debug)]
pub(crate) struct Natural<const NX: usize, const NU: usize> {
    pub(crate) units: Units<NX, NU>,
    /// The way back.
    pub(crate) back: Units<NX, NU>,
    pub(crate) problem: OcpQp<NX, NU>,
    pub(crate) solution: Solution<NX, NU>,
}

impl<const NX: usize, const NU: usize> Natural<NX, NU> {
    /// Memory for problems of the structure of `problem`.
    pub(crate) fn new(problem: &OcpQp<NX, NU>) -> Self {
        let rows = problem.stages().iter().map(|stage| stage.rows.len()).sum();
        let faces = match &problem.terminal().set {
            TerminalSet::Polytope { faces } => faces.len(),
            _ => 0,
        };
        let units = Units {
            state: SVector::repeat(1.0),
            input: SVector::repeat(1.0),
            cost: 1.0,
            rows: vec![1.0; rows],
            faces: vec![1.0; faces],
            distances: vec![0.0; problem.horizon()],
        };
        Self {
            back: units.clone(),
            units,
            problem: problem.clone(),
            solution: Solution::new(problem),
        }
    }

    /// Whether `problem` has the structure that the memory was made for.
    pub(crate) fn fits(&self, problem: &OcpQp<NX, NU>) -> bool {
        let kept = &self.problem;
        let mut stages = kept.stages().iter().zip(problem.stages());
        kept.horizon() == problem.horizon()
            && stages.all(|(kept, stage)| kept.rows.len() == stage.rows.len())
            && kept.terminal().same_structure(problem.terminal()).is_ok()
            && kept.softening().same_kinds(problem.softening()).is_ok()
    }

    /// Converts problem and guess, if there is one; false, and nothing converted, if all units are within the factor `ordinary` of the given ones.
    pub(crate) fn enter(
        &mut self,
        problem: &OcpQp<NX, NU>,
        guess: Option<&Solution<NX, NU>>,
        ordinary: f64,
    ) -> bool {
        if self.units.choose(problem) <= ordinary {
            return false;
        }
        self.back.undo(&self.units);
        self.units.convert_problem(problem, &mut self.problem);
        if let Some(guess) = guess {
            self.units.convert_solution(guess, &mut self.solution);
        }
        true
    }

    /// The largest unit of a state or an input.
    pub(crate) fn largest_unit(&self) -> f64 {
        self.units.state.amax().max(self.units.input.amax())
    }

    /// Brings the answer back and judges it in the given units as well: they may downgrade it, and call solved what they show to be.
    /// Returns the time spent on residuals.
    pub(crate) fn leave(
        &mut self,
        problem: &OcpQp<NX, NU>,
        tolerance: f64,
        solution: &mut Solution<NX, NU>,
    ) -> Duration {
        self.back.convert_solution(&self.solution, solution);
        solution.iterations = self.solution.iterations;
        let judging = Instant::now();
        solution.evaluate(problem);
        let judging = judging.elapsed();
        solution.status = self.judged(problem, tolerance, solution);
        judging
    }

    /// What an answer found in the given units is worth in these, `inside` being its copy here: its status, and its worst residual. A
    /// point that is within tolerances in the given units alone is no answer, nor is such a ray a proof.
    pub(crate) fn judged_inside(
        &self,
        found: &Solution<NX, NU>,
        inside: &mut Solution<NX, NU>,
        tolerance: f64,
    ) -> (SolveStatus, f64) {
        self.units.convert_solution(found, inside);
        inside.residuals = Residuals::evaluate(&self.problem, inside);
        let worst = inside.residuals.worst();
        let status = match found.status {
            SolveStatus::PrimalInfeasible { .. } => {
                let (certificate, _) = examine_certificate(&self.problem, inside);
                match certificate.is_proof(inside) {
                    true => found.status,
                    false => SolveStatus::NumericalTrouble,
                }
            }
            status if status.has_solution() => downgraded(status, worst, tolerance),
            status => status,
        };
        (status, worst)
    }

    fn judged(
        &self,
        problem: &OcpQp<NX, NU>,
        tolerance: f64,
        solution: &Solution<NX, NU>,
    ) -> SolveStatus {
        let worst = solution.residuals.worst();
        match self.solution.status {
            SolveStatus::PrimalInfeasible { .. } => {
                let (certificate, blame) = examine_certificate(problem, solution);
                // That it is one in its own units has been looked at; here it refutes what is of the trajectory's size.
                if certificate.refutes_beyond(solution) {
                    SolveStatus::PrimalInfeasible { certificate, blame }
                } else {
                    SolveStatus::NumericalTrouble
                }
            }
            SolveStatus::SolvedInaccurate | SolveStatus::NumericalTrouble
                if worst <= tolerance && self.is_relatively_good(tolerance, solution) =>
            {
                SolveStatus::Solved
            }
            status if status.has_solution() => downgraded(status, worst, tolerance),
            status => status,
        }
    }

    /// Whether the gap is small beside the objective, and the point nearly feasible in its own units: where everything is small in the
    /// given ones, small residuals say little.
    fn is_relatively_good(&self, tolerance: f64, solution: &Solution<NX, NU>) -> bool {
        let inner = &self.solution.residuals;
        let violation = inner.dynamics.relative().max(inner.constraints.relative());
        violation <= usable_residual(tolerance)
            && solution.residuals.complementarity.absolute <= tolerance * solution.objective.abs()
    }
}
