//! Plans that are not improvements of the one before: the first plan, and the end of a shifted one.

use super::NmpcController;
use super::configuration::SpinTarget;
use super::plan::Plan;
use super::spin::{Sense, SpinLaw};
use crate::follower::Follower;
use crate::survival::Sample;
use crate::tracking::Tracker;
use needle_model::{Input, Needle, Pose};
use std::time::Instant;

/// A guess along the reference: its speed, and a spin by the law in a sense, or its own.
struct Guess<'a> {
    law: SpinLaw,
    needle: &'a Needle,
    tracker: &'a Tracker,
    sense: Option<Sense>,
}

impl Guess<'_> {
    /// Input of stage `k` from `pose`.
    fn input(&self, pose: &Pose, k: usize) -> Input {
        let wanted = self.tracker.inputs[k];
        let omega_rad_s = match self.sense {
            None => wanted.omega_rad_s,
            // Rotation at rest bends nothing.
            Some(_) if wanted.v_mm_s == 0.0 => 0.0,
            Some(sense) => {
                let bending_per_mm = self.tracker.bending_per_mm(k);
                self.law
                    .omega_rad_s(self.needle, pose, &bending_per_mm, sense)
            }
        };
        Input {
            omega_rad_s,
            ..wanted
        }
    }

    /// Fills a plan from stage `first` on.
    fn fill(&self, plan: &mut Plan, first: usize) {
        let dt_s = self.law.dt_s;
        plan.fill(first, self.needle, dt_s, |pose, k| self.input(pose, k));
    }
}

impl NmpcController {
    fn law(&self) -> SpinLaw {
        SpinLaw {
            omega_max_rad_s: self.configuration.limits.omega_max_rad_s,
            dt_s: self.configuration.dt_s,
        }
    }

    /// Shifts the plan by the whole steps that have passed since it was made and fills its end.
    pub(super) fn shift(&mut self, elapsed_s: f64) {
        let Some(lag_s) = self.planned else { return };
        let (dt_s, horizon) = (self.configuration.dt_s, self.configuration.horizon);
        let steps = ((lag_s + elapsed_s) / dt_s).round();
        if steps >= horizon as f64 {
            self.planned = None;
            self.shooting.forget();
            return;
        }
        self.planned = Some(lag_s + elapsed_s - steps * dt_s);
        self.shooting.shift_guess(steps as usize);
        let first = self.shooting.plan.shift(steps as usize);
        let kept = &self.shooting.plan.inputs[..first];
        let spin: f64 = kept.iter().map(|u| u.omega_rad_s).sum();
        let sense = match self.configuration.spin_target {
            SpinTarget::Reference => None,
            SpinTarget::Rest if spin < 0.0 => Some(Sense::Negative),
            SpinTarget::Rest => Some(Sense::Positive),
        };
        let Follower {
            needle, tracker, ..
        } = &self.follower;
        let law = self.law();
        let guess = Guess {
            law,
            needle,
            tracker,
            sense,
        };
        guess.fill(&mut self.shooting.plan, first);
    }

    /// The best of the reference's inputs and the guessed spins, each improved a little.
    pub(super) fn plan_afresh(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> bool {
        // A plan that ends in the terminal set is better than one that does not.
        let mut best: Option<(f64, f64)> = None;
        for sense in [Some(Sense::Positive), Some(Sense::Negative), None] {
            if self.follower.guard.late(2 * started.elapsed()) {
                break;
            }
            self.shooting.forget();
            self.shooting.plan.poses[0] = *pose;
            let law = self.law();
            let Follower {
                needle, tracker, ..
            } = &self.follower;
            let guess = Guess {
                law,
                needle,
                tracker,
                sense,
            };
            guess.fill(&mut self.shooting.plan, 0);
            self.shooting
                .bring_within_reach(&self.follower, sample.reach_s);
            if !self.converge(sample, started, 1e-6, self.configuration.start_iterations) {
                continue;
            }
            let tracker = &self.follower.tracker;
            let priced = self.shooting.priced_cost(&self.shooting.plan, tracker);
            let rank = (self.violation, priced);
            if rank.1.is_finite() && best.is_none_or(|best| rank < best) {
                best = Some(rank);
                self.candidate.overwrite(&self.shooting.plan);
            }
        }
        if best.is_some() {
            std::mem::swap(&mut self.shooting.plan, &mut self.candidate);
        }
        self.shooting.forget();
        self.violation = best.map_or(0.0, |(violation, _)| violation);
        self.planned = best.map(|_| 0.0);
        best.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::{Controller, Measurement};
    use crate::limits::InputLimits;
    use crate::nmpc::NmpcConfiguration;
    use nalgebra::Vector6;
    use needle_model::ReferencePath;

    #[test]
    fn a_first_plan_can_be_reached_from_whatever_was_applied_last() {
        let needle = Needle::new(1.0 / 150.0).unwrap();
        let bend = Vector6::new(0.0, 0.0, 0.5, 0.5 / 300.0, 0.0, 0.005);
        let curve = (0..=100).map(|k| Pose::exp(&(bend * f64::from(k))));
        let path = ReferencePath::from_poses(curve.collect(), 0.1).unwrap();
        // A tenth of the speed and a sixth of the spin in a step.
        let limits = InputLimits {
            v_rate_max_mm_s2: 5.0,
            omega_rate_max_rad_s2: 10.0,
            ..InputLimits::default()
        };
        let applied = [
            (0.0, 0.0),
            (10.0, 6.2),
            (9.0, -6.2),
            (5.0, -1.0),
            (0.0, 6.0),
        ];
        for (v_mm_s, omega_rad_s) in applied {
            for iterations in [1, 2, 8] {
                let configuration = NmpcConfiguration {
                    limits,
                    start_iterations: iterations,
                    ..NmpcConfiguration::default()
                };
                let mut controller =
                    NmpcController::new(needle, path.clone(), configuration).unwrap();
                let mut held = Input {
                    v_mm_s,
                    omega_rad_s,
                };
                controller.follower.guard.hold(held);
                let start = Pose::exp(&Vector6::new(1.0, 1.0, 0.0, 0.05, 0.05, 1.0));
                controller.step(&Measurement::of(start), 0.0);
                for planned in &controller.shooting.plan.inputs {
                    let reached = limits.admissible(*planned, held, 0.1);
                    // The solver's tolerance.
                    let beyond = (reached.v_mm_s - planned.v_mm_s).abs()
                        + (reached.omega_rad_s - planned.omega_rad_s).abs();
                    assert!(beyond < 1e-6, "{iterations}: {planned:?} after {held:?}");
                    held = *planned;
                }
            }
        }
    }
}
