//! Distance of a tip to the path as a polyline, and how far along the path it is.
//!
//! The nearest point is looked for around the last one, so that a path that comes close to itself cannot make it jump.

use nalgebra::Vector3;
use needle_model::ReferencePath;

/// Stretch of path around the last nearest point in which the next one is looked for, mm, either way, by a tip that is slow; a tip
/// that moves further in a sample is looked for within twice its way.
const WINDOW_MM: f64 = 10.0;

/// Follows one tip along one path.
#[derive(Debug, Clone)]
pub(crate) struct PathDistance<'a> {
    path: &'a ReferencePath,
    /// Length of the polyline up to each pose, mm.
    along_mm: Vec<f64>,
    last: Nearest,
    last_tip_mm: Option<Vector3<f64>>,
}

/// The point of the path that is nearest to a tip.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nearest {
    pub(crate) position_mm: Vector3<f64>,
    /// Pose at or before it.
    pub(crate) step: usize,
    pub(crate) progress_mm: f64,
    pub(crate) distance_mm: f64,
}

impl<'a> PathDistance<'a> {
    pub(crate) fn new(path: &'a ReferencePath) -> Self {
        let mut along_mm = Vec::with_capacity(path.poses().len());
        let mut length_mm = 0.0;
        for (k, pose) in path.poses().iter().enumerate() {
            let before = &path.poses()[k.saturating_sub(1)];
            length_mm += (pose.position_mm - before.position_mm).norm();
            along_mm.push(length_mm);
        }
        Self {
            path,
            along_mm,
            last: Nearest {
                position_mm: path.poses()[0].position_mm,
                step: 0,
                progress_mm: 0.0,
                distance_mm: 0.0,
            },
            last_tip_mm: None,
        }
    }

    pub(crate) fn length_mm(&self) -> f64 {
        self.along_mm.last().copied().unwrap_or(0.0)
    }

    /// Distance to the path's last pose, mm.
    pub(crate) fn to_end_mm(&self, tip_mm: &Vector3<f64>) -> f64 {
        let end = self.path.poses().last();
        end.map_or(0.0, |end| (end.position_mm - tip_mm).norm())
    }

    /// The nearest point to a tip.
    pub(crate) fn nearest(&mut self, tip_mm: &Vector3<f64>) -> Nearest {
        let (poses, along) = (self.path.poses(), &self.along_mm);
        let here_mm = self.last.progress_mm;
        let moved_mm = self.last_tip_mm.map_or(0.0, |last| (tip_mm - last).norm());
        // `max` leaves a distance out that is not a number.
        let window_mm = WINDOW_MM.max(2.0 * moved_mm);
        let first = along.partition_point(|&s| s < here_mm - window_mm);
        let mut best = Nearest {
            distance_mm: f64::INFINITY,
            ..self.last
        };
        for k in first.saturating_sub(1)..poses.len() {
            if along[k] > here_mm + window_mm {
                break;
            }
            let from = poses[k].position_mm;
            let side = poses
                .get(k + 1)
                .map_or(Vector3::zeros(), |p| p.position_mm - from);
            let squared = side.norm_squared();
            let share = match squared > 0.0 {
                true => ((tip_mm - from).dot(&side) / squared).clamp(0.0, 1.0),
                false => 0.0,
            };
            let position_mm = from + side * share;
            let distance_mm = (position_mm - tip_mm).norm();
            if distance_mm < best.distance_mm {
                best = Nearest {
                    position_mm,
                    step: k,
                    progress_mm: along[k] + share * squared.sqrt(),
                    distance_mm,
                };
            }
        }
        // A tip that is not a number is nowhere: the last point stays.
        if best.distance_mm.is_finite() {
            self.last = best;
            self.last_tip_mm = Some(*tip_mm);
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use needle_model::{Input, Needle, Pose};

    #[test]
    fn a_tip_at_200_mm_per_s_is_not_lost() {
        let needle = Needle::new(0.0).unwrap();
        let input = Input {
            v_mm_s: 200.0,
            omega_rad_s: 0.0,
        };
        let path =
            ReferencePath::from_inputs(needle, Pose::identity(), vec![input; 10], 0.1).unwrap();
        let mut distance = PathDistance::new(&path);
        for pose in path.poses() {
            let nearest = distance.nearest(&pose.position_mm);
            // Rounding of sums of 20 mm.
            assert!(nearest.distance_mm < 1e-9, "{nearest:?}");
        }
    }
}
