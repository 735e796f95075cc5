//! Gauss-Newton by multiple shooting over a whole path, as the nonlinear controller does over its horizon: the structured solver's work
//! grows linearly with the number of stages. Limits and rates hold for every iterate; the first input may be any within the limits.
//!
//! A step, or its half, quarter or eighth, is taken if it lowers the cost or the sum of the defects below those of every iterate before it
//! (a filter, Fletcher and Leyffer, 2002): with one weight between the two, defects of some microns forbid the long turns of roll that a
//! path close to the needle's bend takes. A Levenberg-Marquardt term on the change of roll grows while steps fail and shrinks while
//! they succeed. Where nothing helps the search goes on, once, from the closest simulation of its inputs met so far, which has no defect.

use super::ReconstructionError;
use crate::limits::InputLimits;
use mpc_qp::{
    OcpQp, OcpSolver, Solution, SolverSettings, Stage, Start, StructuredSolver, Terminal,
};
use nalgebra::{Matrix6, Matrix6x2, Vector2, Vector6};
use needle_model::{
    Input, Pose, PositionPathProblem, PositionPathSettings, ReferencePath, StepError,
};

/// Relative change of the cost, and sum of the defects, mm and rad alike, at which the iteration has settled. Against targets
/// that are worth their sigma both are nothing: 1e-4 rad over 100 mm are 0.01 mm.
const SETTLED: [f64; 2] = [1e-4, 1e-4];

/// Largest entry of a step, mm, rad, mm/s and rad/s alike, that is none.
const STATIONARY: f64 = 1e-7;

/// First weight on the change of roll, and the range in which it is adapted, as multiples of the mean stage cost, or of one, a deviation
/// by a sigma, where the guess passes through the targets and its cost says nothing.
const DAMPING: [f64; 3] = [0.1, 1e-6, 1e6];

/// Parts of a step that are tried.
const PARTS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// Relative fall of the defects that is one; the cost may fall by less.
const FALL: f64 = 0.01;

/// Defects beyond the guess's that an iterate may have where the guess has next to none, mm and rad alike.
const ROOM: f64 = 1e-3;

/// What an iterate is judged by.
#[derive(Debug, Clone, Copy)]
struct Merit {
    /// Half the sum of squares.
    cost: f64,
    /// Sum of the defects' entries.
    gap: f64,
}

/// Where the search stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    Searching,
    /// From the simulation of the inputs.
    Restarted,
    Settled,
    Stuck,
}

#[derive(Debug, Clone)]
struct Iterate {
    poses: Vec<Pose>,
    inputs: Vec<Input>,
}

pub(super) struct Search<'a> {
    problem: &'a PositionPathProblem,
    program: OcpQp<6, 2>,
    stage: Stage<6, 2>,
    /// Largest change of each input between steps.
    most_change: Vector2<f64>,
    solver: StructuredSolver<6, 2>,
    solution: Solution<6, 2>,
    here: Iterate,
    merit: Merit,
    /// Merits of the iterates that were left.
    filter: Vec<Merit>,
    widest_gap: f64,
    damping: f64,
    progress: Progress,
    /// The inputs whose simulation costs least, and that simulation.
    closest: (f64, Iterate),
}

impl<'a> Search<'a> {
    pub(super) fn new(problem: &'a PositionPathProblem) -> Result<Self, ReconstructionError> {
        let (guess, settings) = (problem.initial_guess(), problem.settings());
        let mut stage = Stage::new(Matrix6::identity(), Matrix6x2::zeros());
        stage.u_min = Vector2::new(settings.v_min_mm_s, -settings.omega_max_rad_s);
        stage.u_max = Vector2::new(settings.v_max_mm_s, settings.omega_max_rad_s);
        let most_change =
            Vector2::new(settings.v_rate_max_mm_s2, settings.omega_rate_max_rad_s2) * settings.dt_s;
        let mut stages = vec![stage.clone(); guess.inputs().len()];
        for later in stages.iter_mut().skip(1) {
            (later.du_min, later.du_max) = (-most_change, most_change);
        }
        let program = OcpQp::new(Vector6::zeros(), stages, Terminal::new(Matrix6::zeros()))?;
        let here = Iterate {
            poses: guess.poses().to_vec(),
            inputs: within_reach(settings, guess.inputs()),
        };
        let (merit, closest) = (merit(problem, &here)?, simulated(problem, &here)?);
        Ok(Self {
            problem,
            solver: StructuredSolver::new(&program, SolverSettings::default())?,
            solution: Solution::new(&program),
            program,
            stage,
            most_change,
            here,
            widest_gap: merit.gap + ROOM,
            merit,
            filter: Vec::new(),
            damping: DAMPING[0],
            progress: Progress::Searching,
            closest,
        })
    }

