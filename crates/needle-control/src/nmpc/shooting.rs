//! Multiple shooting on SE(3): the plan (poses and inputs), its linearisation as a stage-wise quadratic program, and the step.
//!
//! With poses g_k and inputs u_k of the plan, E = g_{k+1}^-1 g_k exp(V(u_k) dt) the defect, and right perturbations delta:
//! ```text
//! delta_{k+1} = Ad(g_{k+1}^-1 g_k) delta_k + Ad(E) J_r(V dt) dt [V1 V2] (u - u_k) + log E
//! ```
//! to first order in delta, u - u_k and E. The quadratic program has the perturbations as states and the inputs themselves as
//! inputs, so boxes and rate limits are its own. The measured pose enters by moving the whole plan rigidly: the plant is
//! left-invariant, so that changes no defect and is exact, however far the needle is from the plan.
//!
//! Gauss-Newton leaves out curvature that is proportional to the residuals, and for this plant it is that of the roll: a bend
//! turned by delta_roll changes as its cosine. Each roll perturbation therefore costs `damping` times the plan's mean stage
//! cost: a Levenberg-Marquardt term that vanishes with the residuals (Yamashita and Fukushima, 2001).

use super::configuration::{NmpcConfiguration, SpinTarget};
use super::cost::NmpcWeights;
use crate::configuration::ConfigurationError;
use crate::limits::InputLimits;
use crate::tracking::Tracker;
use mpc_qp::{OcpQp, OcpSolver, Solution, SolveError, SolveStatus, Stage, Start, Terminal};
use nalgebra::{Matrix6, Matrix6x2, Vector2, Vector6};
use needle_model::{Input, Needle, Pose, StepError};

/// Step lengths of a line search, largest first: 1, 1/2, ... .
const LINE_SEARCH_STEPS: i32 = 12;

/// Fraction of the predicted decrease that a step must bring (Armijo).
const SUFFICIENT_DECREASE: f64 = 1e-4;

/// The plan and the memory to improve it.
#[derive(Debug, Clone)]
pub(crate) struct Shooting<S> {
    weights: NmpcWeights,
    spin_target: SpinTarget,
    limits: InputLimits,
    dt_s: f64,
    damping: f64,
    problem: OcpQp<6, 2>,
    stage: Stage<6, 2>,
    terminal: Terminal<6>,
    solver: S,
    solution: Solution<6, 2>,
    start: Start,
    penalty: f64,
    trial: Plan,
    /// The plan.
    pub(crate) plan: Plan,
}

/// Poses g_0..g_N and inputs u_0..u_{N-1}.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Plan {
    pub(crate) poses: Vec<Pose>,
    pub(crate) inputs: Vec<Input>,
}

impl Plan {
    fn at_rest(horizon: usize) -> Self {
        Self {
            poses: vec![Pose::identity(); horizon + 1],
            inputs: vec![Input::ZERO; horizon],
        }
    }

    /// Moves the plan rigidly so that it starts at `pose`.
    pub(crate) fn embed(&mut self, pose: &Pose) {
        let first = self.poses[0];
        for planned in &mut self.poses {
            *planned = pose.compose(&first.relative(planned));
        }
        self.poses[0] = *pose;
    }

    /// Drops the first `steps` stages; the last ones are left for the caller to fill. Returns the first of these.
    pub(crate) fn shift(&mut self, steps: usize) -> usize {
        let n = self.inputs.len();
        let steps = steps.min(n);
        self.poses.copy_within(steps.., 0);
        self.inputs.copy_within(steps.., 0);
        n - steps
    }

    fn is_finite(&self) -> bool {
        let sum: f64 = self.inputs.iter().map(|u| u.v_mm_s + u.omega_rad_s).sum();
        sum.is_finite() && self.poses.iter().all(Pose::is_finite)
    }
}

