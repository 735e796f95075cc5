//! Time between samples, from a clock that may jitter, repeat itself or run backwards.
//!
//! Only differences of the clock are used, so that one bad reading costs one sample and no more.

/// Measures the time between the samples of one loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SampleClock {
    nominal_s: f64,
    last_s: Option<f64>,
    /// Time given out since the last reading that told one.
    ahead_s: f64,
    ticked: bool,
}

impl SampleClock {
    /// A loop that is called about every `nominal_s`; `start_s` is the reading before the first sample, if known.
    pub(crate) fn new(nominal_s: f64, start_s: Option<f64>) -> Self {
        Self {
            nominal_s,
            last_s: start_s.filter(|start| start.is_finite()),
            ahead_s: 0.0,
            ticked: false,
        }
    }

    /// Last reading that was a number.
    pub(crate) fn last_s(&self) -> Option<f64> {
        self.last_s
    }

    /// Whether no sample has come yet.
    pub(crate) fn is_fresh(&self) -> bool {
        !self.ticked
    }

    /// Time since the last sample, positive and finite: the nominal time where the clock does not tell. That a sample
    /// was asked for means that time has passed, whatever the clock says.
    pub(crate) fn tick(&mut self, time_s: f64) -> f64 {
        self.ticked = true;
        if !time_s.is_finite() || self.last_s == Some(time_s) {
            self.ahead_s += self.nominal_s;
            return self.nominal_s;
        }
        let since_s = self.last_s.map_or(self.nominal_s, |last| time_s - last);
        // What was given out for readings that told no time is not given out again, if that leaves any.
        let elapsed_s = [since_s - self.ahead_s, since_s, self.nominal_s]
            .into_iter()
            .find(|elapsed| elapsed.is_finite() && *elapsed > 0.0);
        (self.last_s, self.ahead_s) = (Some(time_s), 0.0);
        elapsed_s.unwrap_or(self.nominal_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_lies_costs_one_nominal_sample() {
        let mut clock = SampleClock::new(0.25, None);
        let readings = [7.0, 7.5, f64::NAN, 8.0, 7.0, 7.0, f64::INFINITY, 9.0];
        let elapsed: Vec<f64> = readings.iter().map(|&t| clock.tick(t)).collect();
        assert_eq!(elapsed, [0.25, 0.5, 0.25, 0.25, 0.25, 0.25, 0.25, 1.5]);
    }

    #[test]
    fn a_clock_that_stood_still_gives_its_time_out_once() {
        let mut clock = SampleClock::new(0.25, None);
        let elapsed: f64 = [1.0, 1.0, 1.0, 1.75].map(|t| clock.tick(t)).iter().sum();
        // One nominal sample before the first reading, and 0.75 s from there to the last.
        assert_eq!(elapsed, 1.0);
    }

    #[test]
    fn a_reading_soon_after_one_that_was_no_number_is_believed() {
        let mut clock = SampleClock::new(0.25, None);
        let elapsed = [1.0, f64::NAN, 1.125].map(|t| clock.tick(t));
        assert_eq!(elapsed, [0.25, 0.25, 0.125]);
    }
}