    pub(super) fn goes_on(&self) -> bool {
        matches!(self.progress, Progress::Searching | Progress::Restarted)
    }

    /// The path whose simulation came closest, and whether the search settled.
    pub(super) fn closest(self) -> Result<(ReferencePath, bool), ReconstructionError> {
        let (first, inputs) = (self.here.poses[0], self.closest.1.inputs);
        let dt_s = self.problem.settings().dt_s;
        let path = ReferencePath::from_inputs(self.problem.needle(), first, inputs, dt_s)?;
        Ok((path, self.progress == Progress::Settled))
    }

    /// One linearisation: a step, or more damping.
    pub(super) fn improve(&mut self) -> Result<(), ReconstructionError> {
        let mean = self.merit.cost / self.here.poses.len() as f64;
        self.linearise(self.damping * mean.max(1.0))?;
        self.solver
            .solve(&self.program, Start::Cold, &mut self.solution)?;
        let solved = self.solution.status.has_solution();
        if solved && self.damping <= DAMPING[0] && self.step_size() < STATIONARY {
            self.progress = Progress::Settled;
            return Ok(());
        }
        if solved && PARTS.iter().any(|&part| self.takes(part)) {
            let simulated = simulated(self.problem, &self.here)?;
            if simulated.0 < self.closest.0 {
                self.closest = simulated;
            }
            return Ok(());
        }
        self.damping *= 10.0;
        if self.damping > DAMPING[2] {
            self.restart();
        }
        Ok(())
    }

    /// Goes on from the closest simulation, once.
    fn restart(&mut self) {
        if self.progress == Progress::Restarted {
            self.progress = Progress::Stuck;
            return;
        }
        self.progress = Progress::Restarted;
        self.filter.clear();
        self.damping = DAMPING[0];
        let (cost, iterate) = &self.closest;
        self.merit = Merit {
            cost: *cost,
            gap: 0.0,
        };
        self.here.clone_from(iterate);
    }

    /// Takes that part of the step if the filter lets it pass.
    fn takes(&mut self, part: f64) -> bool {
        let moved = self.moved(part);
        // A step beyond what the model can evaluate is too long.
        let Ok(found) = merit(self.problem, &moved) else {
            return false;
        };
        let change = (found.cost - self.merit.cost).abs();
        // A step that is cut or held back tells nothing of the end.
        let whole = part == 1.0 && self.damping <= DAMPING[0];
        let settled = whole && change < SETTLED[0] * self.merit.cost && found.gap < SETTLED[1];
        let passes = |before: &Merit| {
            found.cost < before.cost * (1.0 - f64::EPSILON) || found.gap < before.gap * (1.0 - FALL)
        };
        let better = self.filter.iter().chain([&self.merit]).all(passes);
        if !(settled || better && found.gap <= self.widest_gap) {
            return false;
        }
        self.filter.push(self.merit);
        (self.here, self.merit) = (moved, found);
        self.damping = match part < 1.0 {
            true => 3.0 * self.damping,
            false => (self.damping / 3.0).max(DAMPING[1]),
        };
        if settled {
            self.progress = Progress::Settled;
        }
        true
    }

    fn moved(&self, part: f64) -> Iterate {
        let poses = self.here.poses.iter().zip(&self.solution.x);
        let inputs = self.here.inputs.iter().zip(&self.solution.u);
        // A whole step ends where the limits were kept, to the last digit.
        let toward = |old: f64, new: f64| match part < 1.0 {
            true => old + part * (new - old),
            false => new,
        };
        Iterate {
            poses: poses.map(|(pose, x)| pose.perturbed(&(x * part))).collect(),
            inputs: inputs
                .map(|(old, u)| Input {
                    v_mm_s: toward(old.v_mm_s, u[0]),
                    omega_rad_s: toward(old.omega_rad_s, u[1]),
                })
                .collect(),
        }
    }

