//! What a user would compare a predictive controller with: steering laws of the literature, tuned, on one carrier.
//!
//! [`LawController`] holds what every law needs and none is about: where along the path the tip is, what to do without a
//! measurement, when to stop, and the limits. A [`SteeringLaw`] is the law itself. `docs/baselines.md` has the tuning.

mod bevel;
mod curvature_demand;
mod duty_cycled;
mod feed_forward;
mod law;
mod lqr;
mod path_tracker;
mod pid;
mod settings;
mod sliding_mode;

pub use curvature_demand::LateralGains;
pub use duty_cycled::{DutyCycledGains, DutyCycledSteering};
pub use feed_forward::FeedForward;
pub use law::{LawController, PathSample, SteeringLaw};
pub use lqr::{LqrWeights, TimeVaryingLqr};
pub use pid::{PidGains, SteeringPid};
pub use settings::{BaselineError, BaselineSettings};
pub use sliding_mode::{SlidingMode, SlidingModeGains};
