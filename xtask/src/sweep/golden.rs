//! The committed data that `--check` compares with, within a tolerance a column.

use super::compute::ComputedFigure;
use super::dataset::{self, DatasetError};
use super::extended::{self, ExtendedFile, Family};
use needle_sim::output::{self, OutputError};
use needle_sim::{LogRow, RunLog};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Why a check failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GoldenError {
    #[error("cannot read the golden data {path}")]
    Unreadable { path: PathBuf, source: io::Error },
    #[error("{file} is not CSV")]
    NotCsv {
        file: &'static str,
        source: csv::Error,
    },
    #[error("{file}: the columns differ: golden {golden}, computed {computed}")]
    Columns {
        file: &'static str,
        golden: String,
        computed: String,
    },
    #[error("{file}: golden has {golden} rows, computed {computed}")]
    RowCount {
        file: &'static str,
        golden: usize,
        computed: usize,
    },
    #[error(transparent)]
    Value(Box<Difference>),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// The first value that differs.
#[derive(Debug, thiserror::Error)]
#[error(
    "{file}: row {row} (run {run}, step {step}), column {column}: golden {golden}, computed {computed}, \
     tolerance {tolerance:e}"
)]
pub(crate) struct Difference {
    file: &'static str,
    row: usize,
    run: String,
    step: String,
    column: String,
    golden: String,
    computed: String,
    tolerance: f64,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/published")
}

fn path(figure: &ComputedFigure) -> PathBuf {
    folder().join(format!("{}.csv", figure.file.stem()))
}

/// Absolute tolerance of a column; zero compares text.
///
/// The loop feeds every solve's error into the next. The run that reacts most, R0.1, moves by 2e-5 mm between solver
/// tolerances of 1e-8 and 1e-10 (a test of `needle-sim` holds it below 1e-4 mm): ten times that is no rounding. A speed
/// is a difference of positions over 0.1 s.
fn tolerance(column: &str) -> f64 {
    match column {
        "x_mm" | "y_mm" | "z_mm" | "ref_x_mm" | "ref_y_mm" | "ref_z_mm" => 1e-3,
        "v_mm_s" => 1e-2,
        "alpha_rad" | "beta_rad" | "gamma_rad" => 1e-5,
        "omega_rad_s" => 1e-4,
        // Summaries of two hundred solves in feedback each, some with noise: what another machine's rounding leaves alone.
        "final_x_mm" | "final_y_mm" | "final_z_mm" | "rms_distance_mm" | "max_distance_mm" => 2e-2,
        "total_rotation_rad" => 0.1,
        "largest_speed_mm_s" => 0.1,
        "time_s" => 1e-12,
        "iterations" => 2.0,
        _ => 0.0,
    }
}

/// Absolute tolerance of a column of a family's summary. The corrected controllers stay within 3e-6 mm, which is what their data are there to show.
fn tolerance_of(family: Family, column: &str) -> f64 {
    match (family, column) {
        (Family::Corrected, "rms_distance_mm" | "max_distance_mm") => 1e-5,
        (Family::Corrected, "total_rotation_rad") => 1e-2,
        _ => tolerance(column),
    }
}

/// Compares every figure with its golden file; the first difference is the error.
pub(super) fn check(figures: &[ComputedFigure]) -> Result<(), GoldenError> {
    for figure in figures {
        let path = path(figure);
        let golden = fs::read(&path).map_err(|source| GoldenError::Unreadable { path, source })?;
        compare(
            figure.file.stem(),
            &golden,
            &dataset::encode(&untimed(&figure.logs))?,
            tolerance,
        )?;
    }
    Ok(())
}

/// Replaces the golden files.
pub(super) fn bless(figures: &[ComputedFigure]) -> Result<(), GoldenError> {
    output::make_folder(&folder())?;
    for figure in figures {
        output::write_whole(&path(figure), &dataset::encode(&untimed(&figure.logs))?)?;
    }
    Ok(())
}

fn extended_path(family: Family) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden");
    folder.join(format!("{}_summary.csv", family.folder()))
}

/// The summary of a family without its times. Whole tracks of its runs would be a megabyte that says no more.
fn extended_summary(family: Family, files: &[ExtendedFile]) -> Result<Vec<u8>, GoldenError> {
    let untimed: Vec<ExtendedFile> = files
        .iter()
        .map(|file| ExtendedFile {
            logs: untimed(&file.logs),
            ..*file
        })
        .collect();
    Ok(extended::summary(family, &untimed)?)
}