    /// Largest entry of the step.
    fn step_size(&self) -> f64 {
        let moves = self.solution.x.iter().map(nalgebra::Matrix::amax);
        let inputs = self.here.inputs.iter().zip(&self.solution.u);
        let changes = inputs.map(|(old, u)| (u - Vector2::new(old.v_mm_s, old.omega_rad_s)).amax());
        moves.chain(changes).fold(0.0, f64::max)
    }

    fn linearise(&mut self, hold: f64) -> Result<(), ReconstructionError> {
        let dt_s = self.problem.settings().dt_s;
        for (k, &input) in self.here.inputs.iter().enumerate() {
            let (pose, next) = (&self.here.poses[k], &self.here.poses[k + 1]);
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
            stage.du_max = match k {
                0 => Vector2::repeat(f64::INFINITY),
                _ => self.most_change,
            };
            stage.du_min = -stage.du_max;
            stage.c = link.c - link.b * here;
            (stage.a, stage.b) = (link.a, link.b);
            stage.q = terms.by_pose.tr_mul(&terms.by_pose);
            stage.q[(5, 5)] += hold;
            stage.q_linear = terms.by_pose.tr_mul(&terms.residual);
            stage.r = terms.by_input.tr_mul(&terms.by_input);
            stage.r_linear = terms.by_input.tr_mul(&terms.residual) - stage.r * here;
            self.program.set_stage(k, stage)?;
        }
        let last = self
            .problem
            .terminal(&self.here.poses[self.here.inputs.len()]);
        let mut terminal = Terminal::new(last.by_pose.tr_mul(&last.by_pose));
        terminal.p[(5, 5)] += hold;
        terminal.p_linear = last.by_pose.tr_mul(&last.value);
        self.program.set_terminal(&terminal)?;
        Ok(())
    }
}

fn merit(
    problem: &PositionPathProblem,
    Iterate { poses, inputs }: &Iterate,
) -> Result<Merit, StepError> {
    let last = problem.terminal(&poses[inputs.len()]).value;
    let (mut cost, mut gap) = (0.5 * last.norm_squared(), 0.0);
    for (k, &input) in inputs.iter().enumerate() {
        if let Some(stage) = problem.stage(k, &poses[k], input, &poses[k + 1])? {
            cost += 0.5 * stage.residual.norm_squared();
            gap += stage.step.value.lp_norm(1);
        }
    }
    Ok(Merit { cost, gap })
}

/// Inputs that limits and rates allow one after the other, near those given; a solver keeps both to its tolerance.
fn within_reach(settings: &PositionPathSettings, inputs: &[Input]) -> Vec<Input> {
    let limits = InputLimits {
        v_min_mm_s: settings.v_min_mm_s,
        v_max_mm_s: settings.v_max_mm_s,
        omega_max_rad_s: settings.omega_max_rad_s,
        v_rate_max_mm_s2: settings.v_rate_max_mm_s2,
        omega_rate_max_rad_s2: settings.omega_rate_max_rad_s2,
    };
    let mut held: Option<Input> = None;
    let reached = inputs.iter().map(|&input| {
        let before = held.unwrap_or_else(|| limits.admissible(input, input, f64::INFINITY));
        *held.insert(limits.admissible(input, before, settings.dt_s))
    });
    reached.collect()
}

/// The needle's own way under an iterate's inputs, as far as rates allow them, and its cost.
fn simulated(
    problem: &PositionPathProblem,
    from: &Iterate,
) -> Result<(f64, Iterate), ReconstructionError> {
    let (first, dt_s) = (from.poses[0], problem.settings().dt_s);
    let inputs = within_reach(problem.settings(), &from.inputs);
    let path = ReferencePath::from_inputs(problem.needle(), first, inputs, dt_s)?;
    let iterate = Iterate {
        poses: path.poses().to_vec(),
        inputs: path.inputs().to_vec(),
    };
    Ok((merit(problem, &iterate)?.cost, iterate))
}
