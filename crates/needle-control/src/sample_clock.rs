//! Time between samples, from a clock that may jitter, repeat itself or run backwards.
//!
//! Only differences of the clock are used, so that one bad reading costs one sample and no more.

/// Measures the time between the samples of one loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SampleClock {
    nominal_s: f64,
    last_s: Option<f64>,
}

impl SampleClock {
    /// A loop that is called about every `nominal_s`; `start_s` is the reading before the first sample, if known.
    pub(crate) fn new(nominal_s: f64, start_s: Option<f64>) -> Self {
        Self {
            nominal_s,
            last_s: start_s.filter(|start| start.is_finite()),
        }
    }

    /// Last reading that was a number.
    pub(crate) fn last_s(&self) -> Option<f64> {
        self.last_s
    }

    /// Time since the last sample, positive and finite: the nominal time where the clock does not tell. That a sample
    /// was asked for means that time has passed, whatever the clock says.
    pub(crate) fn tick(&mut self, time_s: f64) -> f64 {
        let elapsed_s = self.last_s.map_or(self.nominal_s, |last| time_s - last);
        if time_s.is_finite() {
            self.last_s = Some(time_s);
        }
        if elapsed_s.is_finite() && elapsed_s > 0.0 {
            elapsed_s
        } else {
            self.nominal_s
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_lies_costs_one_nominal_sample() {
        let mut clock = SampleClock::new(0.1, None);
        let readings = [7.0, 7.25, f64::NAN, 7.5, 7.0, 7.0, f64::INFINITY, 9.0];
        let elapsed: Vec<f64> = readings.iter().map(|&t| clock.tick(t)).collect();
        assert_eq!(elapsed, [0.1, 0.25, 0.1, 0.25, 0.1, 0.1, 0.1, 2.0]);
    }
}
