//! Terminal ingredients of the nonlinear controller, and the size of their set.
//!
//! A Riccati solution makes V = xi'P xi fall by exactly the stage cost along the *linearised* needle. For the needle itself the cost
//! is computed from stage weights twice as large, which leaves as much as the stage cost itself for what linearisation leaves out,
//! and the set is shrunk until the law's true change of the input keeps the rate limits where it is largest, and V falls by the true
//! stage cost from sampled points (the procedure of Chen and Allgoewer, 1998, with samples in place of a bound). The certificate names both
//! checks; samples are evidence, not proof.

use super::configuration::{NmpcConfiguration, SpinTarget};
use super::cost::PoseWeights;
use super::ellipsoid_search::{DESCENT, descended, direction, scale_within};
use super::end::Form;
use crate::terminal::{
    ALL_COORDINATES, Chosen, End, TerminalChoice, TerminalError, TerminalProblem,
};
use lqr::{Check, Witness};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix6, Vector2, Vector6};
use needle_model::{Input, Needle, Pose, ReferencePath, StepError};

/// Stage weights of the Riccati equation over those of the controller.
const INFLATION: f64 = 2.0;

/// Least (V - V+ - l) / l that samples must show: what lies between them may be worse by as much. Without what linearisation leaves out
/// it is `INFLATION - 1` everywhere, however slow the closed loop.
const MARGIN: f64 = 0.01;

/// Largest rotation of an error in the set, rad: at half a turn its logarithm jumps.
const LARGEST_TURN_RAD: f64 = 0.9 * std::f64::consts::PI;

/// By how much the level shrinks between trials.
const SHRINK: f64 = 0.8;

/// Trials: down to a level of 1e-5 of the linear one, a hundredth of its half-axes.
const TRIALS: usize = 50;

/// Samples over all steps of a path, and at least in each.
const SAMPLES: (usize, usize) = (4_000, 48);

/// Ingredients along `path`, sized for the needle itself.
pub(crate) fn chosen(
    needle: Needle,
    path: &ReferencePath,
    configuration: &NmpcConfiguration,
) -> Result<Chosen, TerminalError> {
    let problem = problem(needle, path, configuration);
    let wanted = configuration.terminal;
    if wanted == TerminalChoice::None {
        return Ok(problem.without());
    }
    // Away from its minimum on the reference the cost is no Lyapunov function.
    if configuration.spin_target == SpinTarget::Rest {
        return match wanted {
            TerminalChoice::Auto => Ok(problem.refusing(TerminalError::SpinAtRest)),
            _ => Err(TerminalError::SpinAtRest),
        };
    }
    let mut chosen = problem.choose(wanted)?;
    if !chosen.ingredients.has_sets() {
        return Ok(chosen);
    }
    size_for(needle, path, configuration, &mut chosen)?;
    chosen.with_interior(wanted, || "the decrease of the needle itself")
}

fn problem<'a>(
    needle: Needle,
    path: &'a ReferencePath,
    configuration: &NmpcConfiguration,
) -> TerminalProblem<'a> {
    let weights = &configuration.weights;
    let diagonal = |w: PoseWeights| {
        let of = [
            w.position, w.position, w.position, w.tangent, w.tangent, w.roll,
        ];
        DMatrix::from_diagonal(&DVector::from_row_slice(&of)) * INFLATION
    };
    // A level set at the end of a chain is bounded only if roll costs something there.
    let mut end = weights.end();
    end.roll = end.roll.max(1e-3 * end.tangent);
    TerminalProblem {
        needle,
        path,
        dt_s: configuration.dt_s,
        limits: configuration.limits,
        corridor_mm: configuration.corridor_mm,
        coordinates: ALL_COORDINATES,
        q: diagonal(weights.running()),
        r: Matrix2::new(weights.v, 0.0, 0.0, weights.omega) * INFLATION,
        r_rate: None,
        end: diagonal(end),
    }
}

