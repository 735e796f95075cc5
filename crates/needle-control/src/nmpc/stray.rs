//! What changes in the program while the tip is off the path by more than a horizon can win back.
//!
//! Along a horizon of length l a needle bends aside by its sagitta s = kappa l^2 / 2. Nearer to the path than that, the horizon sees
//! the way back to its end. Farther off it does not, and the program as configured is short-sighted twice:
//!
//! - The heading at the horizon's end counts only by how far it is from the path's, although it is what brings the needle back. So the
//!   end also costs what *coasting* would: offset e and heading error h stay as they are along the path, e + h j d after j stages of
//!   length d. That is a quadratic form in e and h. The needle coasts for what is left of the way back, or to the path's end. The way
//!   back is the S-curve of full bend to one side and to the other: of length sqrt(4 kappa e / (kappa^2 - kappa_path^2)).
//! - A spin gives up bend, and within a horizon that hardly shows. So a revolution a horizon costs as much as an offset by the sagitta,
//!   beside the spin's own weight.
//!
//! Both come in by the share r^4 / (1 + r^4), r = e / s: 1e-4 at a tenth of the sagitta, where the program is almost the configured
//! one. The offset is the measured one, so that the program of a sample is fixed before it is solved; its noise comes in with it.

use super::cost::{NmpcWeights, PoseWeights};
use crate::follower::Follower;
use needle_model::Pose;
use std::f64::consts::TAU;

/// Least part of the bend squared that a path leaves: with less the way back is longer than any path.
const LEAST_SPARE: f64 = 0.01;

/// How far the tip is off, against what a horizon wins back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stray {
    /// 0 on the path, 1 far off.
    share: f64,
    sagitta_mm: f64,
    horizon_s: f64,
    /// Stages of coasting, and the length of one.
    stages: f64,
    stage_mm: f64,
}

impl Stray {
    /// Of a needle at `pose`.
    pub(crate) fn at(pose: &Pose, follower: &Follower, dt_s: f64) -> Self {
        let tracker = &follower.tracker;
        let reference = &tracker.poses[0];
        let (offset, tangent) = (
            pose.position_mm - reference.position_mm,
            reference.tangent(),
        );
        let across_mm = (offset - tangent * tangent.dot(&offset)).norm();
        let length_mm: f64 = tracker.inputs.iter().map(|u| u.v_mm_s.abs() * dt_s).sum();
        let sagitta_mm = 0.5 * follower.needle.curvature_per_mm() * length_mm * length_mm;
        // A needle that does not bend, or a path that stands, has no way back that could be seen.
        let ratio = match sagitta_mm > 0.0 {
            true => across_mm / sagitta_mm,
            false => 0.0,
        };
        let bend = match ratio > 0.0 {
            true => tracker.bending_per_mm(0).norm() / follower.needle.curvature_per_mm(),
            false => 0.0,
        };
        let spare = (1.0 - bend * bend).max(LEAST_SPARE);
        let horizon = tracker.inputs.len() as f64;
        // The S-curve less the horizon itself, which is sqrt(2 s / kappa) long.
        let stages = ((2.0 * ratio / spare).sqrt() - 1.0).max(0.0) * horizon;
        Self {
            share: 1.0 / (1.0 + ratio.powi(-4)),
            sagitta_mm,
            horizon_s: horizon * dt_s,
            // Of less than one whole stage the form would be indefinite.
            stages: stages.min(tracker.stages_beyond()).ceil(),
            stage_mm: tracker.input_beyond().v_mm_s * dt_s,
        }
    }

    /// Weight of the spin beside its own, s^2/rad^2.
    pub(crate) fn spin(&self, weights: &NmpcWeights) -> f64 {
        let lever_mm_s = self.sagitta_mm * self.horizon_s / TAU;
        self.share * weights.position * lever_mm_s * lever_mm_s
    }

