//! The reference path of a scenario, from its recipe or file, and what its needle executes along it.

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
    /// Positions of a file.
    #[error("{}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<PathSourceError>,
    },
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

/// The path of a scenario that distances are to, and what the needle executes along it where the scenario asks for that: along
/// positions always, along a curve by inputs with `reconstructed`.
///
/// # Errors
/// [`PathSourceError`] names the file, line and column where there is one.
pub(crate) fn paths(
    scenario: &Scenario,
) -> Result<(ReferencePath, Option<ReconstructedPath>), PathSourceError> {
    let needle = Needle::new(scenario.curvature_per_mm)?;
    let dt_s = scenario.dt_s;
    let path = match &scenario.reference {
        Reference::Inputs {
            curvature_factor,
            segments,
            reconstructed,
        } => {
            let maker = Needle::new(scenario.curvature_per_mm * curvature_factor)?;
            let inputs = segments.iter().flat_map(|segment| samples(segment, dt_s));
            let path = ReferencePath::from_inputs(maker, Pose::identity(), inputs.collect(), dt_s)?;
            let executed = reconstructed.then(|| executed_along(scenario, needle, &path));
            return Ok((path, executed.transpose()?));
        }
        Reference::Positions {
            file,
            smoothing_mm,
            speed_mm_s,
        } => {
            let file = scenario.folder.join(file);
            let positions = read_positions(&file)?;
            let settings = position_settings(scenario, *speed_mm_s);
            let found = curve_and_path(needle, &positions, *smoothing_mm, settings);
            let (curve, executed) = found.map_err(|source| PathSourceError::File {
                path: file,
                source: Box::new(source),
            })?;
            return Ok((curve, Some(executed)));
        }
        Reference::PaperBevel => ReferencePath::paper_recipe(needle)?,
        Reference::PaperEuler => ReferencePath::paper_euler_path()?,
        Reference::PaperStraight => ReferencePath::paper_straight_path()?,
        Reference::Poses { file } => {
            let path = scenario.folder.join(file);
            let parsed = ReferencePath::from_csv(&read(&path)?);
            parsed.map_err(|source| PathSourceError::Poses { path, source })?
        }
        Reference::Planner { file } => {
            let path = scenario.folder.join(file);
            let poses = read_planner_poses(&read(&path)?, PlannerFile::InterpolatedPlan)
                .map_err(|source| PathSourceError::Poses { path, source })?;
            ReferencePath::from_poses(poses, dt_s)?
        }
    };
    Ok((path, None))
}

fn executed_along(
    scenario: &Scenario,
    needle: Needle,
    path: &ReferencePath,
) -> Result<ReconstructedPath, PathSourceError> {
    let positions: Vec<_> = path.poses().iter().map(|pose| pose.position_mm).collect();
    let length_mm = path.arc_length_mm().last().copied().unwrap_or(0.0);
    let settings = position_settings(scenario, length_mm / path.duration_s());
    path_through(needle, &positions, 0.0, settings)
}

/// The curve through positions, turned as the path that a needle executes along it, and that path.
fn curve_and_path(
    needle: Needle,
    positions_mm: &[Vector3<f64>],
    smoothing_mm: f64,
    settings: PositionPathSettings,
) -> Result<(ReferencePath, ReconstructedPath), PathSourceError> {
    let problem = problem(needle, positions_mm, smoothing_mm, settings)?;
    let executed = reconstruct_path(&problem)?;
    let on_curve = problem.targets_mm().iter().zip(executed.path.poses());
    let poses = on_curve.map(|(&position_mm, pose)| Pose {
        rotation: pose.rotation,
        position_mm,
    });
    let (poses, inputs) = (poses.collect(), executed.path.inputs().to_vec());
    let curve = ReferencePath::from_samples(poses, inputs, executed.path.dt_s())?;
    Ok((curve, executed))
}

fn position_settings(scenario: &Scenario, speed_mm_s: f64) -> PositionPathSettings {
    PositionPathSettings {
        speed_mm_s,
        dt_s: scenario.dt_s,
        v_min_mm_s: scenario.limits.v_min_mm_s,
        v_max_mm_s: scenario.limits.v_max_mm_s,
        omega_max_rad_s: scenario.limits.omega_max_rad_s,
        v_rate_max_mm_s2: scenario.limits.v_rate_max_mm_s2,
        omega_rate_max_rad_s2: scenario.limits.omega_rate_max_rad_s2,
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
    let problem = problem(needle, positions_mm, smoothing_mm, settings)?;
    Ok(reconstruct_path(&problem)?)
}

fn problem(
    needle: Needle,
    positions_mm: &[Vector3<f64>],
    smoothing_mm: f64,
    settings: PositionPathSettings,
) -> Result<PositionPathProblem, PathSourceError> {
    let curve = PositionCurve::through(positions_mm, smoothing_mm)?;
    Ok(PositionPathProblem::new(needle, curve, settings)?)
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
