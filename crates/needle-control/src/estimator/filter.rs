//! The filter in time: a memory of the last samples, so that an observation is put where it was taken, however late it comes.
//!
//! Each epoch keeps its input, its observation and the belief after it. A late observation becomes an epoch of its
//! own; the beliefs after it are computed again. The result is that of observations in order, exactly, whatever the
//! delays of the sensors.

use crate::controller::Measurement;
use crate::estimator::belief::{Belief, Correction};
use crate::estimator::observation::{
    Gates, Observation, Verdict, position_innovation, tangent_innovation,
};
use crate::estimator::settings::{FilterError, FilterSettings};
use crate::sample_clock::SampleClock;
use needle_model::{Input, Pose, TorsionalLag};
use std::collections::VecDeque;

/// Time constant that stands for a rigid shaft, s: every lag is gone within a sample.
const RIGID_S: f64 = 1e-9;
/// A gap is predicted over no more than this, s: beyond it nobody knows where a moving needle is.
const LONGEST_GAP_S: f64 = 10.0;
/// Rounding of time stamps, s.
const TIME_TOLERANCE_S: f64 = 1e-6;
/// Heading uncertainty of a filter that is lost, rad.
const LOST_ANGLE_RAD: f64 = 0.5;

/// A belief and its standing.
#[derive(Debug, Clone, Copy)]
struct Track {
    belief: Belief,
    /// Internal time of the last accepted observation, s.
    accepted_at_s: f64,
    /// Outliers in a row, of positions and of tangents.
    outliers: [u32; 2],
    log_likelihood: f64,
}

#[derive(Debug, Clone, Copy)]
struct Epoch {
    /// Internal time, s: starts at 0 and never goes back.
    at_s: f64,
    /// Input held since the epoch before.
    input: Input,
    observation: Option<Observation>,
    track: Track,
}

/// Estimates pose, curvature and torsional lag of a needle from observations that may be late, missing or wrong.
///
/// In each sample tell it the input that was applied ([`NeedleFilter::advance`]), then what the sensors say
/// ([`NeedleFilter::observe`]), and give the controller [`NeedleFilter::measurement`]. Nothing is allocated after construction.
#[derive(Debug, Clone)]
pub struct NeedleFilter {
    settings: FilterSettings,
    torsion: TorsionalLag,
    gates: Gates,
    clock: SampleClock,
    epochs: VecDeque<Epoch>,
    present: Epoch,
}

impl NeedleFilter {
    /// A filter that holds `belief` at time `start_s`.
    ///
    /// # Errors
    /// [`FilterError`] names the first thing that is wrong.
    pub fn new(
        settings: FilterSettings,
        belief: Belief,
        start_s: f64,
    ) -> Result<Self, FilterError> {
        settings.validate()?;
        belief.validate()?;
        let torsion = match settings.torsion {
            Some(torsion) => torsion,
            None => TorsionalLag::new(RIGID_S).map_err(|_| FilterError::NotPositive {
                field: "time_constant_s",
                found: RIGID_S,
            })?,
        };
        let first = Epoch {
            at_s: 0.0,
            input: Input::ZERO,
            observation: None,
            track: Track {
                belief,
                accepted_at_s: 0.0,
                outliers: [0; 2],
                log_likelihood: 0.0,
            },
        };
        let mut epochs = VecDeque::with_capacity(settings.history);
        epochs.push_back(first);
        Ok(Self {
            settings,
            torsion,
            gates: Gates::at(settings.gate_probability),
            clock: SampleClock::new(settings.dt_s, Some(start_s)),
            epochs,
            present: first,
        })
    }

    /// Moves on to `time_s`; `held` is the input applied since the last call. An input that is not a number counts as
    /// rest; where the clock does not go forward, one sample of nominal length has passed.
    pub fn advance(&mut self, held: Input, time_s: f64) {
        let elapsed_s = self.clock.tick(time_s).min(LONGEST_GAP_S);
        let usable = held.v_mm_s.is_finite() && held.omega_rad_s.is_finite();
        let epoch = Epoch {
            at_s: self.present.at_s + elapsed_s,
            input: if usable { held } else { Input::ZERO },
            observation: None,
            track: self.present.track,
        };
        self.insert(self.epochs.len(), epoch);
    }

    /// Takes in an observation made at `taken_at_s` on the same clock as [`NeedleFilter::advance`], in any order.
    pub fn observe(&mut self, observation: Observation, taken_at_s: f64) -> Verdict {
        let age_s = match self.clock.last_s() {
            Some(now) => now - taken_at_s,
            None => f64::NAN,
        };
        let Some(observation) = observation.normalised().filter(|_| age_s.is_finite()) else {
            return Verdict::Unusable;
        };
        if age_s < -TIME_TOLERANCE_S {
            return Verdict::FromTheFuture { ahead_s: -age_s };
        }
        let at_s = self.present.at_s - age_s.max(0.0);
        let after = self
            .epochs
            .partition_point(|epoch| epoch.at_s <= at_s + TIME_TOLERANCE_S);
        // A full memory forgets its first epoch for the new one.
        let forgets = self.epochs.len() >= self.settings.history;
        if after == 0 || (forgets && after == 1) {
            return Verdict::TooOld { age_s };
        }
        let before = &self.epochs[after - 1];
        let epoch = Epoch {
            at_s: if at_s - before.at_s <= TIME_TOLERANCE_S {
                before.at_s
            } else {
                at_s
            },
            input: self
                .epochs
                .get(after)
                .map_or(before.input, |next| next.input),
            observation: Some(observation),
            track: before.track,
        };
        let correction = self.insert(after, epoch);
        match correction {
            Some(Correction {
                nis,
                accepted: true,
                ..
            }) => Verdict::Accepted { nis },
            Some(Correction { nis, .. }) => Verdict::Outlier { nis },
            None => Verdict::Unusable,
        }
    }