/// Shrinks the levels until V falls by the stage cost from every sample, and adds that check to the certificate.
fn size_for(
    needle: Needle,
    path: &ReferencePath,
    configuration: &NmpcConfiguration,
    chosen: &mut Chosen,
) -> Result<(), TerminalError> {
    let steps = match chosen.choice {
        TerminalChoice::HelixDare => 1,
        TerminalChoice::Periodic { period } => period,
        _ => path.inputs().len(),
    };
    let samples = (SAMPLES.0 / steps).max(SAMPLES.1);
    let inputs = path.inputs();
    let trials = (0..steps).map(|step| LawStep {
        needle,
        configuration,
        wanted: inputs[step],
        // After the last step of a path the law goes on about its own input.
        wanted_next: *inputs.get(step + 1).unwrap_or(&inputs[step]),
        here: chosen.ingredients.at(step),
        next: chosen.ingredients.at(step + 1),
    });
    let trials: Vec<_> = trials.collect();
    let mut scale = 1.0;
    for step in 0..=steps {
        let end = chosen.ingredients.at(step);
        scale = scale_within_turn(&end, scale);
        if let Some(corridor_mm) = configuration.corridor_mm {
            scale = scale_within_corridor(&end, corridor_mm, scale);
        }
    }
    for trial in &trials {
        scale = trial.scale_within_rates(scale)?;
    }
    let mut worst = f64::NEG_INFINITY;
    for _ in 0..TRIALS {
        worst = f64::INFINITY;
        for trial in &trials {
            worst = worst.min(trial.least_margin(scale, samples));
            if worst < MARGIN {
                break;
            }
        }
        if worst >= MARGIN {
            break;
        }
        scale *= SHRINK;
    }
    let holds = worst >= MARGIN;
    let kept = match configuration.corridor_mm {
        Some(_) => "rates and corridor",
        None => "rates",
    };
    chosen
        .ingredients
        .shrink_levels(if holds { scale } else { 0.0 });
    if let Some(certificate) = &mut chosen.ingredients.certificate {
        certificate.checks.push(Check {
            name: "decrease of the needle itself".to_owned(),
            condition: format!(
                "(V - V+ - l) / l >= {MARGIN} at {samples} samples a step, and down from the worst, and {kept} kept, of the set scaled by {scale:.3}"
            ),
            holds,
            margin: worst - MARGIN,
            tolerance: 0.0,
            witness: None::<Witness>,
        });
    }
    Ok(())
}

/// One step of the law from one step's set.
struct LawStep<'a> {
    needle: Needle,
    configuration: &'a NmpcConfiguration,
    wanted: Input,
    wanted_next: Input,
    here: End<'a>,
    next: End<'a>,
}

/// By how much the level is to be scaled, at most by `scale`, so that no error in the set turns too far.
fn scale_within_turn(end: &End<'_>, scale: f64) -> f64 {
    let p = Matrix6::from_fn(|i, j| end.p[(i, j)]);
    let (Some(level), Some(inverse)) = (end.level, p.try_inverse()) else {
        return scale;
    };
    let turns = inverse.fixed_view::<3, 3>(3, 3).into_owned();
    let farthest = level * turns.symmetric_eigenvalues().max();
    scale.min(LARGEST_TURN_RAD.powi(2) / farthest)
}

/// By how much the level is to be scaled, at most by `scale`, so that every position in the set is in the corridor.
fn scale_within_corridor(end: &End<'_>, corridor_mm: f64, scale: f64) -> f64 {
    let share = |xi: &Vector6<f64>| Some(Pose::exp(xi).position_mm.xy().amax() / corridor_mm);
    scale_within(end, scale, [Vector6::x(), Vector6::y()], share)
}

