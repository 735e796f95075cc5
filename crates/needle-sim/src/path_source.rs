//! The reference path of a scenario, from its recipe or file.

use crate::scenario::{InputSegment, Reference, Scenario};
use nalgebra::Vector3;
use needle_control::{ReconstructedPath, ReconstructionError, reconstruct_path};
use needle_model::{
    Input, InvalidCurvature, Needle, PaperReferenceError, PathFileError, PlannerFile, Pose,
    PositionCurve, PositionCurveError, PositionPathError, PositionPathProblem,
    PositionPathSettings, ReferencePath, ReferencePathError, read_planner_poses,
};
use std::io;
use std::path::{Path, PathBuf};

/// Why a scenario has no path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathSourceError {
    /// The file cannot be read.
    #[error("cannot read {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file of positions is no CSV.
    #[error("{}", path.display())]
    NotCsv {
        /// The file.
        path: PathBuf,
        /// Why.
        source: csv::Error,
    },
    /// A column that is needed is absent.
    #[error("{}: line 1: no column {column}; the header is: {header}", path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// The column.
        column: &'static str,
        /// The header.
        header: String,
    },
    /// A value is no number.
    #[error("{}: line {line}: {column}: expected a finite number, found \"{found}\"", path.display())]
    Number {
        /// The file.
        path: PathBuf,
        /// Line, from 1 on.
        line: u64,
        /// The column.
        column: &'static str,
        /// What is there.
        found: String,
    },
    /// The file of poses.
    #[error("{}", path.display())]
    Poses {
        /// The file.
        path: PathBuf,
        /// Why.
        source: PathFileError,
    },
    /// The needle that makes the path.
    #[error(transparent)]
    Needle(#[from] InvalidCurvature),
    /// The samples.
    #[error(transparent)]
    Path(#[from] ReferencePathError),
    /// The paper's path.
    #[error(transparent)]
    Paper(#[from] PaperReferenceError),
    /// The curve through the positions.
    #[error("the positions make no curve")]
    Curve(#[from] PositionCurveError),
    /// The problem of the inputs.
    #[error("no needle's inputs along the positions")]
    Positions(#[from] PositionPathError),
    /// Its solution.
    #[error("no needle's inputs along the positions")]
    Reconstruction(#[from] ReconstructionError),
}

/// The path of a scenario.
///
/// # Errors
/// [`PathSourceError`] names the file, line and column where there is one.
pub fn reference_path(scenario: &Scenario) -> Result<ReferencePath, PathSourceError> {
    let needle = Needle::new(scenario.curvature_per_mm)?;
    let dt_s = scenario.dt_s;
    match &scenario.reference {
        Reference::Inputs {
            curvature_factor,
            segments,
            ..
        } => {
            let maker = Needle::new(scenario.curvature_per_mm * curvature_factor)?;
            let inputs = segments.iter().flat_map(|segment| samples(segment, dt_s));
            let inputs = inputs.collect();
            Ok(ReferencePath::from_inputs(
                maker,
                Pose::identity(),
                inputs,
                dt_s,
            )?)
        }
        Reference::PaperBevel => Ok(ReferencePath::paper_recipe(needle)?),
        Reference::PaperEuler => Ok(ReferencePath::paper_euler_path()?),
        Reference::PaperStraight => Ok(ReferencePath::paper_straight_path()?),
        Reference::Positions {
            file,
            smoothing_mm,
            speed_mm_s,
        } => {
            let positions = read_positions(&scenario.folder.join(file))?;
            let settings = position_settings(scenario, *speed_mm_s);
            Ok(path_through(needle, &positions, *smoothing_mm, settings)?.path)
        }
        Reference::Poses { file } => {
            let path = scenario.folder.join(file);
            let parsed = ReferencePath::from_csv(&read(&path)?);
            parsed.map_err(|source| PathSourceError::Poses { path, source })
        }
        Reference::Planner { file } => {
            let path = scenario.folder.join(file);
            let poses = read_planner_poses(&read(&path)?, PlannerFile::InterpolatedPlan)
                .map_err(|source| PathSourceError::Poses { path, source })?;
            Ok(ReferencePath::from_poses(poses, dt_s)?)
        }
    }
}

/// The path that the controller is given: `path`, or what its needle executes along it.
pub(crate) fn steered_path(
    scenario: &Scenario,
    path: &ReferencePath,
) -> Result<ReferencePath, PathSourceError> {
    match &scenario.reference {
        Reference::Inputs {
            reconstructed: true,
            ..
        } => {
            let needle = Needle::new(scenario.curvature_per_mm)?;
            let positions: Vec<_> = path.poses().iter().map(|pose| pose.position_mm).collect();
            let length_mm = path.arc_length_mm().last().copied().unwrap_or(0.0);
            let settings = position_settings(scenario, length_mm / path.duration_s());
            Ok(path_through(needle, &positions, 0.0, settings)?.path)
        }
        _ => Ok(path.clone()),
    }
}

fn position_settings(scenario: &Scenario, speed_mm_s: f64) -> PositionPathSettings {
    PositionPathSettings {
        speed_mm_s,
        dt_s: scenario.dt_s,
        v_min_mm_s: scenario.limits.v_min_mm_s,
        v_max_mm_s: scenario.limits.v_max_mm_s,
        omega_max_rad_s: scenario.limits.omega_max_rad_s,
        ..PositionPathSettings::default()
    }
}

/// The path of a needle along positions: what it executes, and how close that comes to them.
///
/// # Errors
/// [`PathSourceError`] when the positions make no curve or no needle's path.
pub fn path_through(
    needle: Needle,
    positions_mm: &[Vector3<f64>],
    smoothing_mm: f64,
    settings: PositionPathSettings,
) -> Result<ReconstructedPath, PathSourceError> {
    let curve = PositionCurve::through(positions_mm, smoothing_mm)?;
    let problem = PositionPathProblem::new(needle, curve, settings)?;
    Ok(reconstruct_path(&problem)?)
}

/// Positions from a CSV file whose header names `x_mm`, `y_mm` and `z_mm`, in any order, among others.
///
/// # Errors
/// [`PathSourceError`] with file, line and column.
pub fn read_positions(path: &Path) -> Result<Vec<Vector3<f64>>, PathSourceError> {
    const COLUMNS: [&str; 3] = ["x_mm", "y_mm", "z_mm"];
    let text = read(path)?;
    let not_csv = |source| PathSourceError::NotCsv {
        path: path.into(),
        source,
    };
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
    let header = reader.headers().map_err(not_csv)?.clone();
    let mut indices = [0; 3];
    for (index, column) in indices.iter_mut().zip(COLUMNS) {
        let found = header.iter().position(|name| name == column);
        *index = found.ok_or_else(|| PathSourceError::Column {
            path: path.into(),
            column,
            header: header.iter().collect::<Vec<_>>().join(","),
        })?;
    }
    let mut positions = Vec::new();
    for row in reader.records() {
        let row = row.map_err(not_csv)?;
        let mut position = Vector3::zeros();
        for (i, column) in COLUMNS.into_iter().enumerate() {
            let text = row.get(indices[i]).unwrap_or_default();
            let number = text.parse().ok().filter(|x: &f64| x.is_finite());
            position[i] = number.ok_or_else(|| PathSourceError::Number {
                path: path.into(),
                line: row.position().map_or(0, csv::Position::line),
                column,
                found: text.into(),
            })?;
        }
        positions.push(position);
    }
    Ok(positions)
}

fn read(path: &Path) -> Result<String, PathSourceError> {
    std::fs::read_to_string(path).map_err(|source| PathSourceError::Unreadable {
        path: path.into(),
        source,
    })
}

fn samples(segment: &InputSegment, dt_s: f64) -> impl Iterator<Item = Input> {
    let input = Input {
        v_mm_s: segment.v_mm_s,
        omega_rad_s: segment.omega_rad_s,
    };
    // The cast saturates; the scenario's checks keep it below a million.
    std::iter::repeat_n(input, (segment.duration_s / dt_s).round() as usize)
}
