//! Quadratic programs with a terminal set that may be out of reach: free first, into the set where that is asked for.
//!
//! The program without the set is solved first. If its end lies in the set by itself, it is the answer; that is the rule in
//! tracking, and costs one solve without a cone. Otherwise the program with the set is solved; where that has no solution the first
//! answer stands, with the distance by which it misses the set.

use crate::configuration::ConfigurationError;
use crate::plan_solver::{MakeSolver, PlanSolver};
use mpc_qp::{
    OcpQp, ProblemError, Row, Solution, SolveError, SolveStatus, Stage, Start, Terminal,
    TerminalSet,
};
use nalgebra::{SMatrix, SVector};
use std::time::{Duration, Instant};

/// Where the plan is to end, `(x - center)'shape (x - center) <= level`, and what ties its last stage to the law that takes over.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Goal<const NX: usize> {
    pub(crate) shape: SMatrix<f64, NX, NX>,
    pub(crate) center: SVector<f64, NX>,
    pub(crate) level: f64,
    /// Rows of the last stage, beside its own. Where those are soft these are as well, and an answer that they give way to is none.
    pub(crate) rows: Vec<Row<NX, 2>>,
}

/// Relative distance from the set's boundary, and from a row, that counts as none: the solver's tolerance.
const ON_THE_BOUNDARY: f64 = 1e-7;

impl<const NX: usize> Goal<NX> {
    fn set(&self) -> TerminalSet<NX> {
        TerminalSet::Ellipsoid {
            shape: self.shape,
            center: self.center,
            level: self.level,
        }
    }

    /// How far a plan misses the set, in `sqrt(x'Px)`, or a row if that is more; zero where it keeps both.
    fn missed(&self, solution: &Solution<NX, 2>) -> f64 {
        let (Some(end), [.., x, _], Some(u)) =
            (solution.x.last(), &solution.x[..], solution.u.last())
        else {
            return f64::INFINITY;
        };
        let offset = end - self.center;
        let (radius, allowed) = (
            offset.dot(&(self.shape * offset)).max(0.0).sqrt(),
            self.level.sqrt(),
        );
        let beyond = |value: f64, bound: f64| {
            let excess = value - bound;
            if excess > ON_THE_BOUNDARY * (1.0 + bound.abs()) {
                excess
            } else {
                0.0
            }
        };
        let of_row = |row: &Row<NX, 2>| beyond(row.g_x.dot(x) + row.h_u.dot(u), row.upper);
        self.rows
            .iter()
            .map(of_row)
            .fold(beyond(radius, allowed), f64::max)
    }

    /// Whether the goal's own rows, the last ones, hold where soft ones of the stage made them soft.
    fn keeps_rows(&self, solution: &Solution<NX, 2>) -> bool {
        let slacks = solution.slacks.stages.last().map(|stage| &stage.rows[..]);
        let own = slacks
            .unwrap_or_default()
            .iter()
            .rev()
            .zip(self.rows.iter().rev());
        own.into_iter()
            .all(|(slack, row)| *slack <= ON_THE_BOUNDARY * (1.0 + row.upper.abs()))
    }
}

/// One program with its solver and last answer.
#[derive(Debug, Clone)]
struct Program<const NX: usize> {
    problem: OcpQp<NX, 2>,
    solver: Box<dyn PlanSolver<NX>>,
    solution: Solution<NX, 2>,
    start: Start,
}

impl<const NX: usize> Program<NX> {
    fn new(problem: OcpQp<NX, 2>, make_solver: MakeSolver<'_, NX>) -> Result<Self, SolveError> {
        Ok(Self {
            solver: make_solver(&problem)?,
            solution: Solution::new(&problem),
            problem,
            start: Start::Cold,
        })
    }

    fn solve(&mut self, account: &mut Account, remaining: Option<Duration>) {
        if remaining.is_some_and(|remaining| remaining.is_zero()) {
            account.status = SolveStatus::TimeLimit;
            self.start = Start::Cold;
            return;
        }
        self.solver.set_time_limit(remaining);
        let solved = self
            .solver
            .solve(&self.problem, self.start, &mut self.solution);
        account.status = match solved {
            Ok(()) => self.solution.status,
            Err(_) => SolveStatus::NumericalTrouble,
        };
        account.solves += 1;
        account.iterations += self.solution.iterations;
        self.start = match account.status.has_solution() {
            true => Start::Warm,
            false => Start::Cold,
        };
    }

    /// Moves the guess ahead; a guess that cannot be moved is none.
    fn shift(&mut self, steps: usize) {
        let kept = match steps {
            0 => true,
            1 => self.start == Start::Warm && self.solution.shift(&self.problem).is_ok(),
            _ => false,
        };
        if !kept {
            self.start = Start::Cold;
        }
    }
}

/// What solving cost and found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Account {
    /// Of the answer in force.
    pub(crate) status: SolveStatus,
    pub(crate) solves: usize,
    pub(crate) iterations: usize,
    /// How far the end is outside the set, in `sqrt(x'Px)`; zero where the set holds or there is none.
    pub(crate) violation: f64,
}

