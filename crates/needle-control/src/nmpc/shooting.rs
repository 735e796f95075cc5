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
use super::end::{Form, HorizonEnd, Takeover, blank_goal};
use super::plan::Plan;
use super::stray::Stray;
use crate::configuration::ConfigurationError;
use crate::corridor::Corridor;
use crate::follower::Follower;
use crate::limits::InputLimits;
use crate::plan_solver::MakeSolver;
use crate::program::{Account, Goal, Programs};
use crate::tracking::Tracker;
use mpc_qp::{OcpQp, SolveStatus, Stage, Terminal};
use nalgebra::{Matrix2, Matrix6, Matrix6x2, Vector2, Vector6};
use needle_model::{Input, Needle, StepError};
use std::time::Instant;

/// The plan and the memory to improve it.
#[derive(Debug, Clone)]
pub(crate) struct Shooting {
    configured: NmpcWeights,
    /// The weights in force at this sample.
    pub(super) weights: NmpcWeights,
    spin_target: SpinTarget,
    pub(super) limits: InputLimits,
    pub(super) dt_s: f64,
    damping: f64,
    pub(super) corridor: Option<Corridor>,
    pub(super) programs: Programs<6>,
    stage: Stage<6, 2>,
    terminal: Terminal<6>,
    goal: Goal<6>,
    pub(super) end: HorizonEnd,
    pub(super) penalty: f64,
    pub(super) trial: Plan,
    /// The plan.
    pub(crate) plan: Plan,
}

impl Shooting {
    /// Memory for a configuration that is valid; `with_set` if a terminal set will be asked for.
    pub(crate) fn new(
        configuration: &NmpcConfiguration,
        with_set: bool,
        make_solver: MakeSolver<'_, 6>,
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
        stage.r = Matrix2::new(weights.v, 0.0, 0.0, weights.omega);
        stage.u_min = Vector2::new(limits.v_min_mm_s, -limits.omega_max_rad_s);
        stage.u_max = Vector2::new(limits.v_max_mm_s, limits.omega_max_rad_s);
        stage.du_max = rates(&limits) * dt_s;
        stage.du_min = -stage.du_max;
        let terminal = Terminal::new(Matrix6::zeros());
        let corridor = configuration.corridor();
        let softening = corridor.map(|corridor| corridor.softening());
        if corridor.is_some() {
            stage.rows = Corridor::blank_rows();
        }
        let stages = vec![stage.clone(); horizon];
        let problem = OcpQp::new(Vector6::zeros(), stages, terminal.clone())?
            .with_softening(softening.unwrap_or_default())?;
        let goal = blank_goal();
        Ok(Self {
            configured: weights,
            weights,
            spin_target,
            limits,
            dt_s,
            damping,
            corridor,
            programs: Programs::new(problem, with_set.then_some(&goal), make_solver)?,
            stage,
            terminal,
            goal,
            end: HorizonEnd::Weights(weights.end()),
            penalty: 0.0,
            trial: Plan::at_rest(horizon),
            plan: Plan::at_rest(horizon),
        })
    }

    /// What stands at the end of the horizon from now on: a form, or the end weights; and what the spin weighs. How far the tip is
    /// off changes both where the spin is the controller's to find; a form and its set belong to the weights as they are configured.
    pub(crate) fn weigh(&mut self, form: Option<Form>, stray: &Stray) {
        self.weights = self.configured;
        self.end = match (form, self.spin_target) {
            (Some(form), _) => HorizonEnd::Form(form),
            (None, SpinTarget::Reference) => HorizonEnd::Weights(self.configured.end()),
            (None, SpinTarget::Rest) => {
                self.weights.omega += stray.spin(&self.configured);
                HorizonEnd::Weights(stray.end(&self.configured))
            }
        };
        self.stage.r[(1, 1)] = self.weights.omega;
    }

    pub(super) fn wanted(&self, tracker: &Tracker, k: usize) -> Input {
        match self.spin_target {
            SpinTarget::Reference => tracker.inputs[k],
            SpinTarget::Rest => Input {
                omega_rad_s: 0.0,
                ..tracker.inputs[k]
            },
        }
    }