/// Compares the summaries of the extended sweeps, where there are any.
pub(super) fn check_extended(files: &[ExtendedFile]) -> Result<(), GoldenError> {
    for family in Family::ALL.into_iter().filter(|_| !files.is_empty()) {
        let path = extended_path(family);
        let golden = fs::read(&path).map_err(|source| GoldenError::Unreadable { path, source })?;
        let computed = extended_summary(family, files)?;
        let tolerance = |column: &str| tolerance_of(family, column);
        compare(family.folder(), &golden, &computed, tolerance)?;
    }
    Ok(())
}

/// Replaces the summaries of the extended sweeps.
pub(super) fn bless_extended(files: &[ExtendedFile]) -> Result<(), GoldenError> {
    for family in Family::ALL.into_iter().filter(|_| !files.is_empty()) {
        output::write_whole(&extended_path(family), &extended_summary(family, files)?)?;
    }
    Ok(())
}

/// The logs without their times, which no two runs share.
fn untimed(logs: &[RunLog]) -> Vec<RunLog> {
    let untimed = |row: &LogRow| LogRow {
        solve_us: None,
        ..row.clone()
    };
    logs.iter()
        .map(|log| RunLog {
            rows: log.rows.iter().map(untimed).collect(),
            ..log.clone()
        })
        .collect()
}

fn compare(
    file: &'static str,
    golden: &[u8],
    computed: &[u8],
    tolerance: impl Fn(&str) -> f64,
) -> Result<(), GoldenError> {
    let (golden_columns, golden) = records(file, golden)?;
    let (columns, computed) = records(file, computed)?;
    if golden_columns != columns {
        let list = |columns: csv::StringRecord| columns.iter().collect::<Vec<_>>().join(",");
        return Err(GoldenError::Columns {
            file,
            golden: list(golden_columns),
            computed: list(columns),
        });
    }
    for (row, (golden, computed)) in golden.iter().zip(&computed).enumerate() {
        for ((column, golden_value), computed_value) in columns.iter().zip(golden).zip(computed) {
            let tolerance = tolerance(column);
            if !agree(golden_value, computed_value, tolerance) {
                return Err(GoldenError::Value(Box::new(Difference {
                    file,
                    row: row + 1,
                    run: computed[0].into(),
                    step: computed[1].into(),
                    column: column.into(),
                    golden: golden_value.into(),
                    computed: computed_value.into(),
                    tolerance,
                })));
            }
        }
    }
    match golden.len() == computed.len() {
        true => Ok(()),
        false => Err(GoldenError::RowCount {
            file,
            golden: golden.len(),
            computed: computed.len(),
        }),
    }
}

fn records(
    file: &'static str,
    bytes: &[u8],
) -> Result<(csv::StringRecord, Vec<csv::StringRecord>), GoldenError> {
    let not_csv = |source| GoldenError::NotCsv { file, source };
    let mut reader = csv::Reader::from_reader(bytes);
    let columns = reader.headers().map_err(not_csv)?.clone();
    let rows = reader
        .records()
        .collect::<Result<_, _>>()
        .map_err(not_csv)?;
    Ok((columns, rows))
}

fn agree(golden: &str, computed: &str, tolerance: f64) -> bool {
    match (golden.parse::<f64>(), computed.parse::<f64>()) {
        _ if golden == computed => true,
        (Ok(golden), Ok(computed)) if tolerance > 0.0 => (golden - computed).abs() <= tolerance,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOLDEN: &str = "run,step,x_mm,status\nN8,0,1.0,\nN8,1,2.0,solved\n";

    fn check_against(computed: &str) -> Result<(), GoldenError> {
        compare("fig", GOLDEN.as_bytes(), computed.as_bytes(), tolerance)
    }

    #[test]
    fn equal_data_and_differences_below_the_tolerance_pass() {
        check_against(GOLDEN).unwrap();
        check_against(&GOLDEN.replace("2.0", "2.0000001")).unwrap();
    }

    #[test]
    fn the_first_row_and_column_that_differ_are_named() {
        let error = check_against(&GOLDEN.replace("2.0", "2.5"))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("row 2 (run N8, step 1), column x_mm: golden 2.0, computed 2.5"),
            "{error}"
        );
    }

    #[test]
    fn status_value_row_and_column_changes_fail() {
        for changed in ["solved_inaccurate", "NaN", ""] {
            check_against(&GOLDEN.replace("solved", changed)).unwrap_err();
        }
        for changed in ["NaN", "inf", ""] {
            check_against(&GOLDEN.replace("2.0", changed)).unwrap_err();
        }
        assert!(matches!(
            check_against("run,step,x_mm,status\nN8,0,1.0,\n"),
            Err(GoldenError::RowCount { .. })
        ));
        assert!(matches!(
            check_against(&GOLDEN.replace("x_mm", "x_cm")),
            Err(GoldenError::Columns { .. })
        ));
    }
}