/// Copies a free program into the one with the goal, without allocating.
fn fill<const NX: usize>(
    free: &OcpQp<NX, 2>,
    goal: &Goal<NX>,
    bound: &mut OcpQp<NX, 2>,
    (last, terminal): (&mut Stage<NX, 2>, &mut Terminal<NX>),
) -> Result<(), ProblemError> {
    bound.set_initial_state(free.initial_state())?;
    bound.set_previous_input(free.previous_input())?;
    let Some((source, before)) = free.stages().split_last() else {
        return Ok(());
    };
    for (k, stage) in before.iter().enumerate() {
        bound.set_stage(k, stage)?;
    }
    let mut rows = std::mem::take(&mut last.rows);
    let (of_stage, of_goal) = rows.split_at_mut(source.rows.len());
    of_stage.copy_from_slice(&source.rows);
    of_goal.copy_from_slice(&goal.rows);
    *last = Stage { rows, ..*source };
    bound.set_stage(before.len(), last)?;
    terminal.p = free.terminal().p;
    terminal.p_linear = free.terminal().p_linear;
    terminal.set = goal.set();
    bound.set_terminal(terminal)
}

/// The program without and, if there is a goal, the one with it.
#[derive(Debug, Clone)]
pub(crate) struct Programs<const NX: usize> {
    free: Program<NX>,
    bound: Option<Program<NX>>,
    /// The last stage of the bound program, with its rows.
    last: Stage<NX, 2>,
    terminal: Terminal<NX>,
    bound_in_force: bool,
}

impl<const NX: usize> Programs<NX> {
    /// Memory for programs of the structure of `free`, and of `goal` where there ever is one.
    pub(crate) fn new(
        free: OcpQp<NX, 2>,
        goal: Option<&Goal<NX>>,
        make_solver: MakeSolver<'_, NX>,
    ) -> Result<Self, ConfigurationError> {
        let mut stages = free.stages().to_vec();
        let mut terminal = free.terminal().clone();
        let mut last = match stages.last() {
            Some(stage) => stage.clone(),
            None => Stage::new(SMatrix::identity(), SMatrix::zeros()),
        };
        let bound = match goal {
            Some(goal) => {
                last.rows.extend_from_slice(&goal.rows);
                if let Some(stage) = stages.last_mut() {
                    stage.clone_from(&last);
                }
                terminal.set = goal.set();
                let problem = OcpQp::new(*free.initial_state(), stages, terminal.clone())?
                    .with_softening(*free.softening())?;
                Some(Program::new(problem, make_solver)?)
            }
            None => None,
        };
        Ok(Self {
            free: Program::new(free, make_solver)?,
            bound,
            last,
            terminal,
            bound_in_force: false,
        })
    }

    /// The program without a goal, to be refilled before a solve.
    pub(crate) fn problem_mut(&mut self) -> &mut OcpQp<NX, 2> {
        &mut self.free.problem
    }

    /// Solves what [`Self::problem_mut`] was filled with, toward a goal if there is one, both within `remaining`.
    pub(crate) fn solve(
        &mut self,
        goal: Option<&Goal<NX>>,
        remaining: Option<Duration>,
    ) -> Account {
        let started = Instant::now();
        let mut account = Account {
            status: SolveStatus::NumericalTrouble,
            solves: 0,
            iterations: 0,
            violation: 0.0,
        };
        self.bound_in_force = false;
        self.free.solve(&mut account, remaining);
        let (Some(goal), Some(bound)) = (goal, &mut self.bound) else {
            return account;
        };
        if !account.status.has_solution() {
            bound.start = Start::Cold;
            return account;
        }
        let missed = goal.missed(&self.free.solution);
        if missed == 0.0 {
            // What is not solved now is no guess for the next sample.
            bound.start = Start::Cold;
            return account;
        }
        let filled = fill(
            &self.free.problem,
            goal,
            &mut bound.problem,
            (&mut self.last, &mut self.terminal),
        );
        let of_free = account;
        if filled.is_ok() {
            let left = remaining.map(|time| time.saturating_sub(started.elapsed()));
            bound.solve(&mut account, left);
        }
        self.bound_in_force =
            filled.is_ok() && account.status.has_solution() && goal.keeps_rows(&bound.solution);
        match account.status {
            _ if self.bound_in_force => {}
            // Out of time: a late step is no step, whatever it has.
            SolveStatus::TimeLimit => {}
            _ => (account.status, account.violation) = (of_free.status, missed),
        }
        account
    }

    /// The answer in force.
    pub(crate) fn solution(&self) -> &Solution<NX, 2> {
        match &self.bound {
            Some(program) if self.bound_in_force => &program.solution,
            _ => &self.free.solution,
        }
    }

    /// Moves the guesses by whole samples.
    pub(crate) fn shift(&mut self, steps: usize) {
        for program in self.bound.iter_mut().chain([&mut self.free]) {
            program.shift(steps);
        }
    }

    /// The next solves start from nothing.
    pub(crate) fn forget(&mut self) {
        self.shift(usize::MAX);
    }
}
