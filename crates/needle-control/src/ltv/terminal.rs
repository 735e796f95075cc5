//! Terminal cost and set of the linear controllers, in the state (error, input deviation applied last).
//!
//! Rate limits make the last input a state, so a set in the error alone says nothing of recursive feasibility. The ingredients
//! come from `lqr`: one Riccati solution for a reference of constant inputs, a periodic one, or a backward chain to the end
//! of the path; each with the largest level set inside the limits, and a certificate.

use crate::limits::InputLimits;
use faer::Mat;
use lqr::{
    BackwardChain, Certificate, ChainClaim, ChainClaimError, ChainError, Constraint,
    ConstraintError, Constraints, Dare, DareError, InputError, PeriodicSolution, RateAugmented,
    TerminalClaim, TerminalSetError,
};
use nalgebra::{DMatrix, Matrix2};
use needle_model::{ControllabilityError, ControllabilityReport, Input, StepError};

/// Which terminal cost and set a controller uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TerminalChoice {
    /// The strongest that the reference admits: one Riccati solution, else a chain, else none.
    #[default]
    Auto,
    /// One Riccati solution; the reference's inputs must be constant and the error stabilisable.
    HelixDare,
    /// A chain back from the end of the path.
    RiccatiChain,
    /// The periodic Riccati solution; the reference's inputs must repeat.
    Periodic {
        /// Samples after which they repeat.
        period: usize,
    },
    /// The stage weights at the end, and no set.
    None,
}

/// Why a terminal choice cannot be had for a reference.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TerminalError {
    /// The reference's inputs differ where they should not.
    #[error("the reference's input at step {step} differs from the one {period} steps before")]
    NotPeriodic {
        /// First step that differs.
        step: usize,
        /// Steps after which inputs should repeat.
        period: usize,
    },
    /// The Riccati equation has no stabilising solution.
    #[error("no stabilising terminal cost for this reference: its error has {} of 6 controllable directions", report.dimension)]
    Dare {
        /// Which errors no input corrects.
        report: Box<ControllabilityReport>,
        /// The mode to blame.
        source: DareError,
    },
    /// The straight needle's Riccati equation has no stabilising solution.
    #[error(transparent)]
    Straight(#[from] DareError),
    /// The chain or periodic equation has no solution.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// The sets of a chain could not be sized.
    #[error(transparent)]
    Levels(#[from] ChainClaimError),
    /// The reference breaks a limit.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// The set could not be sized.
    #[error(transparent)]
    Set(#[from] TerminalSetError),
    /// Malformed matrices.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The path is too long for a chain.
    #[error("a Riccati chain over {steps} steps is beyond the limit of {most}")]
    TooLong {
        /// Steps of the path.
        steps: usize,
        /// The limit.
        most: usize,
    },
    /// The path's time step is not the controller's.
    #[error(
        "terminal ingredients need the path's time step {path_dt_s} s to be the controller's, {dt_s} s"
    )]
    TimeStep {
        /// Of the path.
        path_dt_s: f64,
        /// Of the controller.
        dt_s: f64,
    },
    /// The needle bends where a straight one is expected.
    #[error("a straight needle is expected, found a curvature of {curvature_per_mm} per mm")]
    Bent {
        /// Curvature found, 1/mm.
        curvature_per_mm: f64,
    },
    /// The report of controllability could not be made.
    #[error(transparent)]
    Controllability(#[from] ControllabilityError),
    /// A step of the path cannot be linearised.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The path has no step.
    #[error("the path has no step to make a terminal cost from")]
    NoStep,
}

/// Longest path for which a chain is made: its memory and time grow with the path.
const LONGEST_CHAIN: usize = 5_000;

/// Terminal weight and level at a step of the path.
#[derive(Debug, Clone)]
pub(crate) struct Ingredients {
    p: Vec<DMatrix<f64>>,
    /// Levels; `None` for a cost without a set.
    levels: Option<Vec<f64>>,
    periodic: bool,
    /// Last step of the path for which the levels hold.
    last_step: usize,
    pub(crate) certificate: Option<Certificate>,
}

/// The pair and weights of one step, before augmentation.
#[derive(Debug, Clone)]
pub(crate) struct Pair {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
    pub(crate) q: DMatrix<f64>,
    pub(crate) r: Matrix2<f64>,
    pub(crate) r_rate: Matrix2<f64>,
}

fn dense(m: &DMatrix<f64>) -> Mat<f64> {
    Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)])
}

