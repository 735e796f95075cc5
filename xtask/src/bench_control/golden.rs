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
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Columns with their absolute and relative tolerance.
///
/// A closed loop with a saturated spin amplifies rounding: the predictive controller's runs with noise differ by a fifth between
/// processors with and without fused multiply-add. A quarter finds a controller that has become worse, not one that rounds
/// otherwise.
const COLUMNS: [(&str, f64, f64); 5] = [
    ("rms_mm", 0.003, 0.25),
    ("max_mm", 0.01, 0.35),
    ("final_mm", 0.15, 0.35),
    ("rotation_rev", 0.5, 0.15),
    ("turned_rad", 3.2, 0.15),
];

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
    for (column, ..) in COLUMNS {
        text.push(',');
        text.push_str(column);
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

/// Writes the table.
pub(super) fn bless(rows: &[Row]) -> Result<(), GoldenError> {
    let path = path();
    if let Some(folder) = path.parent() {
        output::make_folder(folder)?;
    }
    Ok(output::write_whole(&path, table(rows).as_bytes())?)
}

/// The first row or value that differs is an error.
pub(super) fn check(rows: &[Row]) -> Result<(), GoldenError> {
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
        for ((golden, computed), (column, absolute, relative)) in
            numbers.into_iter().zip(values(row)).zip(COLUMNS)
        {
            let tolerance = absolute + relative * golden.abs();
            let gap = (computed - golden).abs();
            if gap.is_nan() || gap > tolerance {
                return Err(GoldenError::Value {
                    case: row.case,
                    controller: row.controller,
                    column,
                    golden,
                    computed,
                    tolerance,
                });
            }
        }
    }
    Ok(())
}
