//! What imaging does not show: roll, curvature and torsional lag, estimated from positions and tangents of the tip.
//!
//! An error-state Kalman filter on SE(3) ([`NeedleFilter`]); with the roll wholly unknown at entry, several of them
//! ([`RollSearch`]). `docs/estimation.md` derives the equations.

mod belief;
mod filter;
mod observation;
mod roll_search;
mod settings;

pub use belief::{Belief, CURVATURE, ERROR_DIMENSION, LAG, ROLL};
pub use filter::NeedleFilter;
pub use observation::{Observation, Verdict};
pub use roll_search::RollSearch;
pub use settings::{FilterError, FilterSettings, ProcessNoise};
