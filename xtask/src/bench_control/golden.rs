//! The committed table, and what is promised whatever it says. Times are not in it: they are the machine's.

use super::figures::{COLUMNS, Figure, Judged, Row};
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
        "{case}, {controller}: {column} is {golden} in the golden table, computed {computed}, tolerance {tolerance:.4}"
    )]
    Value {
        case: &'static str,
        controller: &'static str,
        column: &'static str,
        golden: f64,
        computed: f64,
        tolerance: f64,
    },
    #[error(
        "{case}, {controller}: {column} spreads by {golden} in the golden table, computed {computed}"
    )]
    Spread {
        case: &'static str,
        controller: &'static str,
        column: &'static str,
        golden: f64,
        computed: f64,
    },
    #[error("{case}, {controller}: {column} is {computed}: no golden figure")]
    NotFinite {
        case: &'static str,
        controller: &'static str,
        column: &'static str,
        computed: f64,
    },
    #[error("{case}, nmpc: {column} is {computed}, promised is {least} to {most}")]
    Promise {
        case: &'static str,
        column: &'static str,
        computed: f64,
        least: f64,
        most: f64,
    },
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// What a column may move by, absolute and relative: runs on exact poses differ between machines by rounding alone.
const ROUNDING: [[f64; 2]; COLUMNS.len()] = [
    [1e-4, 0.02],
    [1e-3, 0.05],
    [2e-3, 0.05],
    [0.05, 0.02],
    [0.3, 0.02],
];

/// Standard deviations of the difference of two means by which a column with noise may move besides. In a closed loop whose spin
/// saturates, another rounding is as good as another noise: the runs of two machines are two samples of one distribution.
const DEVIATIONS: f64 = 3.0;

/// The most that a column with noise may move by, relative: three deviations of a row that scatters would let it nearly double.
const MOST_RELATIVE: f64 = 0.25;

/// By which a spread may grow or shrink. Of two samples of eight from one normal distribution, one pair in two hundred is farther apart.
const SPREAD_FACTOR: f64 = 3.0;

fn tolerance(golden: Figure, runs: u64, [absolute, relative]: [f64; 2]) -> f64 {
    let of_means = golden.spread * (2.0 / runs as f64).sqrt();
    let size = golden.mean.abs();
    absolute + (relative * size + DEVIATIONS * of_means).min(MOST_RELATIVE * size)
}

/// Root mean square distance of the nonlinear controller, mm, whatever the golden table says.
const MOST_RMS_MM: [(&str, f64); 4] = [
    ("nominal", 0.015),
    ("plant curvature -20 %", 0.025),
    ("plant curvature +20 %", 0.015),
    ("noise 0.2 mm and 1 deg, filter", 0.08),
];

/// Its rotation in these cases, revolutions: the prototype's.
const ROTATION_REV: [f64; 2] = [7.0, 13.0];

/// A promise that is broken, or whose case is gone, is an error.
fn check_promises(rows: &[Row]) -> Result<(), GoldenError> {
    for (case, most_mm) in MOST_RMS_MM {
        let row = rows
            .iter()
            .find(|row| row.case == case && row.controller == "nmpc");
        let judged = row.and_then(|row| row.judged.as_ref());
        for (column, [least, most]) in [(0, [0.0, most_mm]), (3, ROTATION_REV)] {
            let computed = judged.map_or(f64::NAN, |judged| judged.figures[column].mean);
            if !(least..=most).contains(&computed) {
                return Err(GoldenError::Promise {
                    case,
                    column: COLUMNS[column],
                    computed,
                    least,
                    most,
                });
            }
        }
    }
    Ok(())
}

fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/control/closed_loops.csv")
}

/// What names a row.
fn named(row: &Row) -> String {
    format!("\"{}\",{},{}", row.case, row.controller, row.runs)
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from("case,controller,runs");
    for column in COLUMNS {
        // Writing to a string cannot fail.
        let _ = write!(text, ",{column},{column}_spread");
    }
    for row in rows {
        let _ = write!(text, "\n{}", named(row));
        match &row.judged {
            Some(Judged { figures, .. }) => {
                for Figure { mean, spread } in figures {
                    let _ = write!(text, ",{mean:.4},{spread:.4}");
                }
            }
            None => text.extend(COLUMNS.map(|_| ",-,-")),
        }
    }
    text.push('\n');
    text
}

/// A run that never came far enough to have a distance is no figure to compare with: infinity less infinity is no number.
fn check_finite(rows: &[Row]) -> Result<(), GoldenError> {
    for row in rows {
        let figures = row.judged.iter().flat_map(|judged| judged.figures);
        for (Figure { mean, spread }, column) in figures.zip(COLUMNS) {
            if !(mean.is_finite() && spread.is_finite()) {
                return Err(GoldenError::NotFinite {
                    case: row.case,
                    controller: row.controller,
                    column,
                    computed: mean,
                });
            }
        }
    }
    Ok(())
}

