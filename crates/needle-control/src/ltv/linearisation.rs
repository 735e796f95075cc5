//! The reference linearised over the horizon, each of its steps once: where the path's samples are the controller's own, what is one stage
//! ahead now was two ahead at the sample before.

use crate::tracking::Tracker;
use nalgebra::{Matrix6, Matrix6x2, Vector6};
use needle_model::{Input, LinearisedStep, Needle, Pose, StepError};

/// A step of the reference: needle, pose, input, and the next pose.
type Step = (Needle, Pose, Input, Pose);

/// Linearised steps of the horizon, and of what they are.
#[derive(Debug, Clone)]
pub(super) struct Linearisation {
    dt_s: f64,
    stages: Vec<(Option<Step>, LinearisedStep)>,
}

impl Linearisation {
    pub(super) fn new(horizon: usize, dt_s: f64) -> Self {
        let blank = LinearisedStep {
            a: Matrix6::identity(),
            b: Matrix6x2::zeros(),
            c: Vector6::zeros(),
        };
        Self {
            dt_s,
            stages: vec![(None, blank); horizon],
        }
    }

    /// The reference as `needle` would execute it, stage by stage.
    ///
    /// # Errors
    /// [`StepError`] for a reference that is not finite, or overflows.
    pub(super) fn of(
        &mut self,
        needle: &Needle,
        tracker: &Tracker,
    ) -> Result<impl Iterator<Item = &LinearisedStep>, StepError> {
        for k in 0..self.stages.len() {
            let (here, next) = (tracker.poses[k], tracker.poses[k + 1]);
            let step = (*needle, here, tracker.inputs[k], next);
            let known = |stage: &(Option<Step>, LinearisedStep)| stage.0 == Some(step);
            if known(&self.stages[k]) {
                continue;
            }
            self.stages[k] = match self.stages.get(k + 1) {
                Some(ahead) if known(ahead) => *ahead,
                _ => {
                    let residual = needle.step_residual(&here, step.2, &next, self.dt_s)?;
                    (Some(step), residual.solved_for_target())
                }
            };
        }
        Ok(self.stages.iter().map(|(_, linearised)| linearised))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::Tracking;
    use needle_model::ReferencePath;

    #[test]
    fn whatever_came_before_the_stages_are_those_of_the_reference_at_hand() {
        let [model, other] = [150.0, 120.0].map(|radius_mm| Needle::new(1.0 / radius_mm).unwrap());
        let inputs = (0..60).map(|k| Input {
            v_mm_s: 5.0,
            omega_rad_s: 0.1 * f64::from(k),
        });
        let path =
            ReferencePath::from_inputs(model, Pose::identity(), inputs.collect(), 0.1).unwrap();
        let mut tracker = Tracker::new(path, Tracking::Time, 0.1, 8);
        let mut linearisation = Linearisation::new(8, 0.1);
        // A sample later, another needle, a gap, a time between samples, a time set back; each with a spin that is not the path's as well.
        for (time_s, needle) in [
            (0.0, model),
            (0.1, model),
            (0.2, other),
            (0.3, other),
            (0.6, model),
            (0.63, model),
            (0.4, model),
            (0.5, model),
        ] {
            tracker.place(time_s);
            for spin_rad_s in [0.0, 0.2] {
                tracker.inputs[3].omega_rad_s += spin_rad_s;
                let stages = linearisation.of(&needle, &tracker).unwrap();
                for (k, found) in stages.enumerate() {
                    let (here, next) = (&tracker.poses[k], &tracker.poses[k + 1]);
                    let fresh = needle.step_residual(here, tracker.inputs[k], next, 0.1);
                    let fresh = fresh.unwrap().solved_for_target();
                    assert_eq!(*found, fresh, "{time_s} s, stage {k}");
                }
            }
        }
    }
}
