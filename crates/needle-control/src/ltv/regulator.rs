//! The quadratic program of the linear controllers: error and last input deviation as state, input deviation as input.
//!
//! ```text
//! x = (error, d_prev)      x+ = [A 0; 0 0] x + [B; I] d + (c, 0)
//! l = error' Q error + d' R d + (d - d_prev)' R_d (d - d_prev)
//! ```
//! The terminal set is hard first. Where that is infeasible the same problem without the set is solved, and the answer is told
//! to be degraded by how far its end is outside.

use super::terminal::Ingredients;
use crate::configuration::ConfigurationError;
use crate::limits::InputLimits;
use mpc_qp::{
    OcpQp, OcpSolver, Solution, SolveError, SolveStatus, SolverSettings, Stage, Start,
    StructuredSolver, Terminal, TerminalSet,
};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use needle_model::Input;

/// A problem with its solver and last answer. `NX` counts the error and the two inputs.
#[derive(Debug, Clone)]
struct Program<S, const NX: usize> {
    problem: OcpQp<NX, 2>,
    solver: S,
    solution: Solution<NX, 2>,
    start: Start,
}

/// Solves for the input deviation; `NX` counts the error and the two inputs.
#[derive(Debug, Clone)]
pub(crate) struct Regulator<S, const NX: usize> {
    with_set: Option<Program<S, NX>>,
    without: Program<S, NX>,
    stages: Vec<Stage<NX, 2>>,
    terminal: Terminal<NX>,
    limits: InputLimits,
    dt_s: f64,
    degraded: bool,
}

/// What a solve found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Answer {
    pub(crate) status: SolveStatus,
    pub(crate) solves: usize,
    pub(crate) iterations: usize,
    /// How far the end is outside the terminal set, in `sqrt(x'Px)`; zero where the set holds or there is none.
    pub(crate) violation: f64,
}

