//! The periodic Riccati solution: the fixed point of the backward chain over one period.
//!
//! The stages are composed into one map that is doubled; where a singular R forbids that, plain periods start from a positive definite P. Newton
//! steps on the period polish (the derivative of the period map is X -> M'XM, M the monodromy matrix). The checks are those of the stationary
//! equation, on the period as one stage with all its inputs at once; its weights (`one_stage`) are formed only where a singular R asks for them.

use crate::arithmetic::definiteness::indefinite_cost;
use crate::arithmetic::dense::{add_scaled, congruence, identity, mul, norm, symmetrise, tr_mul};
use crate::chain::backward::{BackwardChain, Stage, backward, validated};
use crate::chain::error::ChainError;
use crate::modes::hautus;
use crate::modes::mode::UncontrollableMode;
use crate::modes::spectrum::{self, SpectrumError, lyapunov_sum};
use crate::riccati::conditioning::{Conditioning, SLOW, condition};
use crate::riccati::doubling::StageMap;
use crate::riccati::problem::Problem;
use crate::riccati::zeros::free_zero_on_circle;
use faer::Mat;

const MAX_DOUBLINGS: usize = 50;
/// Plain periods from the identity where the stages cannot be composed (singular R).
const PLAIN_PERIODS: usize = 60;
const MAX_NEWTON_STEPS: usize = 30;
const ACCEPTED_RESIDUAL: f64 = 1e-8;

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
    /// Largest condition number of a P_i, in the one-norm; infinite for a singular one.
    pub condition: f64,
    /// Present where something is nearly lost; the weakest mode and the spectral radius are those of the whole period.
    pub warning: Option<Conditioning>,
}

