//! The committed table. Times are not in it: they are the machine's.

use super::Row;
use needle_sim::output::{self, OutputError};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Why a check failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GoldenError {
    #[error("cannot read the golden table {path}")]
    Unreadable {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("row {row} is `{golden}` in the golden table, computed `{computed}`")]
    Line {
        row: usize,
        golden: String,
        computed: String,
    },
    #[error(
        "{case}, {controller}: {column} is {golden} in the golden table, computed {computed}, tolerance {tolerance:.3}"
    )]
    Value {
        case: &'static str,
        controller: &'static str,
        column: &'static str,
        golden: f64,
        computed: f64,
        tolerance: f64,
    },
    #[error("{case}, nmpc: an RMS distance of {rms_mm} mm, at most {most_mm} mm is promised")]
    Ceiling {
        case: &'static str,
        rms_mm: f64,
        most_mm: f64,
    },
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// A column with what it may move by: absolute and relative, of runs on exact poses and of runs with noise.
struct Column {
    name: &'static str,
    exact: [f64; 2],
    noisy: [f64; 2],
}

const fn column(name: &'static str, exact: [f64; 2], noisy: [f64; 2]) -> Column {
    Column { name, exact, noisy }
}

/// The columns.
///
/// Runs on exact poses differ by rounding alone. With noise a closed loop with a saturated spin amplifies rounding: the predictive
/// controller's runs differ by a fifth between processors with and without fused multiply-add. A quarter finds a controller that
/// has become worse, not one that rounds otherwise.
const COLUMNS: [Column; 5] = [
    column("rms_mm", [1e-4, 0.02], [1e-4, 0.25]),
    column("max_mm", [1e-3, 0.05], [0.01, 0.35]),
    column("final_mm", [2e-3, 0.05], [0.15, 0.35]),
    column("rotation_rev", [0.05, 0.02], [0.5, 0.15]),
    column("turned_rad", [0.3, 0.02], [3.2, 0.15]),
];

/// Most that the nonlinear controller's root mean square distance may be, mm, whatever the golden table says.
const CEILINGS_MM: [(&str, f64); 4] = [
    ("nominal", 0.015),
    ("plant curvature -20 %", 0.025),
    ("plant curvature +20 %", 0.015),
    ("noise 0.2 mm and 1 deg, filter", 0.08),
];

/// A ceiling that is passed, or whose case is gone, is an error.
fn check_ceilings(rows: &[Row]) -> Result<(), GoldenError> {
    for (case, most_mm) in CEILINGS_MM {
        let row = rows
            .iter()
            .find(|row| row.case == case && row.controller == "nmpc");
        let rms_mm = row.map_or(f64::NAN, |row| row.score.rms_mm);
        if rms_mm.is_nan() || rms_mm > most_mm {
            return Err(GoldenError::Ceiling {
                case,
                rms_mm,
                most_mm,
            });
        }
    }
    Ok(())
}

fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/control/closed_loops.csv")
}

fn values(row: &Row) -> [f64; 5] {
    let score = &row.score;
    [
        score.rms_mm,
        score.max_mm,
        score.final_mm,
        score.rotation_rev,
        score.turned_rad,
    ]
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from("case,controller");
    for column in COLUMNS {
        text.push(',');
        text.push_str(column.name);
    }
    for row in rows {
        // Writing to a string cannot fail.
        let _ = write!(text, "\n\"{}\",{}", row.case, row.controller);
        for value in values(row) {
            let _ = write!(text, ",{value:.4}");
        }
    }
    text.push('\n');
    text
}

/// Writes the table, unless it breaks a ceiling.
pub(super) fn bless(rows: &[Row]) -> Result<(), GoldenError> {
    check_ceilings(rows)?;
    let path = path();
    if let Some(folder) = path.parent() {
        output::make_folder(folder)?;
    }
    Ok(output::write_whole(&path, table(rows).as_bytes())?)
}

/// A broken ceiling, and the first row or value that differs, is an error.
pub(super) fn check(rows: &[Row]) -> Result<(), GoldenError> {
    check_ceilings(rows)?;
    let path = path();
    let golden = std::fs::read_to_string(&path)
        .map_err(|source| GoldenError::Unreadable { path, source })?;
    let computed = table(rows);
    let (golden, computed): (Vec<&str>, Vec<&str>) =
        (golden.lines().collect(), computed.lines().collect());
    for at in 0..golden.len().max(computed.len()) {
        let line = |lines: &[&str]| lines.get(at).copied().unwrap_or_default().to_owned();
        let (golden, computed) = (line(&golden), line(&computed));
        let differs = || GoldenError::Line {
            row: at,
            golden: golden.clone(),
            computed: computed.clone(),
        };
        let Some(row) = at.checked_sub(1).and_then(|at| rows.get(at)) else {
            if golden == computed {
                continue;
            }
            return Err(differs());
        };
        let named = format!("\"{}\",{},", row.case, row.controller);
        let numbers = golden.strip_prefix(&named).ok_or_else(differs)?;
        let numbers: Option<Vec<f64>> = numbers.split(',').map(|n| n.parse().ok()).collect();
        let numbers = numbers
            .filter(|numbers| numbers.len() == COLUMNS.len())
            .ok_or_else(differs)?;
        for ((golden, computed), column) in numbers.into_iter().zip(values(row)).zip(COLUMNS) {
            let [absolute, relative] = if row.noisy {
                column.noisy
            } else {
                column.exact
            };
            let tolerance = absolute + relative * golden.abs();
            let gap = (computed - golden).abs();
            if gap.is_nan() || gap > tolerance {
                return Err(GoldenError::Value {
                    case: row.case,
                    controller: row.controller,
                    column: column.name,
                    golden,
                    computed,
                    tolerance,
                });
            }
        }
    }
    Ok(())
}