impl<S: OcpSolver<6, 2>> Shooting<S> {
    /// Memory for a configuration that is valid.
    pub(crate) fn new(
        configuration: &NmpcConfiguration,
        make_solver: impl FnOnce(&OcpQp<6, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        let NmpcConfiguration {
            horizon,
            dt_s,
            limits,
            weights,
            spin_target,
            damping,
            ..
        } = *configuration;
        let mut stage = Stage::new(Matrix6::identity(), Matrix6x2::zeros());
        stage.r = nalgebra::Matrix2::new(weights.v, 0.0, 0.0, weights.omega);
        stage.u_min = Vector2::new(limits.v_min_mm_s, -limits.omega_max_rad_s);
        stage.u_max = Vector2::new(limits.v_max_mm_s, limits.omega_max_rad_s);
        stage.du_max = Vector2::new(
            limits.v_rate_max_mm_s2 * dt_s,
            limits.omega_rate_max_rad_s2 * dt_s,
        );
        stage.du_min = -stage.du_max;
        let terminal = Terminal::new(Matrix6::zeros());
        let stages = vec![stage.clone(); horizon];
        let problem = OcpQp::new(Vector6::zeros(), stages, terminal.clone())?;
        Ok(Self {
            weights,
            spin_target,
            limits,
            dt_s,
            damping,
            solver: make_solver(&problem)?,
            solution: Solution::new(&problem),
            problem,
            stage,
            terminal,
            start: Start::Cold,
            penalty: 0.0,
            trial: Plan::at_rest(horizon),
            plan: Plan::at_rest(horizon),
        })
    }

    fn wanted(&self, tracker: &Tracker, k: usize) -> Input {
        match self.spin_target {
            SpinTarget::Reference => tracker.inputs[k],
            SpinTarget::Rest => Input {
                omega_rad_s: 0.0,
                ..tracker.inputs[k]
            },
        }
    }

    /// Cost of the plan.
    pub(crate) fn cost(&self, plan: &Plan, tracker: &Tracker) -> f64 {
        let n = plan.inputs.len();
        let (running, end) = (self.weights.running(), self.weights.end());
        let stages: f64 = (0..n)
            .map(|k| {
                running.of_pose(&plan.poses[k], &tracker.poses[k])
                    + self
                        .weights
                        .of_input(plan.inputs[k], self.wanted(tracker, k))
            })
            .sum();
        stages + end.of_pose(&plan.poses[n], &tracker.poses[n])
    }

    /// Writes the quadratic program of the plan. `previous` was applied last, `reach_s` ago.
    fn linearise(
        &mut self,
        needle: &Needle,
        tracker: &Tracker,
        previous: Input,
        reach_s: f64,
    ) -> Result<(), LinearisationError> {
        let n = self.plan.inputs.len();
        self.problem
            .set_previous_input(&Vector2::new(previous.v_mm_s, previous.omega_rad_s))?;
        let held = self.stage.du_max;
        let hold = self.damping * self.cost(&self.plan, tracker) / (n + 1) as f64;
        for k in 0..n {
            let (pose, input) = (&self.plan.poses[k], self.plan.inputs[k]);
            let link = needle
                .step_residual(pose, input, &self.plan.poses[k + 1], self.dt_s)?
                .solved_for_target();
            let wanted = self.wanted(tracker, k);
            let stage = &mut self.stage;
            stage.c = link.c - link.b * Vector2::new(input.v_mm_s, input.omega_rad_s);
            (stage.a, stage.b) = (link.a, link.b);
            (stage.q_linear, stage.q) = self.weights.running().model(pose, &tracker.poses[k]);
            stage.q[(5, 5)] += hold;
            stage.r_linear = -stage.r * Vector2::new(wanted.v_mm_s, wanted.omega_rad_s);
            if k == 0 {
                stage.du_max = Vector2::new(
                    self.limits.v_rate_max_mm_s2 * reach_s,
                    self.limits.omega_rate_max_rad_s2 * reach_s,
                );
            } else {
                stage.du_max = held;
            }
            stage.du_min = -stage.du_max;
            self.problem.set_stage(k, stage)?;
        }
        self.stage.du_max = held;
        (self.terminal.p_linear, self.terminal.p) = self
            .weights
            .end()
            .model(&self.plan.poses[n], &tracker.poses[n]);
        self.terminal.p[(5, 5)] += hold;
        self.problem.set_terminal(&self.terminal)?;
        Ok(())
    }

    /// Solves the quadratic program of the plan; the step is left in the solution.
    pub(crate) fn solve(
        &mut self,
        needle: &Needle,
        tracker: &Tracker,
        previous: Input,
        reach_s: f64,
    ) -> (SolveStatus, usize) {
        if self.linearise(needle, tracker, previous, reach_s).is_err() {
            return (SolveStatus::NumericalTrouble, 0);
        }
        let solved = self
            .solver
            .solve(&self.problem, self.start, &mut self.solution);
        let status = match solved {
            Ok(()) => self.solution.status,
            Err(_) => SolveStatus::NumericalTrouble,
        };
        self.start = if status.has_solution() {
            Start::Warm
        } else {
            Start::Cold
        };
        (status, self.solution.iterations)
    }

    /// Moves the plan by the full step; false, and the plan unchanged, if that is not finite.
    pub(crate) fn take_full_step(&mut self) -> bool {
        self.try_step(1.0);
        if !self.trial.is_finite() {
            return false;
        }
        std::mem::swap(&mut self.plan, &mut self.trial);
        true
    }

    /// Moves the plan along the step as far as the exact penalty function falls enough; false if nowhere.
    pub(crate) fn search(&mut self, needle: &Needle, tracker: &Tracker) -> bool {
        let costates = &self.solution.multipliers.costates;
        let dual = costates
            .iter()
            .map(nalgebra::Matrix::amax)
            .fold(0.0, f64::max);
        // Costates belong to half the cost; twice that bounds the multipliers of the cost itself.
        self.penalty = self.penalty.max(3.0 * dual);
        let gap = self.gap(&self.plan, needle);
        let merit = self.cost(&self.plan, tracker) + self.penalty * gap;
        let slope = self.cost_slope(tracker) - self.penalty * gap;
        for halvings in 0..LINE_SEARCH_STEPS {
            let length = 0.5_f64.powi(halvings);
            self.try_step(length);
            let trial =
                self.cost(&self.trial, tracker) + self.penalty * self.gap(&self.trial, needle);
            let rounding = 1e-12 * merit.abs();
            if trial <= merit + SUFFICIENT_DECREASE * length * slope.min(0.0) + rounding {
                std::mem::swap(&mut self.plan, &mut self.trial);
                return true;
            }
        }
        false
    }

    /// Largest entry of the step in poses and inputs.
    pub(crate) fn step_size(&self) -> f64 {
        let poses = self.solution.x.iter().map(nalgebra::Matrix::amax);
        let inputs = self
            .solution
            .u
            .iter()
            .zip(&self.plan.inputs)
            .map(|(u, planned)| {
                (u[0] - planned.v_mm_s)
                    .abs()
                    .max((u[1] - planned.omega_rad_s).abs())
            });
        poses.chain(inputs).fold(0.0, f64::max)
    }

    fn try_step(&mut self, length: f64) {
        let (plan, solution) = (&self.plan, &self.solution);
        for (k, pose) in self.trial.poses.iter_mut().enumerate() {
            *pose = plan.poses[k].perturbed(&(solution.x[k] * length));
        }
        for (k, input) in self.trial.inputs.iter_mut().enumerate() {
            let (from, to) = (plan.inputs[k], &solution.u[k]);
            // At full length the solver's own number, without rounding beyond a bound.
            *input = if length == 1.0 {
                Input {
                    v_mm_s: to[0],
                    omega_rad_s: to[1],
                }
            } else {
                Input {
                    v_mm_s: from.v_mm_s + length * (to[0] - from.v_mm_s),
                    omega_rad_s: from.omega_rad_s + length * (to[1] - from.omega_rad_s),
                }
            };
        }
    }

    /// Sum of the defects' entries.
    fn gap(&self, plan: &Plan, needle: &Needle) -> f64 {
        let step = |k: usize| needle.step(&plan.poses[k], plan.inputs[k], self.dt_s);
        (0..plan.inputs.len())
            .map(|k| {
                step(k).map_or(f64::INFINITY, |g| {
                    g.error_from(&plan.poses[k + 1]).lp_norm(1)
                })
            })
            .sum()
    }

    /// Derivative of the cost along the step.
    fn cost_slope(&self, tracker: &Tracker) -> f64 {
        let n = self.plan.inputs.len();
        let weights = &self.weights;
        let mut slope = 0.0;
        for k in 0..n {
            let (gradient, _) = weights
                .running()
                .model(&self.plan.poses[k], &tracker.poses[k]);
            let (wanted, input, to) = (
                self.wanted(tracker, k),
                self.plan.inputs[k],
                &self.solution.u[k],
            );
            slope += gradient.dot(&self.solution.x[k])
                + weights.v * (input.v_mm_s - wanted.v_mm_s) * (to[0] - input.v_mm_s)
                + weights.omega
                    * (input.omega_rad_s - wanted.omega_rad_s)
                    * (to[1] - input.omega_rad_s);
        }
        let (gradient, _) = weights.end().model(&self.plan.poses[n], &tracker.poses[n]);
        2.0 * (slope + gradient.dot(&self.solution.x[n]))
    }

    /// Moves the solver's guess along with a plan shifted by one sample; otherwise the next solve starts cold.
    pub(crate) fn shift_guess(&mut self, steps: usize) {
        let shifted = match steps {
            0 => true,
            1 => self.start == Start::Warm && self.solution.shift(&self.problem).is_ok(),
            _ => false,
        };
        if !shifted {
            self.start = Start::Cold;
        }
    }

    /// The next solve starts from nothing.
    pub(crate) fn forget(&mut self) {
        self.start = Start::Cold;
        self.penalty = 0.0;
    }
}

/// Why a plan could not be linearised: it is not finite, or its numbers overflow.
#[derive(Debug, thiserror::Error)]
enum LinearisationError {
    #[error(transparent)]
    Step(#[from] StepError),
    #[error(transparent)]
    Problem(#[from] mpc_qp::ProblemError),
}