    /// Cost of a plan.
    pub(crate) fn cost(&self, plan: &Plan, tracker: &Tracker) -> f64 {
        let n = plan.inputs.len();
        let running = self.weights.running();
        let stages: f64 = (0..n)
            .map(|k| {
                running.of_pose(&plan.poses[k], &tracker.poses[k])
                    + self
                        .weights
                        .of_input(plan.inputs[k], self.wanted(tracker, k))
            })
            .sum();
        stages + self.end.of_pose(&plan.poses[n], &tracker.poses[n])
    }

    /// Cost of a plan and the price of leaving the corridor.
    pub(crate) fn priced_cost(&self, plan: &Plan, tracker: &Tracker) -> f64 {
        let price = |it: &Corridor| it.cost(&plan.poses, &tracker.poses);
        self.cost(plan, tracker) + self.corridor.as_ref().map_or(0.0, price)
    }

    /// How far the plan leaves the corridor, mm.
    pub(crate) fn left_by_mm(&self, tracker: &Tracker) -> f64 {
        let poses = self.plan.poses.iter().copied();
        self.corridor
            .map_or(0.0, |it| it.left_by_mm(poses, &tracker.poses))
    }

    /// How far the plan's end is outside the terminal set, in `sqrt(xi'P xi)`.
    pub(crate) fn outside(&self, tracker: &Tracker) -> f64 {
        let n = self.plan.inputs.len();
        self.end.outside(&self.plan.poses[n], &tracker.poses[n])
    }

    /// Writes the quadratic program of the plan; true if it has a goal. `previous` was applied last, `reach_s` ago.
    fn linearise(
        &mut self,
        needle: &Needle,
        tracker: &Tracker,
        previous: Input,
        reach_s: f64,
    ) -> Result<bool, LinearisationError> {
        let n = self.plan.inputs.len();
        let hold = self.damping * self.cost(&self.plan, tracker) / (n + 1) as f64;
        let problem = self.programs.problem_mut();
        problem.set_previous_input(&Vector2::new(previous.v_mm_s, previous.omega_rad_s))?;
        let rates = rates(&self.limits);
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
            stage.du_max = rates * if k == 0 { reach_s } else { self.dt_s };
            stage.du_min = -stage.du_max;
            if let Some(corridor) = &self.corridor {
                corridor.write(stage, &self.plan.poses[k + 1], &tracker.poses[k + 1]);
            }
            self.programs.problem_mut().set_stage(k, stage)?;
        }
        let ends = [&self.plan.poses[n], &tracker.poses[n]];
        (self.terminal.p_linear, self.terminal.p) = self.end.model(ends[0], ends[1])?;
        self.terminal.p[(5, 5)] += hold;
        self.programs.problem_mut().set_terminal(&self.terminal)?;
        let takeover = Takeover {
            wanted: tracker.input_beyond(),
            change: rates * self.dt_s,
        };
        // The stage last written is the last one.
        Ok(self.end.aim(&mut self.goal, ends, &self.stage, &takeover))
    }

    /// Solves the quadratic program of the plan by the deadline of a step that began at `started`; the step is left in the solution.
    pub(crate) fn solve(&mut self, follower: &Follower, reach_s: f64, started: Instant) -> Account {
        let Follower {
            needle,
            tracker,
            guard,
            ..
        } = follower;
        match self.linearise(needle, tracker, guard.previous(), reach_s) {
            Ok(aims) => {
                let goal = aims.then_some(&self.goal);
                self.programs.solve(goal, guard.remaining(started))
            }
            Err(_) => Account {
                status: SolveStatus::NumericalTrouble,
                solves: 0,
                iterations: 0,
                violation: 0.0,
            },
        }
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

    /// Moves the solvers' guesses along with a plan shifted by whole samples.
    pub(crate) fn shift_guess(&mut self, steps: usize) {
        self.programs.shift(steps);
    }

    /// The next solve starts from nothing.
    pub(crate) fn forget(&mut self) {
        self.programs.forget();
        self.penalty = 0.0;
    }
}

/// Largest change of each input in a second.
fn rates(limits: &InputLimits) -> Vector2<f64> {
    Vector2::new(limits.v_rate_max_mm_s2, limits.omega_rate_max_rad_s2)
}

/// Why a plan could not be linearised: it is not finite, or its numbers overflow.
#[derive(Debug, thiserror::Error)]
enum LinearisationError {
    #[error(transparent)]
    Step(#[from] StepError),
    #[error(transparent)]
    Problem(#[from] mpc_qp::ProblemError),
}
