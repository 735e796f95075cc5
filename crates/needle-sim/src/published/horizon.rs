//! The program that is solved at every step, for the straight and for the bevelled needle.
//!
//! ```text
//! min   sum_{k=0..N} (x_k - t_k)'Q(x_k - t_k) + u_k'R u_k  +  (x_N - r_{N-1})'P(x_N - r_{N-1})
//! s.t.  x_{k+1} = A (x_k - r_k) + B (u_k - ur_k) + r_k,  k < N
//!       (x_N - r_{N-1})'P(x_N - r_{N-1}) <= c
//!       limits on u_k + ur_k and on its change from k to k + 1, k = 0..N; none on the change to u_0
//! ```
//! The N + 1 inputs fit the N-stage problem type by one stage more, whose dynamics is the identity.

use super::PublishedError;
use super::constants::CONSTANTS;
use crate::log::{LogRow, SOLVED};
use faer::Mat;
use mpc_qp::{
    ClarabelSolver, OcpQp, OcpSolver, Solution, SolveStatus, SolverSettings, Stage, Start,
    Terminal, TerminalSet,
};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use std::time::Instant;

/// The data of one step's program.
#[derive(Debug, Clone)]
pub(super) struct Horizon<const NX: usize> {
    pub(super) a: SMatrix<f64, NX, NX>,
    pub(super) b: SMatrix<f64, NX, 2>,
    pub(super) q: SMatrix<f64, NX, NX>,
    pub(super) r: Matrix2<f64>,
    /// r_0..r_N.
    pub(super) states: Vec<SVector<f64, NX>>,
    /// ur_0..ur_N.
    pub(super) inputs: Vec<Vector2<f64>>,
    /// t_0..t_N.
    pub(super) targets: Vec<SVector<f64, NX>>,
}

/// The answer of one step's program.
#[derive(Debug, Clone, Copy)]
pub(super) struct FirstInput {
    /// u_0, or `None` after a failed solve.
    pub(super) u: Option<Vector2<f64>>,
    pub(super) status: &'static str,
    pub(super) iterations: usize,
    pub(super) solve_us: f64,
}

impl FirstInput {
    /// `row` with the account of this solve.
    pub(super) fn recorded_in(&self, row: LogRow) -> LogRow {
        let Self {
            status,
            iterations,
            solve_us,
            ..
        } = *self;
        LogRow {
            status: Some(status),
            iterations: Some(iterations),
            solve_us: Some(solve_us),
            ..row
        }
    }
}

/// The solver, its pattern laid out at the first step and refilled at every later one.
#[derive(Debug)]
pub(super) struct HorizonSolver<const NX: usize> {
    settings: SolverSettings,
    memory: Option<(ClarabelSolver<NX, 2>, Solution<NX, 2>)>,
}

impl<const NX: usize> HorizonSolver<NX> {
    pub(super) fn new(tolerance: f64) -> Self {
        Self {
            settings: SolverSettings {
                tolerance,
                ..SolverSettings::default()
            },
            memory: None,
        }
    }

    /// Solves the program of closed-loop step `step` from `x0`.
    pub(super) fn first_input(
        &mut self,
        step: usize,
        horizon: &Horizon<NX>,
        x0: SVector<f64, NX>,
    ) -> Result<FirstInput, PublishedError> {
        let weight = horizon.terminal_weight(step)?;
        let start = Instant::now();
        let program = OcpQp::new(x0, horizon.stages(), horizon.terminal(weight))
            .map_err(|source| PublishedError::Program { step, source })?;
        let at_solver = |source| PublishedError::Solver { step, source };
        let (solver, solution) = match &mut self.memory {
            Some(memory) => memory,
            none => none.insert((
                ClarabelSolver::new(&program, self.settings).map_err(at_solver)?,
                Solution::new(&program),
            )),
        };
        solver
            .solve(&program, Start::Cold, solution)
            .map_err(at_solver)?;
        let solve_us = start.elapsed().as_secs_f64() * 1e6;
        let u = solution.status.has_solution().then(|| solution.u[0]);
        Ok(FirstInput {
            u,
            status: status_name(&solution.status),
            iterations: solution.iterations,
            solve_us,
        })
    }
}

fn status_name(status: &SolveStatus) -> &'static str {
    match status {
        SolveStatus::Solved => SOLVED,
        SolveStatus::SolvedInaccurate => "solved_inaccurate",
        SolveStatus::PrimalInfeasible { .. } => "primal_infeasible",
        SolveStatus::IterationLimit => "iteration_limit",
        SolveStatus::TimeLimit => "time_limit",
        SolveStatus::NumericalTrouble => "numerical_trouble",
    }
}

impl<const NX: usize> Horizon<NX> {
    /// N.
    fn length(&self) -> usize {
        self.states.len() - 1
    }

    /// P, the solution of the Riccati equation for (A, B, Q, R), whatever A is.
    fn terminal_weight(&self, step: usize) -> Result<SMatrix<f64, NX, NX>, PublishedError> {
        let (a, b, q, r) = (
            to_faer(&self.a),
            to_faer(&self.b),
            to_faer(&self.q),
            to_faer(&self.r),
        );
        let solution = lqr::Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref())
            .solve()
            .map_err(|source| PublishedError::TerminalWeight { step, source })?;
        Ok(SMatrix::from_fn(|i, j| solution.p[(i, j)]))
    }

    /// N stages of the prediction and one of identity, which carries u_N.
    fn stages(&self) -> Vec<Stage<NX, 2>> {
        (0..=self.length()).map(|k| self.stage(k)).collect()
    }

    fn stage(&self, k: usize) -> Stage<NX, 2> {
        let (state, input) = (self.states[k], self.inputs[k]);
        let mut stage = if k < self.length() {
            let mut stage = Stage::new(self.a, self.b);
            stage.c = state - self.a * state - self.b * input;
            stage
        } else {
            Stage::new(SMatrix::identity(), SMatrix::zeros())
        };
        // The problem type has a factor 1/2 in front of its quadratic terms.
        (stage.q, stage.r) = (2.0 * self.q, 2.0 * self.r);
        stage.q_linear = -2.0 * self.q * self.targets[k];
        stage.u_max = Vector2::new(CONSTANTS.v_max_m_s, CONSTANTS.omega_max_rad_s) - input;
        stage.u_min = Vector2::new(f64::NEG_INFINITY, -CONSTANTS.omega_max_rad_s) - input;
        if k > 0 {
            let change = input - self.inputs[k - 1];
            stage.du_min = Vector2::new(CONSTANTS.dv_min_m_s, -CONSTANTS.domega_max_rad_s) - change;
            stage.du_max = Vector2::new(CONSTANTS.dv_max_m_s, CONSTANTS.domega_max_rad_s) - change;
        }
        stage
    }

    fn terminal(&self, weight: SMatrix<f64, NX, NX>) -> Terminal<NX> {
        let center = self.states[self.length() - 1];
        let mut terminal = Terminal::new(2.0 * weight);
        terminal.p_linear = -2.0 * weight * center;
        terminal.set = TerminalSet::Ellipsoid {
            shape: weight,
            center,
            level: CONSTANTS.terminal_level,
        };
        terminal
    }
}

fn to_faer<const R: usize, const C: usize>(matrix: &SMatrix<f64, R, C>) -> Mat<f64> {
    Mat::from_fn(R, C, |i, j| matrix[(i, j)])
}
