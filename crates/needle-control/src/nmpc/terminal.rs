//! Terminal ingredients of the nonlinear controller, and the size of their set.
//!
//! A Riccati solution makes V = xi'P xi fall by exactly the stage cost along the *linearised* needle. For the needle itself the cost
//! is computed from stage weights twice as large, which leaves as much as the stage cost itself for what linearisation leaves out,
//! and the set is shrunk until V falls by the true stage cost from sampled points of it (the procedure of Chen and Allgoewer, 1998, with
//! samples in place of a bound). The certificate names that check; samples are evidence, not proof.

use super::configuration::{NmpcConfiguration, SpinTarget};
use super::cost::PoseWeights;
use super::end::Form;
use crate::terminal::{
    ALL_COORDINATES, Chosen, End, TerminalChoice, TerminalError, TerminalProblem,
};
use lqr::{Check, Witness};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix6, Vector6};
use needle_model::{Input, Needle, Pose, ReferencePath, StepError};

/// Stage weights of the Riccati equation over those of the controller.
const INFLATION: f64 = 2.0;

/// Least (V - V+ - l) / V that samples must show: what lies between them may be worse by as much.
const MARGIN: f64 = 1e-4;

/// Radii of the descent from the worst sample, and directions tried at each.
const DESCENT: ([f64; 4], usize) = ([0.3, 0.1, 0.03, 0.01], 24);

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
    let mut scale = 1.0;
    let mut worst = f64::NEG_INFINITY;
    for _ in 0..TRIALS {
        worst = f64::INFINITY;
        for step in 0..steps {
            let trial = Fall {
                needle,
                configuration,
                wanted: path.inputs()[step],
                here: chosen.ingredients.at(step),
                next: chosen.ingredients.at(step + 1).p,
            };
            worst = worst.min(trial.least_margin(scale, samples)?);
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
    chosen
        .ingredients
        .shrink_levels(if holds { scale } else { 0.0 });
    if let Some(certificate) = &mut chosen.ingredients.certificate {
        certificate.checks.push(Check {
            name: "decrease of the needle itself".to_owned(),
            condition: format!(
                "(V - V+ - l) / V >= {MARGIN:e} at {samples} samples a step, and down from the worst, of the set scaled by {scale:.3}"
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
struct Fall<'a> {
    needle: Needle,
    configuration: &'a NmpcConfiguration,
    wanted: Input,
    here: End<'a>,
    next: &'a DMatrix<f64>,
}

impl Fall<'_> {
    /// Least (V - V+ - l) / V over samples of the set's boundary, and of the boundary at half its half-axes, and downhill from the worst
    /// of each.
    fn least_margin(&self, scale: f64, samples: usize) -> Result<f64, StepError> {
        // Without a set or a law there is nothing to sample, and nothing holds.
        let (Some(level), Some(k)) = (self.here.level, self.here.k) else {
            return Ok(f64::NEG_INFINITY);
        };
        let p = Matrix6::from_fn(|i, j| self.here.p[(i, j)]);
        let next = Matrix6::from_fn(|i, j| self.next[(i, j)]);
        let Some(factor) = p.cholesky() else {
            return Ok(f64::NEG_INFINITY);
        };
        let dt_s = self.configuration.dt_s;
        let reference = self.needle.step(&Pose::identity(), self.wanted, dt_s)?;
        let margin = |direction: &Vector6<f64>, value: f64| -> Result<f64, StepError> {
            let point = direction * value.sqrt();
            let Some(xi) = factor.l().tr_solve_lower_triangular(&point) else {
                return Ok(f64::NEG_INFINITY);
            };
            let deviation = k * xi;
            let input = Input {
                v_mm_s: self.wanted.v_mm_s + deviation[0],
                omega_rad_s: self.wanted.omega_rad_s + deviation[1],
            };
            let pose = Pose::exp(&xi);
            let after = self.needle.step(&pose, input, dt_s)?.error_from(&reference);
            let weights = &self.configuration.weights;
            let spent = weights.running().of_pose(&pose, &Pose::identity())
                + weights.of_input(input, self.wanted);
            Ok((value - after.dot(&(next * after)) - spent) / value)
        };
        let mut least = f64::INFINITY;
        for size in [1.0, 0.5] {
            let value = level * scale * size * size;
            let (mut worst, mut toward) = (f64::INFINITY, Vector6::x());
            let mut visit = |tried: Vector6<f64>| -> Result<Vector6<f64>, StepError> {
                let found = margin(&tried, value)?;
                // A margin that is no number is the worst there is.
                if !(found >= worst) {
                    (worst, toward) = (
                        if found.is_nan() {
                            f64::NEG_INFINITY
                        } else {
                            found
                        },
                        tried,
                    );
                }
                Ok(toward)
            };
            let mut from = Vector6::x();
            for sample in 0..samples / 2 {
                from = visit(direction(sample))?;
            }
            for radius in DESCENT.0 {
                for sample in 0..DESCENT.1 {
                    from = visit((from + direction(sample) * radius).normalize())?;
                }
            }
            least = least.min(worst);
        }
        Ok(least)
    }
}

/// The `sample`-th of a sequence of directions that fills the sphere evenly enough: the Kronecker sequence of the powers of 1/g, with
/// g^7 = g + 1 (Roberts, 2018), in the cube, normalised.
fn direction(sample: usize) -> Vector6<f64> {
    const G: f64 = 1.112_775_684_278_705_5;
    let in_cube = |i: usize, _| 2.0 * (0.5 + sample as f64 * G.powi(-1 - i as i32)).fract() - 1.0;
    let point = Vector6::from_fn(in_cube);
    // The first is the centre of the cube, which is no direction.
    point.try_normalize(1e-9).unwrap_or_else(Vector6::x)
}

impl Chosen {
    /// What the nonlinear controller puts at the end of a horizon that ends at `step`; `None` for its own weights.
    pub(crate) fn form(&self, step: usize) -> Option<Form> {
        (self.choice != TerminalChoice::None).then(|| self.ingredients.at(step).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_directions_lie_in_no_hyperplane() {
        let directions: Vec<_> = (1..=48).map(direction).collect();
        let gram = directions
            .iter()
            .map(|d| d * d.transpose())
            .sum::<Matrix6<f64>>()
            / 48.0;
        // Evenly spread they would give a sixth of the identity.
        let least = gram.symmetric_eigenvalues().min();
        assert!(least > 0.05, "{least}");
    }
}
