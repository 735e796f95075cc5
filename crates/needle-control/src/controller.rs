//! The one interface of every controller: a measurement in, an input inside the limits out, on time, with its origin told.

use mpc_qp::SolveStatus;
use needle_model::{Input, Pose};
use std::time::Duration;

/// What is known of the needle at a sample, measured or estimated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measurement {
    /// Pose of the tip; `None` where the sample is missing.
    pub pose: Option<Pose>,
    /// An estimate of the needle's curvature, 1/mm, where there is one. The last one stays until the next, or until the controller
    /// is reset; before the first the controller's own model holds.
    pub curvature_per_mm: Option<f64>,
}

impl Measurement {
    /// A measured pose and nothing else.
    #[must_use]
    pub fn of(pose: Pose) -> Self {
        Self {
            pose: Some(pose),
            curvature_per_mm: None,
        }
    }
}

/// Where an input comes from. Whatever it is, the input is inside the controller's limits, rates included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// First input of the plan that this sample's program improved, to its end as far as the configuration asks for that: a real-time
    /// iteration, or convergence unless iterations or time ran out ([`SolverStatistics`]).
    Optimal,
    /// An explicit feedback law (PID, LQR, sliding mode, feed-forward), saturated to the limits.
    Law,
    /// The same, of a plan that violates soft constraints.
    Degraded {
        /// Which, and by how much.
        softened: Softened,
    },
    /// The plan of an earlier step, shifted: this step gave no usable answer. Of an explicit law, its answer to the last believed pose,
    /// carried on by the model.
    ShiftedPlan {
        /// Steps since that plan was made, or that pose was seen, from 1 on.
        age: usize,
    },
    /// The needle is brought to rest within the rate limits.
    Stop {
        /// Why.
        reason: StopReason,
    },
}

/// By how much a plan violates each soft constraint; zero for what it keeps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Softened {
    /// How far its poses are outside the corridor at most, along a cross axis of the reference, mm.
    pub corridor_mm: f64,
    /// How far its end is outside the terminal set, in `sqrt(x'Px)`, or by how much the law's first change from there is beyond its limits,
    /// whichever is more.
    pub terminal_set: f64,
}

impl Softened {
    /// Of a plan made at this sample.
    pub(crate) fn origin(self) -> Origin {
        match self == Self::default() {
            true => Origin::Optimal,
            false => Origin::Degraded { softened: self },
        }
    }
}

impl Origin {
    /// What is ahead of the poses that were predicted when the plan in use was made.
    pub(crate) fn ahead<'a>(&self, predicted: &'a [Pose]) -> &'a [Pose] {
        match *self {
            Self::Stop { .. } => &[],
            Self::ShiftedPlan { age } => predicted.get(age..).unwrap_or_default(),
            _ => predicted,
        }
    }
}

/// Why a controller brings the needle to rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The tip has come as deep as the end of the path, as far aside as it may be. Said of every later sample too, wherever the tip
    /// seems to be.
    PathEnd,
    /// The path's time is over for good and the tip has not come to its end.
    OutOfTime,
    /// Neither this step nor a plan that is young enough gives an input.
    NoPlan,
    /// No usable measurement for longer than the configuration allows.
    NoMeasurement,
}

/// Account of the solver's work in a step; all zero for an explicit law.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SolverStatistics {
    /// How the last solve ended, where there was one.
    pub status: Option<SolveStatus>,
    /// Quadratic programs solved.
    pub solves: usize,
    /// Iterations of all of them.
    pub iterations: usize,
    /// Wall time of the whole step.
    pub time: Duration,
}

/// What a controller decides at a sample. Borrowed from the controller: nothing is allocated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlStep<'a> {
    /// The input to hold until the next sample.
    pub input: Input,
    /// Where it comes from.
    pub origin: Origin,
    /// Poses of the plan applied, from the present sample on, one a sample; shorter for a shifted plan, empty for a stop and for a law
    /// without a prediction.
    pub predicted: &'a [Pose],
    /// The solver's work.
    pub statistics: SolverStatistics,
}

/// A controller of a bevel-tip needle.
pub trait Controller {
    /// Decides the input for the sample at `time_s`. Never fails: whatever the measurement, an input inside the limits
    /// comes back and [`ControlStep::origin`] says how it came about.
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_>;

    /// Tells the input that the robot has held since the last step, where it is not the one that came back: a safety layer cut it, or the
    /// needle moves already as the controller takes over. The next change counts from it. A component that is not finite tells nothing,
    /// one outside the limits counts as at the limit. A controller without limits of rate has nothing to learn from it.
    fn applied(&mut self, input: Input);

    /// Forgets plans, integrators and progress, as if newly made: of a needle at rest, unless [`Controller::applied`] tells otherwise.
    fn reset(&mut self);
}
