//! What stands between the sensors and the controller of a run.

use crate::imaging::Reading;
use crate::scenario::{EntryKnowledge, EstimatorChoice, FilterChoice, Scenario, Sensors};
use nalgebra::SVector;
use needle_control::{
    Belief, FilterError, FilterSettings, Measurement, NeedleFilter, Observation, RollSearch,
};
use needle_model::{Input, InvalidTorsion, LaggedState, Needle, Pose, TorsionalLag};

/// Least standard deviations that a filter assumes of sensors without noise, mm and rad.
const LEAST_STD: [f64; 2] = [1e-3, 1e-4];

/// Why a scenario has no estimator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EstimatorError {
    /// The filter.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// Its model of torsion.
    #[error(transparent)]
    Torsion(#[from] InvalidTorsion),
}

/// The estimator of a run.
#[derive(Debug, Clone)]
pub(crate) enum Estimator {
    Perfect,
    Raw { latest: Option<Pose> },
    Filter(Box<NeedleFilter>),
    Search(RollSearch),
}

impl Estimator {
    /// At entry: `start` is the first pose of the path, which is where the needle is believed to be.
    pub(crate) fn new(
        scenario: &Scenario,
        needle: Needle,
        start: &Pose,
    ) -> Result<Self, EstimatorError> {
        let choice = match &scenario.estimator {
            EstimatorChoice::Perfect => return Ok(Self::Perfect),
            EstimatorChoice::Raw => return Ok(Self::Raw { latest: None }),
            EstimatorChoice::Filter(choice) => choice,
        };
        let settings = settings(choice, &scenario.sensors, scenario.dt_s)?;
        let state = LaggedState {
            pose: *start,
            needle,
            lag_rad: 0.0,
        };
        let belief = Belief::independent(state, &deviations(&choice.entry, needle));
        // The key's range keeps it below 2^8.
        let hypotheses = u8::try_from(choice.roll_hypotheses).unwrap_or(u8::MAX);
        Ok(match hypotheses {
            1 => Self::Filter(Box::new(NeedleFilter::new(settings, belief, 0.0)?)),
            _ => Self::Search(RollSearch::new(settings, belief, 0.0, hypotheses)?),
        })
    }

    /// Moves on to `now_s`, after `held` was commanded; nothing has passed at the first sample.
    pub(crate) fn advance(&mut self, held: Input, now_s: f64) {
        match self {
            Self::Perfect => {}
            Self::Raw { latest } => *latest = None,
            Self::Filter(filter) => filter.advance(held, now_s),
            Self::Search(search) => search.advance(held, now_s),
        }
    }

    /// Takes in a reading.
    pub(crate) fn observe(&mut self, reading: &Reading, sensors: &Sensors) {
        if let Self::Raw { latest } = self {
            *latest = Some(reading.pose);
        }
        let position = Observation::Position(reading.pose.position_mm);
        let tangent = Observation::Tangent(reading.tangent);
        let seen = [Some(position), sensors.tangent_measured.then_some(tangent)];
        for observation in seen.into_iter().flatten() {
            match self {
                Self::Perfect | Self::Raw { .. } => {}
                Self::Filter(filter) => {
                    filter.observe(observation, reading.taken_at_s);
                }
                Self::Search(search) => {
                    search.observe(observation, reading.taken_at_s);
                }
            }
        }
    }

    /// What the controller is told; `tip` is the truth.
    pub(crate) fn measurement(&self, tip: &Pose) -> Measurement {
        match self {
            Self::Perfect => Measurement::of(*tip),
            Self::Raw { latest } => Measurement {
                pose: *latest,
                curvature_per_mm: None,
            },
            Self::Filter(filter) => filter.measurement(),
            Self::Search(search) => search.measurement(),
        }
    }
}

fn settings(
    choice: &FilterChoice,
    sensors: &Sensors,
    dt_s: f64,
) -> Result<FilterSettings, InvalidTorsion> {
    let assumed = |given: f64, sensor: f64, least: f64| match given > 0.0 {
        true => given,
        false => sensor.max(least),
    };
    let FilterSettings {
        position_std_mm,
        tangent_std_rad,
        ..
    } = choice.settings;
    let [least_mm, least_rad] = LEAST_STD;
    Ok(FilterSettings {
        position_std_mm: assumed(position_std_mm, sensors.position_std_mm, least_mm),
        tangent_std_rad: assumed(tangent_std_rad, sensors.tangent_std_rad, least_rad),
        torsion: choice
            .torsion_time_constant_s
            .map(TorsionalLag::new)
            .transpose()?,
        dt_s,
        ..choice.settings
    })
}

fn deviations(entry: &EntryKnowledge, needle: Needle) -> SVector<f64, 8> {
    let EntryKnowledge {
        position_std_mm: p,
        heading_std_rad: h,
        roll_std_rad,
        curvature_std_fraction,
        lag_std_rad,
    } = *entry;
    // A straight needle has no fraction to be uncertain by; the covariance must stay definite.
    let curvature = (curvature_std_fraction * needle.curvature_per_mm()).max(1e-9);
    SVector::from([p, p, p, h, h, roll_std_rad, curvature, lag_std_rad])
}
