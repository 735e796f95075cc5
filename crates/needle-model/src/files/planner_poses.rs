//! Plain-text poses of the steerable-needle planner of the University of North Carolina (M. Fu,
//! O. Salzman, R. Alterovitz, RSS 2021): one pose a line, mm, separated by blanks.
//!
//! Two traps. Its start and goal files order the quaternion (w, x, y, z), its interpolated plans
//! (x, y, z, w), the files `_interp.txt` and `_org.txt` alike. And its needle bends toward its body +x, by a turn about +y, while ours bends toward
//! -y: our body frame is its frame turned by +pi/2 about the tangent. Its sampling-based planners
//! carry the frame along without the bevel's roll: read such plans as positions
//! ([`crate::PositionCurve`]), not as poses to execute.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;

use nalgebra::{UnitQuaternion, Vector3};

use crate::files::path_file::{PathFileError, checked, numbers, rotation, without_bom};
use crate::geometry::pose::Pose;

/// Order of the quaternion's components in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlannerFile {
    /// Start and goal poses: `x y z qw qx qy qz`.
    StartAndGoal,
    /// Plan, interpolated (`_interp.txt`) or as planned (`_org.txt`): `x y z qx qy qz qw`.
    InterpolatedPlan,
}

/// Our body frame in the planner's.
fn bevel_turn() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2)
}

/// Reads the planner's poses and converts them to our body frame. Blank lines are skipped.
///
/// # Errors
/// [`PathFileError`] with line and reason.
pub fn read_planner_poses(text: &str, file: PlannerFile) -> Result<Vec<Pose>, PathFileError> {
    let mut poses = Vec::new();
    for (i, row) in without_bom(text).lines().enumerate() {
        if row.trim().is_empty() {
            continue;
        }
        let line = i + 1;
        let [x, y, z, a, b, c, d] = numbers::<7>(line, row.split_whitespace())?;
        let wxyz = match file {
            PlannerFile::StartAndGoal => [a, b, c, d],
            PlannerFile::InterpolatedPlan => [d, a, b, c],
        };
        let pose = Pose {
            rotation: rotation(line, wxyz)? * bevel_turn(),
            position_mm: Vector3::new(x, y, z),
        };
        poses.push(checked(line, pose)?);
    }
    if poses.is_empty() {
        return Err(PathFileError::Empty);
    }
    Ok(poses)
}

/// Writes poses in the planner's frame and order.
#[must_use]
pub fn write_planner_poses(poses: &[Pose], file: PlannerFile) -> String {
    let mut text = String::new();
    for pose in poses {
        let p = pose.position_mm;
        let q = pose.rotation * bevel_turn().inverse();
        let [a, b, c, d] = match file {
            PlannerFile::StartAndGoal => [q.w, q.i, q.j, q.k],
            PlannerFile::InterpolatedPlan => [q.i, q.j, q.k, q.w],
        };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{} {} {} {a} {b} {c} {d}", p.x, p.y, p.z);
    }
    text
}