fn dynamic(m: &Mat<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)])
}

impl Pair {
    fn augmented(&self) -> Result<RateAugmented, InputError> {
        let small = |m: &Matrix2<f64>| Mat::from_fn(2, 2, |i, j| m[(i, j)]);
        RateAugmented::new(
            dense(&self.a).as_ref(),
            dense(&self.b).as_ref(),
            dense(&self.q).as_ref(),
            small(&self.r).as_ref(),
            small(&self.r_rate).as_ref(),
        )
    }
}

/// Limits on deviations from every one of the reference's inputs at once.
pub(crate) fn deviation_limits(
    states: usize,
    limits: &InputLimits,
    inputs: &[Input],
    dt_s: f64,
) -> Result<Constraints, ConstraintError> {
    let extreme = |of: &dyn Fn(&Input) -> f64, pick: fn(f64, f64) -> f64| {
        inputs.iter().map(of).reduce(pick).unwrap_or(0.0)
    };
    let v: &dyn Fn(&Input) -> f64 = &|u| u.v_mm_s;
    let omega: &dyn Fn(&Input) -> f64 = &|u| u.omega_rad_s;
    let change = |of: &dyn Fn(&Input) -> f64| {
        let steps = inputs
            .windows(2)
            .map(|pair| (of(&pair[1]) - of(&pair[0])).abs());
        steps.fold(0.0, f64::max)
    };
    let lower = [
        limits.v_min_mm_s - extreme(v, f64::min),
        -limits.omega_max_rad_s - extreme(omega, f64::min),
    ];
    let upper = [
        limits.v_max_mm_s - extreme(v, f64::max),
        limits.omega_max_rad_s - extreme(omega, f64::max),
    ];
    let rate = [
        limits.v_rate_max_mm_s2 * dt_s - change(v),
        limits.omega_rate_max_rad_s2 * dt_s - change(omega),
    ];
    Constraints::new(states, 2)
        .with_input_box(&lower, &upper)?
        .with_rate_box(&rate.map(|r| -r), &rate)
}

impl Ingredients {
    /// The stage weights at the end, no set.
    pub(crate) fn none(weight: DMatrix<f64>) -> Self {
        Self {
            p: vec![weight],
            levels: None,
            periodic: false,
            last_step: 0,
            certificate: None,
        }
    }

    /// One Riccati solution with its largest admissible level set.
    pub(crate) fn stationary(pair: &Pair, limits: Constraints) -> Result<Self, TerminalError> {
        let augmented = pair.augmented()?;
        let dare = Dare::new(
            augmented.a.as_ref(),
            augmented.b.as_ref(),
            augmented.q.as_ref(),
            augmented.r.as_ref(),
        )
        .with_cross(augmented.s.as_ref());
        let solution = dare.solve()?;
        let claim = TerminalClaim::largest(&dare, &solution, RateAugmented::constraints(&limits))?;
        // A set without interior would make the controller's problem infeasible.
        let level = (claim.level > 0.0).then(|| vec![claim.level]);
        Ok(Self {
            p: vec![dynamic(&claim.cost)],
            levels: level,
            periodic: false,
            last_step: usize::MAX,
            certificate: Some(claim.certify()),
        })
    }

    /// The chain back from the end of the path, where the state costs `end`.
    pub(crate) fn chain(
        pairs: &[Pair],
        limits: Constraints,
        end: &DMatrix<f64>,
    ) -> Result<Self, TerminalError> {
        if pairs.len() > LONGEST_CHAIN {
            return Err(TerminalError::TooLong {
                steps: pairs.len(),
                most: LONGEST_CHAIN,
            });
        }
        let uncrossed = Uncrossed::of_all(pairs)?;
        let stages: Vec<_> = uncrossed.iter().map(Uncrossed::stage).collect();
        let chain = BackwardChain::solve(&stages, dense(end).as_ref())?;
        let limits = first(&uncrossed)?.constraints(&limits)?;
        let claim = ChainClaim::largest(&stages, &chain, limits, f64::INFINITY)?;
        Ok(Self::of_claim(claim, false))
    }

