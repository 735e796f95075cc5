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
mod passes;
mod pattern;
mod target;
#[cfg(test)]
mod tests;

use crate::error::SolveError;
use crate::problem::OcpQp;
use crate::solution::Solution;
use crate::solver::{OcpSolver, SolverSettings, Start};
use crate::units::Natural;
use assembly::{assemble, cost_scale};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, SupportedConeT};
use layout::Layout;
use passes::error;
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
    /// The problem in its own units, there except during a solve in them.
    natural: Option<Box<Natural<NX, NU>>>,
    /// A second one for problems as given, with an equilibration of its own, made where it is first asked for.
    as_given: Option<Box<Self>>,
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
            natural: self.natural.clone(),
            as_given: self.as_given.clone(),
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
        let mut natural = Box::new(Natural::new(problem));
        // Clarabel keeps the equilibration of its first problem: it had better be of those that it will get.
        let entered = natural.enter(problem, None, EQUILIBRATED);
        let first = if entered { &natural.problem } else { problem };
        let mut solver = Self::build(first, Layout::new(first), settings, 1)?;
        solver.natural = Some(natural);
        Ok(solver)
    }

    /// How often the pattern was made: 1 as long as the structure stays; a clone counts on from here, and one more at its first solve. A problem
    /// in units far from one that is not solved in others is tried as given, by a second solver that counts too.
    #[must_use]
    pub fn builds(&self) -> usize {
        self.builds + self.as_given.as_ref().map_or(0, |second| second.builds)
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
            clarabel_settings(&settings, settings.tolerance),
        )?;
        Ok(Self {
            layout,
            cost,
            constraints,
            linear,
            right,
            solver: Some(solver),
            natural: None,
            as_given: None,
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
            let as_given = self.as_given.take();
            *self = Self::build(problem, layout, self.settings, self.builds + 1)?;
            self.as_given = as_given;
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
        self.judging = Duration::ZERO;
        let natural = self.natural.take().filter(|natural| natural.fits(problem));
        let mut natural = natural.unwrap_or_else(|| Box::new(Natural::new(problem)));
        if natural.enter(problem, None, EQUILIBRATED) {
            let Natural {
                problem: inner,
                solution: found,
                back,
                ..
            } = &mut *natural;
            self.solve_in(&clock, inner, found, |found| {
                back.convert_solution(found, solution);
                solution.evaluate(problem);
                error(problem, solution)
            })?;
            self.judging += natural.leave(problem, self.settings.tolerance, solution);
            self.mend_as_given(&clock, problem, &natural, solution)?;
        } else {
            self.solve_in(&clock, problem, solution, |found| error(problem, found))?;
        }
        self.natural = Some(natural);
        solution.time = clock.elapsed().saturating_sub(self.judging);
        Ok(())
    }
}

/// Factor between units that Clarabel's own equilibration takes care of.
const EQUILIBRATED: f64 = 1e4;

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

/// Part of the tolerance that is asked of the gap and of rays: at a bound that holds with next to no multiplier an interior point is off by the
/// root of its gap, and Clarabel measures a ray against the largest of its own numbers, 1e-8 of which has been seen to leave 4e-6 of what the ray
/// separates.
const EXACTING: f64 = 1e-3;

/// Limits, with `tolerance` asked of feasibility and a part of the settings' own, or a tighter `tolerance`, of the gap. Where the gap comes no further than that tolerance, Clarabel calls it almost solved.
///
/// Presolve and zero dropping would forbid updates. Refinement stays at its defaults: it is what keeps Clarabel right.
fn clarabel_settings(settings: &SolverSettings, tolerance: f64) -> DefaultSettings<f64> {
    let exacting = EXACTING * settings.tolerance;
    let gap = tolerance.min(exacting);
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
        tol_gap_abs: gap,
        tol_gap_rel: gap,
        tol_feas: tolerance,
        reduced_tol_gap_abs: tolerance,
        reduced_tol_gap_rel: tolerance,
        reduced_tol_feas: tolerance,
        tol_infeas_abs: exacting,
        tol_infeas_rel: exacting,
        ..DefaultSettings::default()
    }
}