/// Writes the table, unless it breaks a promise or a figure is not finite.
pub(super) fn bless(rows: &[Row]) -> Result<(), GoldenError> {
    check_promises(rows)?;
    check_finite(rows)?;
    let path = path();
    if let Some(folder) = path.parent() {
        output::make_folder(folder)?;
    }
    Ok(output::write_whole(&path, table(rows).as_bytes())?)
}

/// A broken promise, and the first row or value that differs, is an error.
pub(super) fn check(rows: &[Row]) -> Result<(), GoldenError> {
    check_promises(rows)?;
    let path = path();
    let golden = std::fs::read_to_string(&path)
        .map_err(|source| GoldenError::Unreadable { path, source })?;
    let computed = table(rows);
    let (golden, computed): (Vec<&str>, Vec<&str>) =
        (golden.lines().collect(), computed.lines().collect());
    for at in 0..golden.len().max(computed.len()) {
        let line = |lines: &[&str]| lines.get(at).copied().unwrap_or_default().to_owned();
        let (golden, computed) = (line(&golden), line(&computed));
        let row = at.checked_sub(1).and_then(|at| rows.get(at));
        let numbers = row.and_then(|row| row.judged.as_ref().map(|judged| (row, judged)));
        let compared = numbers.zip(figures(&golden));
        match compared {
            Some(((row, judged), figures)) if golden.starts_with(&named(row)) => {
                compare(row, judged, figures)?;
            }
            _ if golden == computed => {}
            _ => {
                return Err(GoldenError::Line {
                    row: at,
                    golden,
                    computed,
                });
            }
        }
    }
    Ok(())
}

/// The figures at the end of a line of the golden table; `None` where there are none.
fn figures(line: &str) -> Option<[Figure; 5]> {
    let mut numbers: Vec<f64> = Vec::new();
    for text in line.rsplit(',').take(2 * COLUMNS.len()) {
        numbers.push(text.parse().ok()?);
    }
    numbers.reverse();
    let figures: Vec<_> = numbers
        .chunks_exact(2)
        .map(|pair| Figure {
            mean: pair[0],
            spread: pair[1],
        })
        .collect();
    figures.try_into().ok()
}

fn compare(row: &Row, judged: &Judged, golden: [Figure; 5]) -> Result<(), GoldenError> {
    let (case, controller) = (row.case, row.controller);
    for (at, (golden, computed)) in golden.into_iter().zip(judged.figures).enumerate() {
        let column = COLUMNS[at];
        let tolerance = tolerance(golden, row.runs, ROUNDING[at]);
        let gap = (computed.mean - golden.mean).abs();
        if gap.is_nan() || gap > tolerance {
            return Err(GoldenError::Value {
                case,
                controller,
                column,
                golden: golden.mean,
                computed: computed.mean,
                tolerance,
            });
        }
        let absolute = ROUNDING[at][0];
        let within = |a: f64, b: f64| a <= SPREAD_FACTOR * b + absolute;
        if !(within(computed.spread, golden.spread) && within(golden.spread, computed.spread)) {
            return Err(GoldenError::Spread {
                case,
                controller,
                column,
                golden: golden.spread,
                computed: computed.spread,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of eight runs with one figure in every column.
    fn row(figure: Figure) -> Row {
        let judged = Judged {
            figures: [figure; 5],
            median_step_us: 0.0,
            worst_step_us: 0.0,
        };
        Row {
            case: "noise",
            controller: "pid",
            runs: 8,
            main_column: 0,
            judged: Some(judged),
        }
    }

    fn compared(golden: [f64; 2], computed: [f64; 2]) -> Result<(), GoldenError> {
        let [golden, computed] = [golden, computed].map(|[mean, spread]| Figure { mean, spread });
        let row = row(computed);
        compare(&row, row.judged.as_ref().unwrap(), [golden; 5])
    }

    #[test]
    fn noise_lets_a_mean_move_by_a_quarter_at_most() {
        assert!(compared([1.0, 0.5], [1.24, 0.5]).is_ok());
        let moved = compared([1.0, 0.5], [1.26, 0.5]);
        assert!(matches!(moved, Err(GoldenError::Value { .. })), "{moved:?}");
    }

    #[test]
    fn a_spread_stays_within_a_factor_of_three() {
        assert!(compared([10.0, 0.5], [10.0, 1.4]).is_ok());
        for spread in [0.1, 2.0, f64::NAN] {
            let changed = compared([10.0, 0.5], [10.0, spread]);
            assert!(
                matches!(changed, Err(GoldenError::Spread { .. })),
                "{spread}: {changed:?}"
            );
        }
    }

    #[test]
    fn a_figure_that_is_not_finite_is_not_blessed() {
        for mean in [f64::INFINITY, f64::NAN] {
            let refused = check_finite(&[row(Figure { mean, spread: 0.0 })]);
            assert!(
                matches!(refused, Err(GoldenError::NotFinite { .. })),
                "{refused:?}"
            );
        }
        let finite = row(Figure {
            mean: 1.0,
            spread: 0.1,
        });
        assert!(check_finite(&[finite]).is_ok());
    }
}
