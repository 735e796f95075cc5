//! Bevel offset: the second parameter of the bicycle model. The point that moves along the arc lies
//! behind the tip that images show.
//!
//! Source: R. Webster, J. Kim, N. Cowan, G. Chirikjian, A. Okamura, "Nonholonomic modeling of needle
//! steering", Int. J. Robotics Research 25, 2006: tip = p + l2 R e_z. The first parameter is the
//! curvature. With an offset the tip's path has a kink when the needle turns in place.

use nalgebra::Vector3;

use crate::geometry::pose::Pose;

/// Distance from the frame that obeys the kinematics to the needle's tip, along the tangent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BevelOffset {
    /// l2, mm; zero is the unicycle model of the paper.
    pub offset_mm: f64,
}

impl BevelOffset {
    /// Pose of the tip: the same rotation, moved along the tangent.
    #[must_use]
    pub fn tip(&self, frame: &Pose) -> Pose {
        self.shifted(frame, self.offset_mm)
    }

    /// Kinematic frame of a needle whose tip is at `tip`.
    #[must_use]
    pub fn frame(&self, tip: &Pose) -> Pose {
        self.shifted(tip, -self.offset_mm)
    }

    fn shifted(self, pose: &Pose, along_mm: f64) -> Pose {
        Pose {
            rotation: pose.rotation,
            position_mm: pose.position_mm + pose.rotation * Vector3::new(0.0, 0.0, along_mm),
        }
    }
}
