//! A reference path as CSV: one row a pose, SI-suffixed header, the input that leaves the pose in
//! its row (zero in the last). Numbers are printed so that reading gives the same bits back.

use std::fmt::Write as _;

use nalgebra::Vector3;

use crate::needle::Input;
use crate::path_file::{PathFileError, numbers, rotation};
use crate::pose::Pose;
use crate::reference_path::ReferencePath;

/// Header of the format; the quaternion is (w, x, y, z), body to world.
pub const PATH_CSV_HEADER: &str = "t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,v_mm_s,omega_rad_s";

/// How far a time may be from equal spacing, as a fraction of the step.
const TIME_TOLERANCE: f64 = 1e-3;

impl ReferencePath {
    /// The path as CSV text with [`PATH_CSV_HEADER`].
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = format!("{PATH_CSV_HEADER}\n");
        for (k, pose) in self.poses().iter().enumerate() {
            let input = self.inputs().get(k).copied().unwrap_or(Input::ZERO);
            let (p, q) = (pose.position_mm, pose.rotation);
            let t_s = k as f64 * self.dt_s();
            let Input {
                v_mm_s,
                omega_rad_s,
            } = input;
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{t_s},{},{},{},{},{},{},{},{v_mm_s},{omega_rad_s}",
                p.x, p.y, p.z, q.w, q.i, q.j, q.k
            );
        }
        text
    }

    /// Reads what [`ReferencePath::to_csv`] writes. At least two rows: the time step is their
    /// distance.
    ///
    /// # Errors
    /// [`PathFileError`] with line and reason.
    pub fn from_csv(text: &str) -> Result<Self, PathFileError> {
        let mut lines = text.lines();
        let header = lines.next().unwrap_or_default().trim();
        if header != PATH_CSV_HEADER {
            return Err(PathFileError::Header {
                expected: PATH_CSV_HEADER,
                found: header.to_owned(),
            });
        }
        let (mut poses, mut inputs, mut times) = (Vec::new(), Vec::new(), Vec::new());
        for (i, row) in lines.enumerate().filter(|(_, row)| !row.trim().is_empty()) {
            let line = i + 2;
            let [t, x, y, z, qw, qx, qy, qz, v_mm_s, omega_rad_s] =
                numbers::<10>(line, row.split(','))?;
            poses.push(Pose {
                rotation: rotation(line, [qw, qx, qy, qz])?,
                position_mm: Vector3::new(x, y, z),
            });
            inputs.push(Input {
                v_mm_s,
                omega_rad_s,
            });
            times.push((line, t));
        }
        let dt_s = equal_spacing(&times)?;
        inputs.pop();
        Ok(Self::from_samples(poses, inputs, dt_s)?)
    }
}

/// The time step of (line, time) rows.
fn equal_spacing(times: &[(usize, f64)]) -> Result<f64, PathFileError> {
    let [(_, first), (_, second), ..] = *times else {
        return Err(PathFileError::Empty);
    };
    let dt_s = second - first;
    for (k, &(line, found_s)) in times.iter().enumerate() {
        let expected_s = first + k as f64 * dt_s;
        if (found_s - expected_s).abs() > TIME_TOLERANCE * dt_s.abs() {
            return Err(PathFileError::Time {
                line,
                expected_s,
                found_s,
            });
        }
    }
    Ok(dt_s)
}
