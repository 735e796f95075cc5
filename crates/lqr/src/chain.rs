//! Backward Riccati chains: finite horizon, and the periodic solution.
//!
//! P_T is given; P_i = Q_i + K_i'R_iK_i + (A_i + B_iK_i)'P_{i+1}(A_i + B_iK_i), K_i the minimiser for P_{i+1}: the Joseph form,
//! symmetric by construction. V(i, x) = x'P_i x then falls by exactly the stage cost along the law, which no sequence
//! of Riccati solutions frozen at each i provides. The periodic solution is the fixed point of the chain over one period: its stages are composed into one map
//! that is doubled, and Newton steps on the period polish it (the derivative of the period map is X -> M'XM, M the monodromy matrix).

use crate::dense::{add_scaled, identity, mul, norm, symmetrise};
use crate::doubling::StageMap;
use crate::hautus::{self, UncontrollableMode, UnobservableMode};
use crate::input::{self, InputError};
use crate::riccati::{Problem, indefinite};
use crate::spectrum::{self, SpectrumError, lyapunov_sum};
use faer::{Mat, MatRef};

/// One stage: x_{i+1} = A x_i + B u_i at the cost x'Qx + u'Ru. Shapes n x n, n x m, n x n, m x m; m may change from stage to stage.
#[derive(Debug, Clone, Copy)]
pub struct Stage<'a> {
    /// State transition, n x n.
    pub a: MatRef<'a, f64>,
    /// Input matrix, n x m.
    pub b: MatRef<'a, f64>,
    /// State weight, n x n, positive semidefinite.
    pub q: MatRef<'a, f64>,
    /// Input weight, m x m, positive semidefinite.
    pub r: MatRef<'a, f64>,
}

/// Why a chain has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChainError {
    /// A stage or the terminal weight is malformed; `stage` is the horizon for the terminal weight.
    #[error("stage {stage}: {source}")]
    Input {
        /// Index of the stage.
        stage: usize,
        /// What is wrong with it.
        source: InputError,
    },
    /// A weight is indefinite beyond rounding.
    #[error("stage {stage}: {name} is not positive semidefinite: least eigenvalue {eigenvalue:e}")]
    IndefiniteWeight {
        /// Index of the stage.
        stage: usize,
        /// Q, R or P.
        name: &'static str,
        /// Its least eigenvalue.
        eigenvalue: f64,
    },
    /// R + B'PB is singular or overflows: the stage has no unique optimal input.
    #[error("stage {stage}: R + B'PB is singular to working precision")]
    SingularInputHessian {
        /// Index of the stage.
        stage: usize,
    },
    /// A multiplier of the monodromy matrix on or outside the unit circle that no input of the period reaches.
    #[error("the periodic system is not stabilisable: no input reaches {mode}")]
    NotStabilisable {
        /// The mode of the map over one period.
        mode: UncontrollableMode,
    },
    /// The product of the period is conditioned so badly that its rounding decides whether a mode is reached.
    #[error("too ill conditioned: rounding decides whether an input of the period reaches {mode}")]
    Undecided {
        /// The mode of the monodromy matrix.
        mode: UncontrollableMode,
    },
    /// A multiplier of the period on the unit circle without weight: the optimal law leaves it there.
    #[error("no stabilising periodic solution: the weights do not see {mode} on the unit circle")]
    UnobservableOnCircle {
        /// The mode of the map over one period.
        mode: UnobservableMode,
    },
    /// The product of the period overflows, or its eigenvalues could not be computed.
    #[error("the multipliers of the period could not be computed")]
    Spectrum(#[source] SpectrumError),
    /// The period map has no stabilising fixed point within reach.
    #[error(
        "no stabilising periodic solution: relative residual {relative_residual:e}, spectral radius of the monodromy matrix {spectral_radius}"
    )]
    NoConvergence {
        /// Relative residual of the fixed point.
        relative_residual: f64,
        /// Spectral radius of the closed loop over one period.
        spectral_radius: f64,
    },
}

/// P_0..P_T and K_0..K_{T-1} of a finite horizon.
#[derive(Debug, Clone)]
pub struct BackwardChain {
    /// Cost-to-go matrices, T + 1 of n x n; the last is the terminal weight.
    pub p: Vec<Mat<f64>>,
    /// Gains of u_i = K_i x_i, T of m x n.
    pub k: Vec<Mat<f64>>,
}

/// The fixed point of the chain over one period.
#[derive(Debug, Clone)]
pub struct PeriodicSolution {
    /// Cost-to-go matrix at the start of each stage, T of n x n.
    pub p: Vec<Mat<f64>>,
    /// Gains of u_i = K_i x_i, T of m x n.
    pub k: Vec<Mat<f64>>,
    /// Spectral radius of (A_{T-1} + B_{T-1}K_{T-1}) ... (A_0 + B_0K_0), below one.
    pub spectral_radius: f64,
    /// |chain over one period from P_0 - P_0| / |P_0|, Frobenius norms.
    pub relative_residual: f64,
}

