//! Configuration of the nonlinear controller.

use super::cost::NmpcWeights;
use crate::configuration::{ConfigurationError, count, not_negative, positive};
use crate::corridor::Corridor;
use crate::follower::Pursuit;
use crate::limits::InputLimits;
use crate::survival::{MOST_STAGES, Survival};
use crate::terminal::TerminalChoice;
use crate::tracking::Tracking;

/// What the spin's weight pulls toward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpinTarget {
    /// No spin: the weight limits the rotation in the tissue. Right for paths whose roll means nothing.
    #[default]
    Rest,
    /// The reference's spin. Right for paths that this needle executes.
    Reference,
}

/// How far each step's nonlinear program is solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Convergence {
    /// One Gauss-Newton step from the shifted plan; without a terminal set half of it, or none, where it would raise the cost.
    RealTime,
    /// Steps with a line search on an exact penalty function, until the step is below `tolerance` (mm, rad, mm/s, rad/s alike).
    Full {
        /// Largest entry of the step.
        tolerance: f64,
        /// Steps at most.
        max_iterations: usize,
    },
}

/// Price of a millimetre beyond the corridor at one sample, over the sum of the stage's weights: above the walls' multipliers in 98 of 100 programs
/// that touch them (`docs/controllers.md`). From 30 to 1e5 the closed loops are alike.
const WALL_PRICE_PER_MM: f64 = 1e3;

/// Configuration of an [`NmpcController`](crate::NmpcController). The defaults work.
#[derive(Debug, Clone, PartialEq)]
pub struct NmpcConfiguration {
    /// Stages of the horizon.
    pub horizon: usize,
    /// Sample time and length of a stage, s.
    pub dt_s: f64,
    /// Limits of the actuators.
    pub limits: InputLimits,
    /// Half-width of the tissue corridor, mm, where there is one: along both cross axes of the reference's frame no predicted position is
    /// farther than this from the path's, so the tube is square. Soft: a plan that cannot keep it says [`Origin::Degraded`](crate::Origin::Degraded).
    pub corridor_mm: Option<f64>,
    /// Weights of the cost. With [`SpinTarget::Rest`] and no terminal ingredients the spin and the end weigh more while the tip is off
    /// the path by more than a horizon wins back.
    pub weights: NmpcWeights,
    /// What the spin's weight pulls toward.
    pub spin_target: SpinTarget,
    /// Terminal cost and set. Ingredients need a path that this needle executes and [`SpinTarget::Reference`]; `Auto` and `None` put
    /// the end weights at the end otherwise.
    pub terminal: TerminalChoice,
    /// What fixes the present point of the path.
    pub tracking: Tracking,
    /// How far each step is solved.
    pub convergence: Convergence,
    /// Levenberg-Marquardt term on the change of roll, as a multiple of the plan's mean stage cost.
    pub damping: f64,
    /// Gauss-Newton steps for each candidate of the first plan.
    pub start_iterations: usize,
    /// Deadline, plans in reserve, outliers.
    pub survival: Survival,
}

impl Default for NmpcConfiguration {
    /// 20 stages of 0.1 s, one real-time iteration.
    fn default() -> Self {
        Self {
            horizon: 20,
            dt_s: 0.1,
            limits: InputLimits::default(),
            corridor_mm: None,
            weights: NmpcWeights::default(),
            spin_target: SpinTarget::default(),
            terminal: TerminalChoice::default(),
            tracking: Tracking::default(),
            convergence: Convergence::RealTime,
            damping: 0.07,
            start_iterations: 8,
            survival: Survival::default(),
        }
    }
}

impl NmpcConfiguration {
    pub(crate) fn corridor(&self) -> Option<Corridor> {
        let w = &self.weights;
        let all = w.position + w.tangent + w.roll + w.v + w.omega;
        Corridor::of(self.corridor_mm, WALL_PRICE_PER_MM * all)
    }

    pub(crate) fn pursuit(&self) -> Pursuit {
        Pursuit {
            horizon: self.horizon,
            dt_s: self.dt_s,
            limits: self.limits,
            tracking: self.tracking,
            survival: self.survival,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the first that is out of range.
    pub fn validate(&self) -> Result<(), ConfigurationError> {
        count("horizon", self.horizon, MOST_STAGES)?;
        count("start_iterations", self.start_iterations, MOST_STAGES)?;
        positive("dt_s", self.dt_s)?;
        not_negative("damping", self.damping)?;
        self.limits.validate()?;
        self.survival.validate()?;
        self.corridor_mm
            .map_or(Ok(()), |mm| positive("corridor_mm", mm))?;
        if let Convergence::Full {
            tolerance,
            max_iterations,
        } = self.convergence
        {
            positive("convergence.tolerance", tolerance)?;
            count("convergence.max_iterations", max_iterations, MOST_STAGES)?;
        }
        let weights = &self.weights;
        // Both inputs must cost something: otherwise the plan is not unique.
        positive("weights.v", weights.v)?;
        positive("weights.omega", weights.omega)?;
        for (field, found) in [
            ("weights.position", weights.position),
            ("weights.tangent", weights.tangent),
            ("weights.roll", weights.roll),
            ("weights.end_position", weights.end_position),
            ("weights.end_tangent", weights.end_tangent),
            ("weights.end_roll", weights.end_roll),
        ] {
            not_negative(field, found)?;
        }
        Ok(())
    }
}
