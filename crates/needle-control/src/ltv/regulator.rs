//! The quadratic program of the linear controllers: error and last input deviation as state, input deviation as input.
//!
//! ```text
//! x = (error, d_prev)      x+ = [A 0; 0 0] x + [B; I] d + (c, 0)
//! l = error' Q error + d' R d + (d - d_prev)' R_d (d - d_prev)
//! ```

use super::configuration::LinearConfiguration;
use crate::configuration::ConfigurationError;
use crate::corridor::Corridor;
use crate::limits::InputLimits;
use crate::plan_solver::MakeSolver;
use crate::program::{Account, Goal, Programs};
use crate::terminal::{End, Ingredients};
use mpc_qp::{OcpQp, ProblemError, Solution, Stage, Terminal};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use needle_model::Input;
use std::time::Duration;

/// Solves for the input deviation; `NX` counts the error and the two inputs.
#[derive(Debug, Clone)]
pub(crate) struct Regulator<const NX: usize> {
    programs: Programs<NX>,
    stages: Vec<Stage<NX, 2>>,
    terminal: Terminal<NX>,
    goal: Goal<NX>,
    limits: InputLimits,
    dt_s: f64,
}

/// Stage weights of the augmented state: `q` of the error, `r` of the deviation, `r_rate` of its change.
pub(crate) fn weighted_stage<const NX: usize>(
    q: &SMatrix<f64, NX, NX>,
    r: &Matrix2<f64>,
    r_rate: &Matrix2<f64>,
) -> Stage<NX, 2> {
    let mut stage = Stage::new(SMatrix::zeros(), SMatrix::zeros());
    stage.q = *q;
    stage
        .q
        .fixed_view_mut::<2, 2>(NX - 2, NX - 2)
        .copy_from(r_rate);
    stage.r = r + r_rate;
    stage
        .s
        .fixed_view_mut::<2, 2>(NX - 2, 0)
        .copy_from(&-r_rate);
    stage
        .b
        .fixed_view_mut::<2, 2>(NX - 2, 0)
        .fill_with_identity();
    stage
}

impl<const NX: usize> Regulator<NX> {
    pub(crate) fn new(
        mut stage: Stage<NX, 2>,
        configuration: &LinearConfiguration,
        ingredients: &Ingredients,
        make_solver: MakeSolver<'_, NX>,
    ) -> Result<Self, ConfigurationError> {
        let LinearConfiguration {
            horizon,
            dt_s,
            limits,
            ..
        } = *configuration;
        let corridor = configuration.corridor();
        let softening = corridor.map(|corridor| corridor.softening());
        if corridor.is_some() {
            stage.rows = Corridor::blank_rows();
        }
        let stages = vec![stage; horizon];
        let end = ingredients.at(0);
        let terminal = Terminal::new(SMatrix::from_fn(|i, j| end.p[(i, j)]));
        let goal = Goal {
            shape: terminal.p,
            center: SVector::zeros(),
            level: end.level.unwrap_or(1.0),
            rows: Vec::new(),
        };
        let free = OcpQp::new(SVector::zeros(), stages.clone(), terminal.clone())?
            .with_softening(softening.unwrap_or_default())?;
        Ok(Self {
            programs: Programs::new(free, end.level.map(|_| &goal), make_solver)?,
            stages,
            terminal,
            goal,
            limits,
            dt_s,
        })
    }

    /// Dynamics of stage `k`: error matrices and defect.
    pub(crate) fn stage_mut(&mut self, k: usize) -> &mut Stage<NX, 2> {
        &mut self.stages[k]
    }

    /// Limits of every stage in deviations from `wanted`, the reference's inputs, which follow `before`.
    pub(crate) fn set_limits(&mut self, before: Input, wanted: &[Input], reach_s: f64) {
        let vector = |u: &Input| Vector2::new(u.v_mm_s, u.omega_rad_s);
        let limits = &self.limits;
        let lower = Vector2::new(limits.v_min_mm_s, -limits.omega_max_rad_s);
        let upper = Vector2::new(limits.v_max_mm_s, limits.omega_max_rad_s);
        let rate = Vector2::new(limits.v_rate_max_mm_s2, limits.omega_rate_max_rad_s2);
        for (k, stage) in self.stages.iter_mut().enumerate() {
            let here = vector(&wanted[k]);
            let change = here - vector(if k == 0 { &before } else { &wanted[k - 1] });
            let reach = rate * if k == 0 { reach_s } else { self.dt_s };
            stage.u_min = lower - here;
            stage.u_max = upper - here;
            stage.du_min = -reach - change;
            stage.du_max = reach - change;
        }
    }

    /// Solves from an error, with `previous` the input deviation applied last, and what holds at the horizon's end.
    ///
    /// # Errors
    /// [`ProblemError`] for data that are not finite.
    pub(crate) fn solve(
        &mut self,
        error: &SVector<f64, NX>,
        previous: &Vector2<f64>,
        end: End<'_>,
        remaining: Option<Duration>,
    ) -> Result<Account, ProblemError> {
        let mut state = *error;
        state.fixed_rows_mut::<2>(NX - 2).copy_from(previous);
        self.terminal.p = SMatrix::from_fn(|i, j| end.p[(i, j)]);
        let problem = self.programs.problem_mut();
        problem.set_initial_state(&state)?;
        problem.set_previous_input(previous)?;
        for (k, stage) in self.stages.iter().enumerate() {
            problem.set_stage(k, stage)?;
        }
        problem.set_terminal(&self.terminal)?;
        self.goal.shape = self.terminal.p;
        let goal = end.level.map(|level| {
            self.goal.level = level;
            &self.goal
        });
        Ok(self.programs.solve(goal, remaining))
    }

    /// The last answer.
    pub(crate) fn solution(&self) -> &Solution<NX, 2> {
        self.programs.solution()
    }

    /// Moves the guesses by whole samples, or forgets them.
    pub(crate) fn shift(&mut self, steps: usize) {
        self.programs.shift(steps);
    }
}