impl PeriodicSolution {
    /// The stabilising periodic solution for stages that repeat for ever.
    ///
    /// # Errors
    /// [`ChainError`]; an uncontrollable multiplier of the period is named.
    pub fn solve(stages: &[Stage<'_>]) -> Result<Self, ChainError> {
        let problems = validated(stages)?;
        let mut best: Option<Period> = None;
        for start in [composed as Start, iterated] {
            let Some(period) = start(&problems).and_then(|p| polished(&problems, p)) else {
                continue;
            };
            if period.is_stabilising() {
                let weakest_mode = refuse_unreached(&problems)?;
                if period.spectral_radius > SLOW {
                    refuse_unseen(&problems, Some(&period.monodromy))?;
                }
                return Ok(period.solution(weakest_mode));
            }
            best = Some(period);
        }
        refuse_unreached(&problems)?;
        refuse_unseen(&problems, best.as_ref().map(|p| &p.monodromy))?;
        let (relative_residual, spectral_radius) = best
            .map_or((f64::INFINITY, f64::INFINITY), |period| {
                (period.relative_residual, period.spectral_radius)
            });
        Err(ChainError::NoConvergence {
            relative_residual,
            spectral_radius,
        })
    }
}

/// A way to a P from which Newton steps may lead to the fixed point.
type Start = fn(&[Problem]) -> Option<Mat<f64>>;

/// A chain over one period and what it says of its last P as a fixed point.
struct Period {
    chain: BackwardChain,
    monodromy: Mat<f64>,
    spectral_radius: f64,
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
            spectral_radius: spectrum::largest_modulus(&monodromy).unwrap_or(f64::INFINITY),
            chain,
            monodromy,
            residual,
            relative_residual,
        })
    }

    fn is_stabilising(&self) -> bool {
        self.spectral_radius < 1.0
            && self.relative_residual <= ACCEPTED_RESIDUAL
            && self.chain.p.iter().all(|p| indefinite_cost(p).is_none())
    }

    fn solution(self, weakest_mode: Option<UncontrollableMode>) -> PeriodicSolution {
        let BackwardChain { mut p, k } = self.chain;
        p.pop();
        let (spectral_radius, relative_residual) = (self.spectral_radius, self.relative_residual);
        let condition = p.iter().map(condition).fold(0.0, f64::max);
        PeriodicSolution {
            warning: Conditioning::of(spectral_radius, weakest_mode, condition, relative_residual),
            p,
            k,
            spectral_radius,
            relative_residual,
            condition,
        }
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

/// F and G of x_i = F x_0 + G (u_0, .., u_{T-1}), i = 0..=T.
struct Reach {
    f: Mat<f64>,
    g: Mat<f64>,
    /// Inputs up to here.
    inputs: usize,
}

impl Reach {
    fn start(problems: &[Problem]) -> Self {
        let n = problems[0].states();
        let width = problems.iter().map(|problem| problem.b.ncols()).sum();
        Self {
            f: identity(n),
            g: Mat::zeros(n, width),
            inputs: 0,
        }
    }

    fn advance(&mut self, problem: &Problem) {
        let m = problem.b.ncols();
        self.f = mul(&problem.a, &self.f);
        self.g = mul(&problem.a, &self.g);
        let mut own = self.g.as_mut().subcols_mut(self.inputs, m);
        own += &problem.b;
        self.inputs += m;
    }
}

/// The period as one stage with all its inputs at once. Its weights grow with the square of the period.
fn one_stage(problems: &[Problem]) -> Problem {
    let mut reach = Reach::start(problems);
    let (n, width) = (reach.f.nrows(), reach.g.ncols());
    let (mut q, mut r, mut s) = (
        Mat::zeros(n, n),
        Mat::zeros(width, width),
        Mat::zeros(n, width),
    );
    for problem in problems {
        let (f, g, at, m) = (&reach.f, &reach.g, reach.inputs, problem.b.ncols());
        // x_i'Q x_i and u_i'R u_i, then 2 x_i'S u_i.
        q = add_scaled(&q, 1.0, &congruence(f, &problem.q));
        s = add_scaled(&s, 1.0, &tr_mul(f, &mul(&problem.q, g)));
        r = add_scaled(&r, 1.0, &congruence(g, &problem.q));
        let mut own = r.as_mut().submatrix_mut(at, at, m, m);
        own += &problem.r;
        if let Some(cross) = &problem.s {
            let mut own = s.as_mut().subcols_mut(at, m);
            own += tr_mul(f, cross);
            let on_inputs = tr_mul(g, cross);
            let mut own = r.as_mut().subcols_mut(at, m);
            own += &on_inputs;
            let mut own = r.as_mut().subrows_mut(at, m);
            own += on_inputs.transpose();
        }
        reach.advance(problem);
    }
    Problem {
        a: reach.f,
        b: reach.g,
        q,
        r,
        s: Some(s),
    }
}

fn overflow(problems: &[Problem]) -> ChainError {
    ChainError::Spectrum(SpectrumError::NoConvergence {
        size: problems[0].states(),
        norm: f64::INFINITY,
    })
}

/// Hautus test on the map over one period with the inputs of all its stages; the weakest mode where all are reached.
fn refuse_unreached(problems: &[Problem]) -> Result<Option<UncontrollableMode>, ChainError> {
    let mut reach = Reach::start(problems);
    for problem in problems {
        reach.advance(problem);
    }
    if !(norm(&reach.f).is_finite() && norm(&reach.g).is_finite()) {
        return Err(overflow(problems));
    }
    let found = hautus::unreached_modes(&reach.f, &reach.g).map_err(ChainError::Spectrum)?;
    if let Some(mode) = found.unreached.into_iter().next() {
        return Err(ChainError::NotStabilisable { mode });
    }
    match found.undecided.into_iter().next() {
        Some(mode) => Err(ChainError::Undecided { mode }),
        None => Ok(found.weakest),
    }
}

/// Refuses a multiplier on the unit circle without weight; with a singular R it is sought near those of `monodromy`.
fn refuse_unseen(problems: &[Problem], monodromy: Option<&Mat<f64>>) -> Result<(), ChainError> {
    let found = match (period_map(problems), monodromy) {
        (Some(map), _) => hautus::unseen_modes(&map.a, &map.h).map(|m| m.into_iter().next()),
        (None, Some(monodromy)) => {
            let whole = one_stage(problems);
            if !(norm(&whole.q).is_finite() && norm(&whole.r).is_finite()) {
                return Err(overflow(problems));
            }
            free_zero_on_circle(&whole, monodromy)
        }
        (None, None) => Ok(None),
    };
    match found.map_err(ChainError::Spectrum)? {
        Some(mode) => Err(ChainError::UnobservableOnCircle { mode }),
        None => Ok(()),
    }
}
