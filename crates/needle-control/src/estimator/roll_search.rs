//! Roll unknown at entry: one filter a hypothesis of the roll, and the likelihood of the observations decides.
//!
//! A Kalman filter linearises, which half a turn of roll does not allow. Within the width of one hypothesis it does, and the
//! direction in which the needle bends tells the hypotheses apart after some millimetres.

use crate::controller::Measurement;
use crate::estimator::belief::{Belief, ROLL};
use crate::estimator::filter::NeedleFilter;
use crate::estimator::observation::{Observation, Verdict};
use crate::estimator::settings::{FilterError, FilterSettings};
use nalgebra::Vector6;
use needle_model::Input;
use std::f64::consts::TAU;

/// Filters that differ in roll.
#[derive(Debug, Clone)]
pub struct RollSearch {
    filters: Vec<NeedleFilter>,
    best: usize,
}

impl RollSearch {
    /// `hypotheses` filters, their rolls spread evenly from that of `belief` on, each as uncertain as half of the spacing.
    ///
    /// # Errors
    /// [`FilterError`], also for no hypothesis at all.
    pub fn new(
        settings: FilterSettings,
        belief: Belief,
        start_s: f64,
        hypotheses: u8,
    ) -> Result<Self, FilterError> {
        let found = f64::from(hypotheses);
        if hypotheses == 0 {
            let field = "hypotheses";
            return Err(FilterError::NotPositive { field, found });
        }
        let spacing = TAU / found;
        let mut filters = Vec::with_capacity(usize::from(hypotheses));
        for k in 0..hypotheses {
            let mut turned = belief;
            let roll = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, f64::from(k) * spacing);
            turned.state.pose = belief.state.pose.perturbed(&roll);
            turned.covariance.fill_row(ROLL, 0.0);
            turned.covariance.fill_column(ROLL, 0.0);
            turned.covariance[(ROLL, ROLL)] = (0.5 * spacing).powi(2);
            filters.push(NeedleFilter::new(settings, turned, start_s)?);
        }
        Ok(Self { filters, best: 0 })
    }

    /// As [`NeedleFilter::advance`].
    pub fn advance(&mut self, held: Input, time_s: f64) {
        for filter in &mut self.filters {
            filter.advance(held, time_s);
        }
    }

    /// As [`NeedleFilter::observe`]; the verdict is that of the most likely filter.
    pub fn observe(&mut self, observation: Observation, taken_at_s: f64) -> Verdict {
        let mut verdict = Verdict::Unusable;
        for (k, filter) in self.filters.iter_mut().enumerate() {
            let own = filter.observe(observation, taken_at_s);
            if k == self.best {
                verdict = own;
            }
        }
        for (k, filter) in self.filters.iter().enumerate() {
            if filter.log_likelihood() > self.filters[self.best].log_likelihood() {
                self.best = k;
            }
        }
        verdict
    }

    /// The most likely filter.
    #[must_use]
    pub fn best(&self) -> &NeedleFilter {
        &self.filters[self.best]
    }

    /// As [`NeedleFilter::measurement`], of the most likely filter.
    #[must_use]
    pub fn measurement(&self) -> Measurement {
        self.best().measurement()
    }
}