    /// The belief at the present sample.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        &self.present.track.belief
    }

    /// What a controller needs; without a pose when the filter has been blind for longer than its limit.
    #[must_use]
    pub fn measurement(&self) -> Measurement {
        let state = &self.belief().state;
        let blind_s = self.present.at_s - self.present.track.accepted_at_s;
        Measurement {
            pose: (blind_s <= self.settings.blind_limit_s).then_some(state.pose),
            curvature_per_mm: Some(state.needle.curvature_per_mm()),
        }
    }

    /// Logarithm of the likelihood of all observations, up to a constant that is the same for every belief.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.present.track.log_likelihood
    }

    /// Puts an epoch in its place and computes everything from it on again. Returns the correction of its own observation.
    fn insert(&mut self, at: usize, epoch: Epoch) -> Option<Correction> {
        let mut at = at;
        if self.epochs.len() >= self.settings.history {
            self.epochs.pop_front();
            at = at.saturating_sub(1);
        }
        self.epochs.insert(at, epoch);
        let mut own = None;
        for k in at.max(1)..self.epochs.len() {
            let before = self.epochs[k - 1];
            let (track, correction) = self.followed(&before, &self.epochs[k]);
            self.epochs[k].track = track;
            if k == at {
                own = correction;
            }
        }
        self.present = self.epochs[self.epochs.len() - 1];
        own
    }

    /// The track of `epoch` from that of the epoch before.
    fn followed(&self, before: &Epoch, epoch: &Epoch) -> (Track, Option<Correction>) {
        let mut track = before.track;
        let mut predicted = track.belief;
        let elapsed_s = epoch.at_s - before.at_s;
        let moved = predicted.predict(&self.settings, self.torsion, epoch.input, elapsed_s);
        // A belief that overflows is not taken over: the last finite one stays.
        if moved.is_ok() && predicted.is_sound() {
            track.belief = predicted;
        }
        let Some(observation) = &epoch.observation else {
            return (track, None);
        };
        let sensor = match observation {
            Observation::Position(_) => 0,
            Observation::Tangent(_) => 1,
        };
        let lost = track.outliers[sensor] >= self.settings.outliers_until_lost;
        let correction = self.corrected(&mut track.belief, observation, lost);
        track.log_likelihood += correction.log_likelihood;
        if correction.accepted {
            track.accepted_at_s = epoch.at_s;
            track.outliers[sensor] = 0;
        } else {
            track.outliers[sensor] = track.outliers[sensor].saturating_add(1);
        }
        (track, Some(correction))
    }

    /// Applies an observation. A filter that is lost widens its belief by what the observation asks for.
    fn corrected(&self, belief: &mut Belief, observation: &Observation, lost: bool) -> Correction {
        let settings = &self.settings;
        let mut tried = *belief;
        let correction = match observation {
            Observation::Position(position_mm) => {
                let observed =
                    |pose: &Pose| position_innovation(pose, position_mm, settings.position_std_mm);
                if lost {
                    let distance_mm = observed(&tried.state.pose).residual.norm();
                    tried.widen(distance_mm, LOST_ANGLE_RAD);
                }
                tried.correct(observed, self.gates.position)
            }
            Observation::Tangent(tangent) => {
                let observed =
                    |pose: &Pose| tangent_innovation(pose, tangent, settings.tangent_std_rad);
                if lost {
                    let angle_rad = observed(&tried.state.pose).residual.norm();
                    tried.widen(0.0, angle_rad.max(LOST_ANGLE_RAD));
                }
                tried.correct(observed, self.gates.tangent)
            }
        };
        // A belief widened in vain is not kept.
        if correction.accepted {
            *belief = tried;
        }
        correction
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SVector, Vector3};
    use needle_model::{LaggedState, Needle};

    #[test]
    fn the_memory_never_grows() {
        let state = LaggedState {
            pose: Pose::identity(),
            needle: Needle::new(0.01).unwrap(),
            lag_rad: 0.0,
        };
        let belief = Belief::independent(state, &SVector::from([0.1; 8]));
        let settings = FilterSettings {
            history: 7,
            ..FilterSettings::default()
        };
        let mut filter = NeedleFilter::new(settings, belief, 0.0).unwrap();
        let capacity = filter.epochs.capacity();
        for step in 1..200 {
            let time_s = 0.1 * f64::from(step);
            filter.advance(Input::ZERO, time_s);
            for late_s in [0.0, 0.13, 0.05, 0.3, 2.0] {
                filter.observe(Observation::Position(Vector3::zeros()), time_s - late_s);
            }
            assert!(filter.epochs.len() <= settings.history);
            let in_order = filter.epochs.iter().is_sorted_by_key(|epoch| epoch.at_s);
            assert!(in_order, "{step}");
        }
        // What does not grow allocates nothing: everything else in a step is of fixed size.
        assert_eq!(filter.epochs.capacity(), capacity);
    }
}