    /// The end weights and those of coasting.
    pub(crate) fn end(&self, weights: &NmpcWeights) -> PoseWeights {
        let (n, d, end) = (self.stages, self.stage_mm, weights.end());
        // Sums of j and j^2 from 1 to n.
        let sum = 0.5 * n * (n + 1.0);
        let squares = n * (n + 1.0) * (2.0 * n + 1.0) / 6.0;
        let position = self.share * weights.position;
        PoseWeights {
            position: end.position + position * n,
            cross: position * d * sum,
            tangent: end.tangent + position * d * d * squares + self.share * weights.tangent * n,
            roll: end.roll,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nmpc::NmpcConfiguration;
    use nalgebra::{Vector3, Vector6};
    use needle_model::{Input, Needle, ReferencePath};

    fn stray(share: f64) -> Stray {
        Stray {
            share,
            sagitta_mm: 0.3,
            horizon_s: 2.0,
            stages: 7.0,
            stage_mm: 0.5,
        }
    }

    #[test]
    fn the_end_costs_what_coasting_along_the_path_does() {
        let weights = NmpcWeights::default();
        let reference = Pose::exp(&Vector6::new(1.0, -2.0, 3.0, 0.4, -0.2, 0.9));
        let pose = reference.perturbed(&Vector6::new(0.9, -0.6, 0.2, 0.1, -0.15, 0.8));
        let offset = pose.position_mm - reference.position_mm;
        let heading = pose.tangent() - reference.tangent();
        let coasting = |j: i32| {
            let there: Vector3<f64> = offset + heading * (0.5 * f64::from(j));
            weights.position * there.norm_squared() + weights.tangent * heading.norm_squared()
        };
        let sum: f64 = (1..=7).map(coasting).sum();
        let (with, without) = (
            stray(0.25).end(&weights).of_pose(&pose, &reference),
            weights.end().of_pose(&pose, &reference),
        );
        // Rounding.
        assert!((with - without - 0.25 * sum).abs() < 1e-12 * with);
    }

    /// A needle `off_mm` beside the start of a straight path.
    fn beside(off_mm: f64) -> Stray {
        let needle = Needle::new(1.0 / 150.0).unwrap();
        let inputs = vec![
            Input {
                v_mm_s: 5.0,
                omega_rad_s: 0.0
            };
            100
        ];
        let straight = Needle::new(0.0).unwrap();
        let path = ReferencePath::from_inputs(straight, Pose::identity(), inputs, 0.1).unwrap();
        let pursuit = NmpcConfiguration::default().pursuit();
        let mut follower = Follower::new(needle, path, pursuit);
        follower.tracker.place(0.0);
        let pose = Pose::exp(&Vector6::new(off_mm, 0.0, 0.0, 0.0, 0.0, 0.0));
        Stray::at(&pose, &follower, 0.1)
    }

    #[test]
    fn on_the_path_the_program_is_the_configured_one() {
        let weights = NmpcWeights::default();
        assert_eq!(beside(0.0).end(&weights), weights.end());
        assert_eq!(beside(0.0).spin(&weights), 0.0);
    }

    #[test]
    fn farther_off_the_heading_counts_more_and_the_form_stays_convex() {
        // Only what coasting costs.
        let weights = NmpcWeights {
            end_position: 0.0,
            end_tangent: 0.0,
            tangent: 0.0,
            ..NmpcWeights::default()
        };
        let mut before = 0.0;
        for k in 1..200 {
            let stray = beside(0.01 * f64::from(k));
            let PoseWeights {
                position,
                cross,
                tangent,
                ..
            } = stray.end(&weights);
            assert!(tangent >= before && stray.spin(&weights) > 0.0, "{k}");
            // Rounding; one stage of coasting is the square of one offset.
            assert!(
                position * tangent - cross * cross >= -1e-12 * cross * cross,
                "{k}"
            );
            before = tangent;
        }
        assert!(before > 0.0);
    }
}
