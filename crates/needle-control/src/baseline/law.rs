//! The carrier of the steering laws: one controller for all of them.

use crate::baseline::path_tracker::PathTracker;
use crate::baseline::settings::{BaselineError, BaselineSettings};
use crate::controller::{ControlStep, Controller, Measurement, Origin, SolverStatistics};
use needle_model::{Input, Needle, Pose, ReferencePath};

/// What a law sees at a sample.
#[derive(Debug, Clone, Copy)]
pub struct PathSample<'a> {
    /// The path to follow.
    pub path: &'a ReferencePath,
    /// Step of the path that is nearest to the tip.
    pub step: usize,
    /// Pose of the tip, measured or carried on by the model.
    pub pose: Pose,
    /// The needle: of the last curvature measured, the model's before there is one.
    pub needle: Needle,
    /// The input held until now.
    pub held: Input,
    /// Time since the last sample, s.
    pub elapsed_s: f64,
    /// Largest |spin|, rad/s.
    pub omega_max_rad_s: f64,
}

impl PathSample<'_> {
    /// Input of the reference at this step; at the last pose the input that led to it.
    #[must_use]
    pub fn reference_input(&self) -> Input {
        let inputs = self.path.inputs();
        let here = inputs.get(self.step).or(inputs.last());
        here.copied().unwrap_or(Input::ZERO)
    }
}

/// An explicit feedback law.
pub trait SteeringLaw {
    /// The input that the law asks for; limits and the end of the path are the carrier's business.
    fn wanted(&mut self, sample: &PathSample<'_>) -> Input;

    /// Checks that the law is one for `path` and a sample each `dt_s`; one without data of its own on a path is one for any.
    ///
    /// # Errors
    /// [`BaselineError::OtherPath`] or [`BaselineError::OtherSampleTime`] of a law that was made for another.
    fn fits(&self, _path: &ReferencePath, _dt_s: f64) -> Result<(), BaselineError> {
        Ok(())
    }

    /// Forgets integrators and cycles.
    fn reset(&mut self);
}

/// A controller that applies a law along a path.
#[derive(Debug, Clone)]
pub struct LawController<L> {
    tracker: PathTracker,
    law: L,
    held: Input,
}

impl<L: SteeringLaw> LawController<L> {
    /// Follows `path` with `needle` by `law`.
    ///
    /// # Errors
    /// [`BaselineError`] names the first setting that is wrong, or says that the law was made for another path.
    pub fn new(
        path: ReferencePath,
        needle: Needle,
        law: L,
        settings: BaselineSettings,
    ) -> Result<Self, BaselineError> {
        settings.validate()?;
        law.fits(&path, settings.dt_s)?;
        Ok(Self {
            tracker: PathTracker::new(path, needle, settings),
            law,
            held: Input::ZERO,
        })
    }
}

impl<L: SteeringLaw> Controller for LawController<L> {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        let elapsed_s = self.tracker.tick(time_s);
        let settings = self.tracker.settings;
        let (wanted, origin) = match self.tracker.locate(measurement, self.held, elapsed_s) {
            Err(reason) => (Input::ZERO, Origin::Stop { reason }),
            Ok(at) => {
                let mut wanted = self.law.wanted(&PathSample {
                    path: &self.tracker.path,
                    step: at.step,
                    pose: at.pose,
                    needle: at.needle,
                    held: self.held,
                    elapsed_s,
                    omega_max_rad_s: settings.limits.omega_max_rad_s,
                });
                wanted.v_mm_s = wanted
                    .v_mm_s
                    .min(self.tracker.speed_limit_mm_s(at.remaining_mm));
                let origin = match at.age {
                    0 => Origin::Law,
                    age => Origin::ShiftedPlan { age },
                };
                (wanted, origin)
            }
        };
        self.held = limited(&settings, wanted, self.held, elapsed_s);
        explicit(self.held, origin)
    }

    fn applied(&mut self, input: Input) {
        self.held = self.tracker.settings.limits.held(input, self.held);
    }

    fn reset(&mut self) {
        self.tracker.reset();
        self.law.reset();
        self.held = Input::ZERO;
    }
}

/// Within the limits. After a late sample the actuators are asked for no more than one nominal sample of rate.
pub(crate) fn limited(
    settings: &BaselineSettings,
    wanted: Input,
    held: Input,
    elapsed_s: f64,
) -> Input {
    let reach_s = elapsed_s.min(settings.dt_s);
    settings.limits.admissible(wanted, held, reach_s)
}

/// A step without prediction and without a solver.
pub(crate) fn explicit(input: Input, origin: Origin) -> ControlStep<'static> {
    ControlStep {
        input,
        origin,
        predicted: &[],
        statistics: SolverStatistics::default(),
    }
}