pub(crate) fn validated(stages: &[Stage<'_>]) -> Result<Vec<Problem>, ChainError> {
    if stages.is_empty() {
        return Err(ChainError::Input {
            stage: 0,
            source: InputError::Empty { name: "stages" },
        });
    }
    let n = stages[0].a.nrows();
    let read = |stage: &Stage<'_>| -> Result<Problem, InputError> {
        let (a, b) = input::pair(stage.a, stage.b)?;
        let a = input::matrix("A", a.as_ref(), (n, n))?;
        let q = input::symmetric("Q", stage.q, n)?;
        let r = input::symmetric("R", stage.r, b.ncols())?;
        Ok(Problem {
            a,
            b,
            q,
            r,
            s: None,
        })
    };
    let mut problems = Vec::with_capacity(stages.len());
    for (stage, data) in stages.iter().enumerate() {
        let problem = read(data).map_err(|source| ChainError::Input { stage, source })?;
        for (name, weight) in [("Q", &problem.q), ("R", &problem.r)] {
            if let Some((eigenvalue, _)) = indefinite(weight) {
                return Err(ChainError::IndefiniteWeight {
                    stage,
                    name,
                    eigenvalue,
                });
            }
        }
        problems.push(problem);
    }
    Ok(problems)
}

fn backward(problems: &[Problem], terminal: Mat<f64>) -> Result<BackwardChain, ChainError> {
    let mut p = vec![terminal];
    let mut k = Vec::with_capacity(problems.len());
    for (stage, problem) in problems.iter().enumerate().rev() {
        let step = problem
            .backward(&p[p.len() - 1])
            .filter(|step| norm(&step.before).is_finite())
            .ok_or(ChainError::SingularInputHessian { stage })?;
        p.push(step.before);
        k.push(step.k);
    }
    p.reverse();
    k.reverse();
    Ok(BackwardChain { p, k })
}