    /// The periodic solution, with one level for the whole period.
    pub(crate) fn periodic(pairs: &[Pair], limits: Constraints) -> Result<Self, TerminalError> {
        let uncrossed = Uncrossed::of_all(pairs)?;
        let stages: Vec<_> = uncrossed.iter().map(Uncrossed::stage).collect();
        let PeriodicSolution { mut p, k, .. } = PeriodicSolution::solve(&stages)?;
        p.push(first(&p)?.clone());
        let limits = first(&uncrossed)?.constraints(&limits)?;
        let mut claim =
            ChainClaim::largest(&stages, &BackwardChain { p, k }, limits, f64::INFINITY)?;
        let least = claim.levels.iter().copied().fold(f64::INFINITY, f64::min);
        claim.levels.fill(least);
        Ok(Self::of_claim(claim, true))
    }

    fn of_claim(mut claim: ChainClaim, periodic: bool) -> Self {
        // Nothing limits the last set of a chain but its own stage; an infinite level is no level.
        let largest = claim
            .levels
            .iter()
            .copied()
            .filter(|c| c.is_finite())
            .fold(0.0, f64::max);
        for level in &mut claim.levels {
            *level = level.min(largest);
        }
        let usable = claim.levels.iter().all(|level| *level > 0.0);
        Self {
            certificate: Some(claim.certify()),
            p: claim.p.iter().map(dynamic).collect(),
            levels: usable.then_some(claim.levels),
            periodic,
            last_step: usize::MAX,
        }
    }

    /// The same, with levels up to a step only: past the end of the path the reference is another.
    pub(crate) fn until(self, last_step: usize) -> Self {
        Self { last_step, ..self }
    }

    /// Weight and level for a horizon that ends at `step` of the path.
    pub(crate) fn at(&self, step: usize) -> (&DMatrix<f64>, Option<f64>) {
        let last = self.p.len() - 1;
        let index = match self.periodic {
            true => step % last.max(1),
            false => step.min(last),
        };
        let levels = self.levels.as_ref().filter(|_| step <= self.last_step);
        (&self.p[index], levels.map(|levels| levels[index]))
    }
}

fn first<T>(items: &[T]) -> Result<&T, TerminalError> {
    items.first().ok_or(TerminalError::NoStep)
}

/// A step whose cross term is absorbed by the input: du = w - F x with F = R^-1 S'.
struct Uncrossed {
    a: Mat<f64>,
    b: Mat<f64>,
    q: Mat<f64>,
    r: Mat<f64>,
    shift: DMatrix<f64>,
}

impl Uncrossed {
    fn of_all(pairs: &[Pair]) -> Result<Vec<Self>, TerminalError> {
        pairs.iter().map(Self::of).collect()
    }

    fn of(pair: &Pair) -> Result<Self, TerminalError> {
        let augmented = pair.augmented()?;
        let (a, b, q, s) = (
            dynamic(&augmented.a),
            dynamic(&augmented.b),
            dynamic(&augmented.q),
            dynamic(&augmented.s),
        );
        // R + R_d of a valid configuration is positive definite; a zero inverse would only leave the cross term in place.
        let inverse = dynamic(&augmented.r)
            .try_inverse()
            .unwrap_or_else(|| DMatrix::zeros(2, 2));
        let shift = &inverse * s.transpose();
        let q = q - &s * &shift;
        Ok(Self {
            a: dense(&(a - &b * &shift)),
            q: dense(&((&q + q.transpose()) * 0.5)),
            b: augmented.b,
            r: augmented.r,
            shift,
        })
    }

    fn stage(&self) -> lqr::Stage<'_> {
        lqr::Stage {
            a: self.a.as_ref(),
            b: self.b.as_ref(),
            q: self.q.as_ref(),
            r: self.r.as_ref(),
        }
    }

    /// The limits in the new input; the weights, and so the shift, are the same at every step.
    fn constraints(&self, limits: &Constraints) -> Result<Constraints, ConstraintError> {
        let augmented = RateAugmented::constraints(limits);
        let mut shifted = Constraints::new(self.a.nrows(), 2);
        for row in augmented.rows() {
            let on_x = (0..self.a.nrows())
                .map(|j| {
                    row.on_x[j]
                        - (0..2)
                            .map(|i| row.on_u[i] * self.shift[(i, j)])
                            .sum::<f64>()
                })
                .collect();
            shifted = shifted.with(Constraint {
                on_x,
                ..row.clone()
            })?;
        }
        Ok(shifted)
    }
}