impl LawStep<'_> {
    /// By how much the level is to be scaled, at most by `scale`, so that the law's change of the input keeps the rate limits.
    fn scale_within_rates(&self, scale: f64) -> Result<f64, StepError> {
        let (Some(k), Some(k_next)) = (self.here.k, self.next.k) else {
            return Ok(scale);
        };
        let jacobians = self
            .needle
            .linearise(self.wanted, self.configuration.dt_s)?;
        let change = k_next * (jacobians.a + jacobians.b * k) - k;
        let rows = change.row_iter().map(|row| Vector6::from_fn(|i, _| row[i]));
        let share = |xi: &Vector6<f64>| self.share_of_rates(xi);
        Ok(scale_within(&self.here, scale, rows, share))
    }

    /// The largest share of a rate limit that the law uses after its step from an error.
    fn share_of_rates(&self, xi: &Vector6<f64>) -> Option<f64> {
        let (input, after) = self.step(xi).ok()??;
        let next = self.law(self.next, self.wanted_next, &after)?;
        let NmpcConfiguration { limits, dt_s, .. } = self.configuration;
        let change = Vector2::new(
            (next.v_mm_s - input.v_mm_s) / limits.v_rate_max_mm_s2,
            (next.omega_rad_s - input.omega_rad_s) / limits.omega_rate_max_rad_s2,
        );
        Some(change.amax() / dt_s)
    }

    fn law(&self, end: End<'_>, wanted: Input, xi: &Vector6<f64>) -> Option<Input> {
        let deviation = end.k? * xi;
        Some(Input {
            v_mm_s: wanted.v_mm_s + deviation[0],
            omega_rad_s: wanted.omega_rad_s + deviation[1],
        })
    }

    /// The law's input at an error and the needle's error after it; `None` without a law.
    fn step(&self, xi: &Vector6<f64>) -> Result<Option<(Input, Vector6<f64>)>, StepError> {
        let Some(input) = self.law(self.here, self.wanted, xi) else {
            return Ok(None);
        };
        let dt_s = self.configuration.dt_s;
        let reference = self.needle.step(&Pose::identity(), self.wanted, dt_s)?;
        let pose = self.needle.step(&Pose::exp(xi), input, dt_s)?;
        Ok(Some((input, pose.error_from(&reference))))
    }

    /// Least (V - V+ - l) / l over samples of the set's boundary, and of the boundary at half its half-axes, and downhill from the worst
    /// of each block of them. Without a set, a law or a step from a sample nothing holds.
    fn least_margin(&self, scale: f64, samples: usize) -> f64 {
        let p = Matrix6::from_fn(|i, j| self.here.p[(i, j)]);
        let (Some(level), Some(factor)) = (self.here.level, p.cholesky()) else {
            return f64::NEG_INFINITY;
        };
        let (block, ..) = DESCENT;
        let mut least = f64::INFINITY;
        for size in [1.0, 0.5] {
            let radius = (level * scale).sqrt() * size;
            let margin = |direction: &Vector6<f64>| {
                let on_sphere = factor.l().tr_solve_lower_triangular(direction);
                on_sphere
                    .and_then(|xi| self.margin(&(xi * radius)).ok().flatten())
                    .filter(|margin| !margin.is_nan())
                    .unwrap_or(f64::NEG_INFINITY)
            };
            for first in (0..samples / 2).step_by(block) {
                let tried = (first..(first + block).min(samples / 2)).map(direction);
                let found = tried.map(|tried| (margin(&tried), tried));
                if let Some(worst) = found.min_by(|a, b| a.0.total_cmp(&b.0)) {
                    least = least.min(descended(worst, margin));
                }
            }
        }
        least
    }

    /// (V - V+ - l) / l of the law's step from an error; `None` without a law.
    fn margin(&self, xi: &Vector6<f64>) -> Result<Option<f64>, StepError> {
        let Some((input, after)) = self.step(xi)? else {
            return Ok(None);
        };
        let weights = &self.configuration.weights;
        let spent = weights.running().of_pose(&Pose::exp(xi), &Pose::identity())
            + weights.of_input(input, self.wanted);
        let fall = xi.dot(&(self.here.p * xi)) - after.dot(&(self.next.p * after));
        Ok(Some((fall - spent) / spent))
    }
}

impl Chosen {
    /// What the nonlinear controller puts at the end of a horizon that ends at `step`; `None` for its own weights.
    pub(crate) fn form(&self, step: usize) -> Option<Form> {
        (self.choice != TerminalChoice::None).then(|| self.ingredients.at(step).into())
    }
}
