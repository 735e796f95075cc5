//! Feed-forward only: the reference's inputs by the clock, whatever is measured. What no feedback is worth.

use crate::baseline::law::{explicit, limited};
use crate::baseline::settings::{BaselineError, BaselineSettings};
use crate::controller::{ControlStep, Controller, Measurement, Origin, StopReason};
use crate::sample_clock::SampleClock;
use needle_model::{Input, ReferencePath};

/// Replays the inputs of a path.
#[derive(Debug, Clone)]
pub struct FeedForward {
    path: ReferencePath,
    settings: BaselineSettings,
    clock: SampleClock,
    /// Time along the path at the next sample, s.
    replayed_s: f64,
    held: Input,
}

impl FeedForward {
    /// Replays the inputs of `path` from its start.
    ///
    /// # Errors
    /// [`BaselineError`] names the first setting that is wrong.
    pub fn new(path: ReferencePath, settings: BaselineSettings) -> Result<Self, BaselineError> {
        settings.validate()?;
        Ok(Self {
            path,
            settings,
            clock: SampleClock::new(settings.dt_s, None),
            replayed_s: 0.0,
            held: Input::ZERO,
        })
    }
}

impl Controller for FeedForward {
    fn step(&mut self, _measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        let first = self.clock.is_fresh();
        let elapsed_s = self.clock.tick(time_s);
        if !first {
            self.replayed_s += elapsed_s;
        }
        // A thousandth of a step: sums of sample times must not fall short of a step by rounding. The cast saturates.
        let step = (self.replayed_s / self.path.dt_s() + 1e-3) as usize;
        let (wanted, origin) = match self.path.inputs().get(step) {
            Some(&input) => (input, Origin::Law),
            None => {
                let reason = StopReason::PathEnd;
                (Input::ZERO, Origin::Stop { reason })
            }
        };
        self.held = limited(&self.settings, wanted, self.held, elapsed_s);
        explicit(self.held, origin)
    }

    fn applied(&mut self, input: Input) {
        self.held = self.settings.limits.held(input, self.held);
    }

    fn reset(&mut self) {
        self.clock = SampleClock::new(self.settings.dt_s, None);
        (self.replayed_s, self.held) = (0.0, Input::ZERO);
    }
}