impl<S: OcpSolver<NX, 2>, const NX: usize> Program<S, NX> {
    fn new(
        problem: OcpQp<NX, 2>,
        make_solver: &mut impl FnMut(&OcpQp<NX, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        Ok(Self {
            solver: make_solver(&problem)?,
            solution: Solution::new(&problem),
            problem,
            start: Start::Cold,
        })
    }

    fn solve(&mut self) -> (SolveStatus, usize) {
        let solved = self
            .solver
            .solve(&self.problem, self.start, &mut self.solution);
        let status = match solved {
            Ok(()) => self.solution.status,
            Err(_) => SolveStatus::NumericalTrouble,
        };
        self.start = match status.has_solution() {
            true => Start::Warm,
            false => Start::Cold,
        };
        (status, self.solution.iterations)
    }

    fn load(
        &mut self,
        state: &SVector<f64, NX>,
        previous: &Vector2<f64>,
        stages: &[Stage<NX, 2>],
        terminal: &Terminal<NX>,
    ) -> Result<(), mpc_qp::ProblemError> {
        self.problem.set_initial_state(state)?;
        self.problem.set_previous_input(previous)?;
        for (k, stage) in stages.iter().enumerate() {
            self.problem.set_stage(k, stage)?;
        }
        self.problem.set_terminal(terminal)
    }

    fn shift(&mut self) {
        if self.start == Start::Warm && self.solution.shift(&self.problem).is_err() {
            self.start = Start::Cold;
        }
    }
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

impl<S: OcpSolver<NX, 2>, const NX: usize> Regulator<S, NX> {
    pub(crate) fn new(
        stage: Stage<NX, 2>,
        horizon: usize,
        limits: InputLimits,
        dt_s: f64,
        ingredients: &Ingredients,
        mut make_solver: impl FnMut(&OcpQp<NX, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        let stages = vec![stage; horizon];
        let (p, level) = ingredients.at(0);
        let mut terminal = Terminal::new(SMatrix::from_fn(|i, j| p[(i, j)]));
        let start = SVector::zeros();
        let without = Program::new(
            OcpQp::new(start, stages.clone(), terminal.clone())?,
            &mut make_solver,
        )?;
        let with_set = match level {
            Some(level) => {
                terminal.set = TerminalSet::Ellipsoid {
                    shape: terminal.p,
                    center: SVector::zeros(),
                    level,
                };
                let problem = OcpQp::new(start, stages.clone(), terminal.clone())?;
                Some(Program::new(problem, &mut make_solver)?)
            }
            None => None,
        };
        Ok(Self {
            with_set,
            without,
            stages,
            terminal,
            limits,
            dt_s,
            degraded: false,
        })
    }

    /// Dynamics of stage `k`: error matrices and defect.
    pub(crate) fn stage_mut(&mut self, k: usize) -> &mut Stage<NX, 2> {
        &mut self.stages[k]
    }

    /// Limits of every stage in deviations from `wanted`, the reference's inputs.
    pub(crate) fn set_limits(&mut self, wanted: &[Input], reach_s: f64) {
        let vector = |u: &Input| Vector2::new(u.v_mm_s, u.omega_rad_s);
        let limits = &self.limits;
        let lower = Vector2::new(limits.v_min_mm_s, -limits.omega_max_rad_s);
        let upper = Vector2::new(limits.v_max_mm_s, limits.omega_max_rad_s);
        let rate = Vector2::new(limits.v_rate_max_mm_s2, limits.omega_rate_max_rad_s2);
        for (k, stage) in self.stages.iter_mut().enumerate() {
            let here = vector(&wanted[k]);
            let change = if k == 0 {
                Vector2::zeros()
            } else {
                here - vector(&wanted[k - 1])
            };
            let reach = rate * if k == 0 { reach_s } else { self.dt_s };
            stage.u_min = lower - here;
            stage.u_max = upper - here;
            stage.du_min = -reach - change;
            stage.du_max = reach - change;
        }
    }

    /// Solves from an error, with `previous` the input deviation applied last and the ingredients of the horizon's end.
    pub(crate) fn solve(
        &mut self,
        error: &SVector<f64, NX>,
        previous: &Vector2<f64>,
        ingredients: &Ingredients,
        end_step: usize,
    ) -> Answer {
        let mut state = *error;
        state.fixed_rows_mut::<2>(NX - 2).copy_from(previous);
        let (p, level) = ingredients.at(end_step);
        self.terminal.p = SMatrix::from_fn(|i, j| p[(i, j)]);
        let mut answer = Answer {
            status: SolveStatus::NumericalTrouble,
            solves: 0,
            iterations: 0,
            violation: 0.0,
        };
        self.degraded = false;
        if let (Some(program), Some(level)) = (&mut self.with_set, level) {
            self.terminal.set = TerminalSet::Ellipsoid {
                shape: self.terminal.p,
                center: SVector::zeros(),
                level,
            };
            if program
                .load(&state, previous, &self.stages, &self.terminal)
                .is_ok()
            {
                let (status, iterations) = program.solve();
                answer = Answer {
                    status,
                    solves: 1,
                    iterations,
                    violation: 0.0,
                };
                if status.has_solution() || status == SolveStatus::TimeLimit {
                    return answer;
                }
            }
        }
        self.degraded = true;
        self.terminal.set = TerminalSet::None;
        let loaded = self
            .without
            .load(&state, previous, &self.stages, &self.terminal);
        if loaded.is_err() {
            answer.status = SolveStatus::NumericalTrouble;
            return answer;
        }
        let (status, iterations) = self.without.solve();
        answer.status = status;
        answer.solves += 1;
        answer.iterations += iterations;
        if let (Some(level), Some(end)) = (level, self.without.solution.x.last()) {
            let radius = end.dot(&(self.terminal.p * end)).max(0.0).sqrt();
            answer.violation = (radius - level.sqrt()).max(0.0);
        }
        answer
    }

    /// The last answer.
    pub(crate) fn solution(&self) -> &Solution<NX, 2> {
        match &self.with_set {
            Some(program) if !self.degraded => &program.solution,
            _ => &self.without.solution,
        }
    }

    /// Moves the solvers' guesses one sample ahead, or forgets them.
    pub(crate) fn shift(&mut self, steps: usize) {
        for program in self.with_set.iter_mut().chain([&mut self.without]) {
            match steps {
                0 => {}
                1 => program.shift(),
                _ => program.start = Start::Cold,
            }
        }
    }
}

/// The structured solver within a deadline.
pub(crate) fn structured<const NX: usize>(
    deadline: Option<std::time::Duration>,
) -> impl FnMut(&OcpQp<NX, 2>) -> Result<StructuredSolver<NX, 2>, SolveError> {
    move |problem| {
        let time_limit = deadline;
        StructuredSolver::new(
            problem,
            SolverSettings {
                time_limit,
                ..SolverSettings::default()
            },
        )
    }
}
