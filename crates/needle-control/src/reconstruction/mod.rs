//! A reference from positions alone: the trajectory optimisation that `needle-model` poses, solved over the whole path.
//!
//! Gauss-Newton by multiple shooting, as the nonlinear controller does, with one stage for each step of the path: the structured
//! solver's work grows linearly with their number. A Levenberg-Marquardt term on the change of roll grows while steps fail to
//! lower an exact penalty function and shrinks while they succeed. The answer is the simulation of the inputs found, so the
//! needle executes it exactly; what the needle cannot follow shows as distance to the targets. The first pose is the guess's.

use mpc_qp::{
    OcpQp, OcpSolver, ProblemError, Solution, SolveError, SolverSettings, Stage, Start,
    StructuredSolver, Terminal,
};
use nalgebra::{Matrix6, Matrix6x2, Vector2, Vector6};
use needle_model::{
    CurvatureExcess, Input, Pose, PositionPathProblem, ReferencePath, ReferencePathError, StepError,
};

/// Linearisations at most.
const MAX_ITERATIONS: usize = 60;

/// Relative fall of the merit below which the iteration has converged.
const SETTLED: f64 = 1e-7;

/// Largest entry of a step, mm, rad, mm/s and rad/s alike, that is none: the merit cannot tell such steps apart.
const STATIONARY: f64 = 1e-7;

/// First weight on the change of roll, and the range in which it is adapted, as multiples of the mean stage cost.
const DAMPING: [f64; 3] = [0.1, 1e-6, 1e6];

/// Relative excess of curvature that is reported.
const EXCESS_MARGIN: f64 = 0.02;

/// A path that a needle executes, and how close it comes to the positions.
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructedPath {
    /// The path; its largest defect is rounding.
    pub path: ReferencePath,
    /// Root mean square distance to the targets, mm.
    pub rms_mm: f64,
    /// Largest distance to a target, mm.
    pub worst_mm: f64,
    /// Step of the largest distance.
    pub worst_step: usize,
    /// Where the positions bend more than the needle can; empty for a feasible curve.
    pub excesses: Vec<CurvatureExcess>,
    /// Linearisations made.
    pub iterations: usize,
    /// Whether the last one settled; false where iterations or damping ran out first.
    pub converged: bool,
}

/// Why there is no path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReconstructionError {
    /// An iterate is not finite.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The quadratic program refuses the data.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// The solver refuses the problem.
    #[error(transparent)]
    Solver(#[from] SolveError),
    /// The simulation of the inputs is no path.
    #[error(transparent)]
    Path(#[from] ReferencePathError),
}

/// Poses and inputs that come closest to the positions of `problem`.
///
/// # Errors
/// [`ReconstructionError`], which a problem that `needle-model` accepted should not cause.
pub fn reconstruct_path(
    problem: &PositionPathProblem,
) -> Result<ReconstructedPath, ReconstructionError> {
    let mut search = Search::new(problem)?;
    let mut converged = false;
    let mut iterations = 0;
    while iterations < MAX_ITERATIONS && !converged {
        iterations += 1;
        let fall = search.improve()?;
        converged = fall.is_some_and(|fall| fall < SETTLED);
        if search.damping > DAMPING[2] {
            break;
        }
    }
    let guess = problem.initial_guess();
    let path = ReferencePath::from_inputs(
        problem.needle(),
        guess.poses()[0],
        search.inputs,
        guess.dt_s(),
    )?;
    let distances = path
        .poses()
        .iter()
        .zip(problem.targets_mm())
        .map(|(pose, y)| (pose.position_mm - y).norm());
    let (mut squares, mut worst) = (0.0, (0, 0.0));
    for (step, distance) in distances.enumerate() {
        squares += distance * distance;
        if distance > worst.1 {
            worst = (step, distance);
        }
    }
    Ok(ReconstructedPath {
        rms_mm: f64::sqrt(squares / path.poses().len() as f64),
        worst_mm: worst.1,
        worst_step: worst.0,
        excesses: problem
            .curve()
            .curvature_excesses(problem.needle(), EXCESS_MARGIN),
        path,
        iterations,
        converged,
    })
}

struct Search<'a> {
    problem: &'a PositionPathProblem,
    program: OcpQp<6, 2>,
    stage: Stage<6, 2>,
    solver: StructuredSolver<6, 2>,
    solution: Solution<6, 2>,
    poses: Vec<Pose>,
    inputs: Vec<Input>,
    damping: f64,
    penalty: f64,
}

