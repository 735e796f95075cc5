//! What reading any path file has in common: numbers with a line and a column, and why not.

use nalgebra::{Quaternion, UnitQuaternion};
use thiserror::Error;

use crate::geometry::pose::Pose;
use crate::plant::needle::StepError;
use crate::reference::reference_path::ReferencePathError;

/// How far a quaternion's norm may be from 1: planners print six digits.
const NORM_TOLERANCE: f64 = 1e-3;

/// Below this the norm is 1 to rounding, and normalising would only change the last digit.
const NORM_ROUNDING: f64 = 1e-14;

/// Why a path file was refused. Lines count from 1.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PathFileError {
    /// No pose in the file.
    #[error("the file holds no pose")]
    Empty,
    /// The first line is not the header of this format.
    #[error("line 1: expected header \"{expected}\", found \"{found}\"")]
    Header {
        /// Header of the format.
        expected: &'static str,
        /// First line of the file.
        found: String,
    },
    /// A line has too few or too many columns.
    #[error("line {line}: expected {expected} columns, found {found}")]
    Columns {
        /// Line.
        line: usize,
        /// Number of columns of the format.
        expected: usize,
        /// Number of columns found.
        found: usize,
    },
    /// A field is not a finite number.
    #[error("line {line}, column {column}: \"{text}\" is not a finite number")]
    Number {
        /// Line.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The field.
        text: String,
    },
    /// A rotation is not a unit quaternion.
    #[error("line {line}: quaternion has norm {norm}, expected 1")]
    Quaternion {
        /// Line.
        line: usize,
        /// Norm found.
        norm: f64,
    },
    /// Times are not equally spaced.
    #[error("line {line}: expected time {expected_s} s, found {found_s} s")]
    Time {
        /// Line.
        line: usize,
        /// Time that equal spacing asks for, s.
        expected_s: f64,
        /// Time found, s.
        found_s: f64,
    },
    /// A time is not after the one before.
    #[error("line {line}: time {found_s} s does not come after {previous_s} s")]
    TimeOrder {
        /// Line.
        line: usize,
        /// Time of the row before, s.
        previous_s: f64,
        /// Time found, s.
        found_s: f64,
    },
    /// A single row has no time step, and the file does not give one.
    #[error("line {line}: a single row needs a line \"{expected}\" before it")]
    TimeStep {
        /// Line of the row.
        line: usize,
        /// How the line that gives the time step begins.
        expected: &'static str,
    },
    /// The last row has an input, though no pose follows.
    #[error(
        "line {line}: the last row must have zero input, found {v_mm_s} mm/s, {omega_rad_s} rad/s"
    )]
    LastInput {
        /// Line.
        line: usize,
        /// Insertion speed found, mm/s.
        v_mm_s: f64,
        /// Rotation speed found, rad/s.
        omega_rad_s: f64,
    },
    /// A row's numbers are finite, but not what a needle can have.
    #[error("line {line}: {source}")]
    Sample {
        /// Line.
        line: usize,
        /// What is wrong with it.
        source: StepError,
    },
    /// The samples make no path.
    #[error(transparent)]
    Path(#[from] ReferencePathError),
}

/// The text without the byte order mark that some programs put before it.
pub(crate) fn without_bom(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// The pose, when its coordinates are small enough to compute with.
pub(crate) fn checked(line: usize, pose: Pose) -> Result<Pose, PathFileError> {
    if pose.is_finite() {
        Ok(pose)
    } else {
        let source = StepError::NonFiniteState;
        Err(PathFileError::Sample { line, source })
    }
}

/// Exactly `N` finite numbers.
pub(crate) fn numbers<'a, const N: usize>(
    line: usize,
    fields: impl Iterator<Item = &'a str>,
) -> Result<[f64; N], PathFileError> {
    let mut values = [0.0; N];
    let mut found = 0;
    for (i, field) in fields.enumerate() {
        found = i + 1;
        let Some(slot) = values.get_mut(i) else {
            continue;
        };
        *slot = match field.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => value,
            _ => {
                return Err(PathFileError::Number {
                    line,
                    column: found,
                    text: field.to_owned(),
                });
            }
        };
    }
    if found == N {
        Ok(values)
    } else {
        Err(PathFileError::Columns {
            line,
            expected: N,
            found,
        })
    }
}

/// A rotation from its quaternion, normalised.
pub(crate) fn rotation(
    line: usize,
    [w, x, y, z]: [f64; 4],
) -> Result<UnitQuaternion<f64>, PathFileError> {
    let q = Quaternion::new(w, x, y, z);
    let norm = q.norm();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        Err(PathFileError::Quaternion { line, norm })
    } else if (norm - 1.0).abs() < NORM_ROUNDING {
        Ok(UnitQuaternion::new_unchecked(q))
    } else {
        Ok(UnitQuaternion::from_quaternion(q))
    }
}