impl BackwardChain {
    /// Runs the chain back from `terminal` (n x n, positive semidefinite).
    ///
    /// # Errors
    /// [`ChainError`], naming the stage.
    pub fn solve(stages: &[Stage<'_>], terminal: MatRef<'_, f64>) -> Result<Self, ChainError> {
        let problems = validated(stages)?;
        let stage = stages.len();
        let terminal = input::symmetric("P", terminal, problems[0].states())
            .map_err(|source| ChainError::Input { stage, source })?;
        if let Some((eigenvalue, _)) = indefinite(&terminal) {
            return Err(ChainError::IndefiniteWeight {
                stage,
                name: "P",
                eigenvalue,
            });
        }
        backward(&problems, terminal)
    }
}

const MAX_DOUBLINGS: usize = 50;
/// Plain periods from the identity where the stages cannot be composed (singular R).
const PLAIN_PERIODS: usize = 60;
const MAX_NEWTON_STEPS: usize = 30;
const ACCEPTED_RESIDUAL: f64 = 1e-8;
/// From this spectral radius on a multiplier may be one on the circle, moved inside by rounding.
const SLOW: f64 = 0.999;

struct Period {
    chain: BackwardChain,
    monodromy: Mat<f64>,
    residual: Mat<f64>,
    relative_residual: f64,
}

impl Period {
    fn from(problems: &[Problem], p: Mat<f64>) -> Result<Self, ChainError> {
        let chain = backward(problems, p.clone())?;
        let mut monodromy = identity(p.nrows());
        for (problem, k) in problems.iter().zip(&chain.k) {
            monodromy = mul(&problem.closed_loop(k), &monodromy);
        }
        let residual = add_scaled(&chain.p[0], -1.0, &p);
        let size = norm(&residual);
        let relative_residual = if size == 0.0 {
            0.0
        } else {
            size / norm(&p).max(norm(&chain.p[0]))
        };
        Ok(Self {
            chain,
            monodromy,
            residual,
            relative_residual,
        })
    }
}

impl PeriodicSolution {
    /// The stabilising periodic solution for stages that repeat for ever.
    ///
    /// # Errors
    /// [`ChainError`]; an uncontrollable multiplier of the period is named.
    pub fn solve(stages: &[Stage<'_>]) -> Result<Self, ChainError> {
        let problems = validated(stages)?;
        let mut best: Option<Period> = None;
        for start in [composed(&problems), iterated(&problems)] {
            let Some(period) = start.and_then(|p| polished(&problems, p)) else {
                continue;
            };
            let spectral_radius =
                spectrum::largest_modulus(&period.monodromy).unwrap_or(f64::INFINITY);
            if spectral_radius < 1.0 && period.relative_residual <= ACCEPTED_RESIDUAL {
                refuse_unreached(&problems)?;
                if spectral_radius > SLOW {
                    refuse_unseen(&problems)?;
                }
                let BackwardChain { mut p, k } = period.chain;
                p.pop();
                let relative_residual = period.relative_residual;
                return Ok(Self {
                    p,
                    k,
                    spectral_radius,
                    relative_residual,
                });
            }
            best = Some(period);
        }
        refuse_unreached(&problems)?;
        refuse_unseen(&problems)?;
        let (relative_residual, spectral_radius) =
            best.map_or((f64::INFINITY, f64::INFINITY), |period| {
                let radius = spectrum::largest_modulus(&period.monodromy).unwrap_or(f64::INFINITY);
                (period.relative_residual, radius)
            });
        Err(ChainError::NoConvergence {
            relative_residual,
            spectral_radius,
        })
    }
}

fn composed(problems: &[Problem]) -> Option<Mat<f64>> {
    period_map(problems)?
        .fixed_point(MAX_DOUBLINGS)
        .map(|(p, _)| p)
}

/// The stages composed into one; `None` for a singular R.
fn period_map(problems: &[Problem]) -> Option<StageMap> {
    let mut period = problems[0].stage_map()?;
    for problem in &problems[1..] {
        period = period.then(&problem.stage_map()?)?;
    }
    Some(period)
}

/// Refuses a multiplier on the unit circle without weight. Leaves out periods with a singular R, whose stages do not compose.
fn refuse_unseen(problems: &[Problem]) -> Result<(), ChainError> {
    let Some(map) = period_map(problems) else {
        return Ok(());
    };
    let modes = hautus::unseen_modes(&map.a, &map.h).map_err(ChainError::Spectrum)?;
    match modes.into_iter().next() {
        Some(mode) => Err(ChainError::UnobservableOnCircle { mode }),
        None => Ok(()),
    }
}

/// A positive definite start sees every mode, also one without weight.
fn iterated(problems: &[Problem]) -> Option<Mat<f64>> {
    let n = problems[0].states();
    let size = problems
        .iter()
        .map(|problem| norm(&problem.q))
        .fold(0.0, f64::max);
    let mut p = add_scaled(
        &Mat::zeros(n, n),
        if size > 0.0 { size } else { 1.0 },
        &identity(n),
    );
    for _ in 0..PLAIN_PERIODS {
        p = backward(problems, p).ok()?.p.swap_remove(0);
    }
    Some(p)
}

fn polished(problems: &[Problem], p: Mat<f64>) -> Option<Period> {
    let mut period = Period::from(problems, p).ok()?;
    let floor = problems[0].states() as f64 * f64::EPSILON;
    for _ in 0..MAX_NEWTON_STEPS {
        if period.relative_residual <= floor {
            break;
        }
        let Some(x) = lyapunov_sum(&period.monodromy, &period.residual) else {
            break;
        };
        let last = &period.chain.p[problems.len()];
        let mut p = add_scaled(last, 1.0, &x);
        symmetrise(&mut p);
        match Period::from(problems, p) {
            Ok(next) if next.relative_residual < 0.5 * period.relative_residual => period = next,
            Ok(next) if period.relative_residual > 1e-6 => period = next,
            _ => break,
        }
    }
    Some(period)
}

/// Hautus test on the map over one period with the inputs of all its stages.
fn refuse_unreached(problems: &[Problem]) -> Result<(), ChainError> {
    let n = problems[0].states();
    let mut map = identity(n);
    let mut columns: Vec<Mat<f64>> = Vec::new();
    for problem in problems {
        for lifted in &mut columns {
            *lifted = mul(&problem.a, lifted);
        }
        columns.push(problem.b.clone());
        map = mul(&problem.a, &map);
    }
    let size = columns.iter().map(norm).fold(norm(&map), f64::max);
    if !(size.is_finite() && norm(&map).is_finite()) {
        let norm = f64::INFINITY;
        return Err(ChainError::Spectrum(SpectrumError::NoConvergence {
            size: n,
            norm,
        }));
    }
    let width = columns.iter().map(Mat::ncols).sum();
    let mut inputs = Mat::zeros(n, width);
    let mut at = 0;
    for b in &columns {
        inputs.get_mut(.., at..at + b.ncols()).copy_from(b);
        at += b.ncols();
    }
    let found = hautus::unreached_modes(&map, &inputs).map_err(ChainError::Spectrum)?;
    if let Some(mode) = found.unreached.into_iter().next() {
        return Err(ChainError::NotStabilisable { mode });
    }
    match found.undecided.into_iter().next() {
        Some(mode) => Err(ChainError::Undecided { mode }),
        None => Ok(()),
    }
}
