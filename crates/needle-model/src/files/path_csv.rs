//! A reference path as CSV: one row a pose, SI-suffixed header, the input that leaves the pose in
//! its row (zero in the last). Numbers are printed so that reading gives the same bits back. A path of
//! one pose has its time step in a line `# dt_s=...` before its row.

use std::fmt::Write as _;

use nalgebra::Vector3;

use crate::files::path_file::{PathFileError, checked, numbers, rotation, without_bom};
use crate::geometry::pose::Pose;
use crate::plant::needle::Input;
use crate::reference::reference_path::{ReferencePath, ReferencePathError};

/// Header of the format; the quaternion is (w, x, y, z), body to world.
pub const PATH_CSV_HEADER: &str = "t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,v_mm_s,omega_rad_s";

/// How far times may be from equal spacing at the first difference, as a fraction of it: rounding.
const EXACT_TOLERANCE: f64 = 1e-9;

/// How far times may be from equal spacing at the mean difference, as a fraction of it: 30 Hz printed in
/// milliseconds is off by 1.5 %.
const ROUNDED_TOLERANCE: f64 = 0.02;

/// Begins the line that gives the time step of a path of one pose, whose row cannot.
const TIME_STEP_LINE: &str = "# dt_s=";

impl ReferencePath {
    /// The path as CSV text with [`PATH_CSV_HEADER`].
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = format!("{PATH_CSV_HEADER}\n");
        if self.inputs().is_empty() {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{TIME_STEP_LINE}{}", self.dt_s());
        }
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

    /// Reads what [`ReferencePath::to_csv`] writes, and equally spaced times that were rounded: the
    /// time step is the distance of the first two where it fits every row to rounding, else the mean.
    ///
    /// # Errors
    /// [`PathFileError`] with line and reason.
    pub fn from_csv(text: &str) -> Result<Self, PathFileError> {
        let mut lines = without_bom(text).lines();
        let header = lines.next().unwrap_or_default().trim();
        if header != PATH_CSV_HEADER {
            return Err(PathFileError::Header {
                expected: PATH_CSV_HEADER,
                found: header.to_owned(),
            });
        }
        let (mut poses, mut inputs, mut times) = (Vec::new(), Vec::new(), Vec::new());
        let mut given_dt_s = None;
        for (i, row) in lines.enumerate().filter(|(_, row)| !row.trim().is_empty()) {
            let line = i + 2;
            if let (Some(dt), true) = (row.trim().strip_prefix(TIME_STEP_LINE), poses.is_empty()) {
                let [dt_s] = numbers::<1>(line, std::iter::once(dt))?;
                given_dt_s = Some(dt_s);
                continue;
            }
            let [t, x, y, z, qw, qx, qy, qz, v_mm_s, omega_rad_s] =
                numbers::<10>(line, row.split(','))?;
            let pose = Pose {
                rotation: rotation(line, [qw, qx, qy, qz])?,
                position_mm: Vector3::new(x, y, z),
            };
            poses.push(checked(line, pose)?);
            inputs.push(Input {
                v_mm_s,
                omega_rad_s,
            });
            times.push((line, t));
        }
        let dt_s = match (times.as_slice(), given_dt_s) {
            ([], _) => return Err(PathFileError::Empty),
            ([_], Some(dt_s)) => dt_s,
            (&[(line, _)], None) => {
                return Err(PathFileError::TimeStep {
                    line,
                    expected: TIME_STEP_LINE,
                });
            }
            (times, _) => equal_spacing(times)?,
        };
        if let (Some(last), Some(&(line, _))) = (inputs.pop(), times.last())
            && last != Input::ZERO
        {
            return Err(PathFileError::LastInput {
                line,
                v_mm_s: last.v_mm_s,
                omega_rad_s: last.omega_rad_s,
            });
        }
        Self::from_samples(poses, inputs, dt_s).map_err(|error| match error {
            ReferencePathError::Sample { sample, source } => PathFileError::Sample {
                line: times[sample].0,
                source,
            },
            other => other.into(),
        })
    }
}

/// The time step of two or more (line, time) rows.
fn equal_spacing(times: &[(usize, f64)]) -> Result<f64, PathFileError> {
    for pair in times.windows(2) {
        let ((_, previous_s), (line, found_s)) = (pair[0], pair[1]);
        if found_s <= previous_s {
            return Err(PathFileError::TimeOrder {
                line,
                previous_s,
                found_s,
            });
        }
    }
    let (first_s, last_s) = (times[0].1, times[times.len() - 1].1);
    let fits = |dt_s: f64, tolerance: f64| {
        let mut rows = times.iter().enumerate();
        rows.all(|(k, row)| (row.1 - (first_s + k as f64 * dt_s)).abs() <= tolerance * dt_s)
    };
    // The first difference gives back the bits of a path that was written here.
    let first_difference_s = times[1].1 - first_s;
    if fits(first_difference_s, EXACT_TOLERANCE) {
        return Ok(first_difference_s);
    }
    let mean_s = (last_s - first_s) / (times.len() - 1) as f64;
    if fits(mean_s, ROUNDED_TOLERANCE) {
        return Ok(mean_s);
    }
    Err(most_uneven(times))
}

/// Blames the row whose distance from the one before is farthest from the median distance.
fn most_uneven(times: &[(usize, f64)]) -> PathFileError {
    let distance = |k: usize| times[k].1 - times[k - 1].1;
    let mut sorted: Vec<f64> = (1..times.len()).map(distance).collect();
    sorted.sort_by(f64::total_cmp);
    let median_s = sorted[(sorted.len() - 1) / 2];
    let mut worst = 1;
    for k in 2..times.len() {
        if (distance(k) - median_s).abs() > (distance(worst) - median_s).abs() {
            worst = k;
        }
    }
    PathFileError::Time {
        line: times[worst].0,
        expected_s: times[worst - 1].1 + median_s,
        found_s: times[worst].1,
    }
}
