//! Where the tip is and where along the path: measurements checked against the model, progress that never goes back,
//! and the speed that ends at the path's end.

use crate::baseline::settings::BaselineSettings;
use crate::controller::{Measurement, StopReason};
use crate::sample_clock::SampleClock;
use crate::survival::{estimated_needle, normalised};
use needle_model::{Input, Needle, Pose, ReferencePath};

/// A distance to the end of the path that counts as none, mm: a fiftieth of what imaging resolves.
const END_TOLERANCE_MM: f64 = 1e-3;
/// Speed below which a reference counts as turning in place, mm/s.
const AT_REST_MM_S: f64 = 1e-9;
/// Samples of the path that are searched beyond the distance that time allows.
const SPARE_SAMPLES: usize = 5;

/// What is known at a sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Located {
    pub(crate) pose: Pose,
    /// Samples for which the model has carried it on.
    pub(crate) age: usize,
    pub(crate) needle: Needle,
    pub(crate) step: usize,
    pub(crate) remaining_mm: f64,
}

/// Follows the tip along one path.
#[derive(Debug, Clone)]
pub(crate) struct PathTracker {
    pub(crate) path: ReferencePath,
    pub(crate) settings: BaselineSettings,
    model: Needle,
    /// The needle of the last estimate of curvature, else the model.
    needle: Needle,
    clock: SampleClock,
    pose: Option<Pose>,
    blind_s: f64,
    step: usize,
    turning_s: f64,
    finished: bool,
}

impl PathTracker {
    pub(crate) fn new(path: ReferencePath, needle: Needle, settings: BaselineSettings) -> Self {
        Self {
            path,
            settings,
            model: needle,
            needle,
            clock: SampleClock::new(settings.dt_s, None),
            pose: None,
            blind_s: 0.0,
            step: 0,
            turning_s: 0.0,
            finished: false,
        }
    }

    pub(crate) fn reset(&mut self) {
        self.clock = SampleClock::new(self.settings.dt_s, None);
        self.needle = self.model;
        (self.pose, self.blind_s) = (None, 0.0);
        (self.step, self.turning_s, self.finished) = (0, 0.0, false);
    }

    /// Time since the last sample, s.
    pub(crate) fn tick(&mut self, time_s: f64) -> f64 {
        self.clock.tick(time_s)
    }

    /// Takes in a measurement, `elapsed_s` after the last, during which `held` was applied.
    pub(crate) fn locate(
        &mut self,
        measurement: &Measurement,
        held: Input,
        elapsed_s: f64,
    ) -> Result<Located, StopReason> {
        self.needle = estimated_needle(&self.model, measurement).unwrap_or(self.needle);
        let needle = self.needle;
        let pose = self.believe(measurement.pose, needle, held, elapsed_s);
        // The end is the end, seen or not.
        if self.finished {
            return Err(StopReason::PathEnd);
        }
        let pose = pose.ok_or(StopReason::NoMeasurement)?;
        self.advance(&pose, elapsed_s);
        let remaining_mm = self.remaining_mm(&pose);
        let last = self.path.inputs().len();
        if self.step >= last && (remaining_mm <= END_TOLERANCE_MM || last == 0) {
            self.finished = true;
            return Err(StopReason::PathEnd);
        }
        // A gap shorter than half a sample is one, too; the cast saturates.
        let age = match self.blind_s > 0.0 {
            true => ((self.blind_s / self.settings.dt_s).round() as usize).max(1),
            false => 0,
        };
        Ok(Located {
            pose,
            age,
            needle,
            step: self.step,
            remaining_mm,
        })
    }

    /// The measured pose where it is credible, else the last one carried on by the model for as long as patience lasts.
    /// Once it is lost the next finite measurement counts, so that no outlier can lock the truth out.
    fn believe(
        &mut self,
        measured: Option<Pose>,
        needle: Needle,
        held: Input,
        elapsed_s: f64,
    ) -> Option<Pose> {
        let expected = self
            .pose
            .filter(|_| elapsed_s <= self.settings.patience_s)
            .and_then(|pose| needle.step(&pose, held, elapsed_s).ok());
        let credible = measured.and_then(normalised).filter(|pose| {
            expected.is_none_or(|expected| {
                (pose.position_mm - expected.position_mm).norm() <= self.settings.jump_mm
            })
        });
        self.blind_s = if credible.is_some() {
            0.0
        } else {
            self.blind_s + elapsed_s
        };
        self.pose = credible.or(expected.filter(|_| self.blind_s <= self.settings.patience_s));
        self.pose
    }

    /// Advances to the nearest of the samples that the tip can have reached; where the reference turns in place there is
    /// no nearer sample and time advances instead.
    fn advance(&mut self, pose: &Pose, elapsed_s: f64) {
        let poses = self.path.poses();
        // The cast saturates.
        let reach = (2.0 * elapsed_s / self.path.dt_s()).ceil() as usize;
        let end = self
            .step
            .saturating_add(reach)
            .saturating_add(SPARE_SAMPLES)
            .min(poses.len() - 1);
        let mut least = f64::INFINITY;
        for k in self.step..=end {
            let squared = (poses[k].position_mm - pose.position_mm).norm_squared();
            if squared < least {
                (self.step, least) = (k, squared);
            }
        }
        self.turning_s += elapsed_s;
        while self
            .path
            .inputs()
            .get(self.step)
            .is_some_and(|u| u.v_mm_s.abs() <= AT_REST_MM_S)
            && self.turning_s >= self.path.dt_s()
        {
            self.step += 1;
            self.turning_s -= self.path.dt_s();
        }
        self.turning_s = self.turning_s.min(self.path.dt_s());
    }

    /// Arc length from the tip to the path's end, mm; negative beyond the end.
    fn remaining_mm(&self, pose: &Pose) -> f64 {
        let (here, arc) = (self.path.poses()[self.step], self.path.arc_length_mm());
        let behind_mm = (here.position_mm - pose.position_mm).dot(&here.tangent());
        arc[arc.len() - 1] - arc[self.step] + behind_mm
    }

    /// Largest speed with which the needle still comes to rest at the end of the path.
    pub(crate) fn speed_limit_mm_s(&self, remaining_mm: f64) -> f64 {
        let remaining_mm = remaining_mm.max(0.0);
        let braking = (2.0 * self.settings.limits.v_rate_max_mm_s2 * remaining_mm).sqrt();
        (remaining_mm / self.settings.dt_s).min(braking)
    }
}