impl<'a> Search<'a> {
    fn new(problem: &'a PositionPathProblem) -> Result<Self, ReconstructionError> {
        let (guess, settings) = (problem.initial_guess(), problem.settings());
        let mut stage = Stage::new(Matrix6::identity(), Matrix6x2::zeros());
        stage.u_min = Vector2::new(settings.v_min_mm_s, -settings.omega_max_rad_s);
        stage.u_max = Vector2::new(settings.v_max_mm_s, settings.omega_max_rad_s);
        let stages = vec![stage.clone(); guess.inputs().len()];
        let program = OcpQp::new(Vector6::zeros(), stages, Terminal::new(Matrix6::zeros()))?;
        Ok(Self {
            problem,
            solver: StructuredSolver::new(&program, SolverSettings::default())?,
            solution: Solution::new(&program),
            program,
            stage,
            poses: guess.poses().to_vec(),
            inputs: guess.inputs().to_vec(),
            damping: DAMPING[0],
            penalty: 0.0,
        })
    }

    /// Half the sum of squares, and the sum of the defects' entries.
    fn merit_terms(&self, poses: &[Pose], inputs: &[Input]) -> Result<(f64, f64), StepError> {
        let (mut cost, mut gap) = (0.0, 0.0);
        for (k, &input) in inputs.iter().enumerate() {
            if let Some(stage) = self.problem.stage(k, &poses[k], input, &poses[k + 1])? {
                cost += 0.5 * stage.residual.norm_squared();
                gap += stage.step.value.lp_norm(1);
            }
        }
        Ok((
            cost + 0.5
                * self
                    .problem
                    .terminal(&poses[inputs.len()])
                    .value
                    .norm_squared(),
            gap,
        ))
    }

    fn linearise(&mut self, hold: f64) -> Result<(), ReconstructionError> {
        let dt_s = self.problem.settings().dt_s;
        for (k, &input) in self.inputs.iter().enumerate() {
            let (pose, next) = (&self.poses[k], &self.poses[k + 1]);
            let Some(terms) = self.problem.stage(k, pose, input, next)? else {
                continue;
            };
            let link = self
                .problem
                .needle()
                .step_residual(pose, input, next, dt_s)?
                .solved_for_target();
            let here = Vector2::new(input.v_mm_s, input.omega_rad_s);
            let stage = &mut self.stage;
            stage.c = link.c - link.b * here;
            (stage.a, stage.b) = (link.a, link.b);
            stage.q = terms.by_pose.tr_mul(&terms.by_pose);
            stage.q[(5, 5)] += hold;
            stage.q_linear = terms.by_pose.tr_mul(&terms.residual);
            stage.r = terms.by_input.tr_mul(&terms.by_input);
            stage.r_linear = terms.by_input.tr_mul(&terms.residual) - stage.r * here;
            self.program.set_stage(k, stage)?;
        }
        let last = self.problem.terminal(&self.poses[self.inputs.len()]);
        let mut terminal = Terminal::new(last.by_pose.tr_mul(&last.by_pose));
        terminal.p[(5, 5)] += hold;
        terminal.p_linear = last.by_pose.tr_mul(&last.value);
        self.program.set_terminal(&terminal)?;
        Ok(())
    }

    /// One step; the relative fall of the merit, or `None` where none was found and the damping rose.
    fn improve(&mut self) -> Result<Option<f64>, ReconstructionError> {
        let (cost, gap) = self.merit_terms(&self.poses, &self.inputs)?;
        let mean = cost / self.poses.len() as f64;
        self.linearise(self.damping * mean)?;
        self.solver
            .solve(&self.program, Start::Cold, &mut self.solution)?;
        let rejected = |search: &mut Self| {
            search.damping *= 10.0;
            Ok(None)
        };
        if !self.solution.status.has_solution() {
            return rejected(self);
        }
        let costates = &self.solution.multipliers.costates;
        self.penalty = self
            .penalty
            .max(costates.iter().map(|y| 1.5 * y.amax()).fold(0.0, f64::max));
        let steps = self.poses.iter().zip(&self.solution.x);
        let poses: Vec<_> = steps.map(|(pose, x)| pose.perturbed(x)).collect();
        let moved = |u: &Vector2<f64>| Input {
            v_mm_s: u[0],
            omega_rad_s: u[1],
        };
        let inputs: Vec<_> = self.solution.u.iter().map(moved).collect();
        let moves = self.solution.x.iter().map(nalgebra::Matrix::amax);
        let changes = inputs.iter().zip(&self.inputs).map(|(new, old)| {
            let change = Vector2::new(new.v_mm_s - old.v_mm_s, new.omega_rad_s - old.omega_rad_s);
            change.amax()
        });
        if moves.chain(changes).fold(0.0, f64::max) < STATIONARY {
            return Ok(Some(0.0));
        }
        // A step beyond what the model can evaluate is too long, as one whose merit is not a number.
        let Ok((new_cost, new_gap)) = self.merit_terms(&poses, &inputs) else {
            return rejected(self);
        };
        let (before, after) = (cost + self.penalty * gap, new_cost + self.penalty * new_gap);
        if after.is_nan() || after > before {
            return rejected(self);
        }
        (self.poses, self.inputs) = (poses, inputs);
        self.damping = (self.damping / 3.0).max(DAMPING[1]);
        Ok(Some((before - after) / before.max(f64::MIN_POSITIVE)))
    }
}
