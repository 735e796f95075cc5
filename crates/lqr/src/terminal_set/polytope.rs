//! The maximal constraint-admissible invariant set of x+ = A_K x (Gilbert and Tan, 1991).
//!
//! O_t holds the states whose next t + 1 values satisfy all rows: { x : f_i A_K^j x <= h_i, j = 0..t }. When the rows of step t + 1
//! are implied by O_t, which linear programs decide, O_t is invariant and the largest such set. Limits may be asymmetric
//! and may be zero (0 <= v: the origin on the boundary), but then, and for a spectral radius near one, the number of steps grows without
//! bound: at 0.99 an oscillating mode needs hundreds of steps and as many rows. Caps on both answer with what was reached.

use crate::arithmetic::dense::{mul, norm};
use crate::input::{self, InputError};
use crate::modes::spectrum;
use crate::terminal_set::constraints::LawRow;
use crate::terminal_set::ellipsoid::TerminalSetError;
use crate::terminal_set::simplex::{Maximum, maximise};
use faer::{Mat, MatRef};

/// A row of unit length implied up to this counts as implied, relative to its bound plus the least bound that is not zero.
pub(crate) const IMPLIED: f64 = 1e-9;
/// Rows that are kept where the caller names no cap.
const MAX_ROWS: usize = 1000;

/// Where the iteration gives up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Caps {
    /// Steps looked ahead.
    pub steps: usize,
    /// Rows that are not redundant.
    pub rows: usize,
}

/// Where the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Determination {
    /// Invariant and maximal, up to 1e-9 of each bound plus the least one that is not zero; `index` is the number of steps ahead that the rows look.
    Determined {
        /// The determinedness index t.
        index: usize,
    },
    /// The cap was met: the set is an outer bound of the maximal one and **not** shown to be invariant.
    CapMet {
        /// Steps taken.
        steps: usize,
    },
    /// The cap on rows was exceeded, with the same consequence.
    RowCapMet {
        /// Rows that are not redundant, more than the cap.
        rows: usize,
        /// Steps taken.
        steps: usize,
    },
}

/// A row of the set.
#[derive(Debug, Clone, PartialEq)]
pub struct SetRow {
    /// Coefficients, length n, of unit length.
    pub row: Vec<f64>,
    /// Right side, >= 0.
    pub bound: f64,
    /// Name of the constraint that it comes from.
    pub name: String,
    /// How many steps ahead that constraint is meant.
    pub steps_ahead: usize,
}

/// { x : row x <= bound for every row }, without redundant rows.
#[derive(Debug, Clone, PartialEq)]
pub struct AdmissibleSet {
    /// The rows.
    pub rows: Vec<SetRow>,
    /// Whether the set is the maximal invariant one.
    pub determination: Determination,
}

impl AdmissibleSet {
    /// The maximal admissible invariant set of x+ = `closed_loop` x under `rows`, looking at most `max_steps` ahead with at most 1000 rows.
    ///
    /// # Errors
    /// [`TerminalSetError::Unstable`] for a spectral radius of one or more, `Input` for shapes.
    pub fn maximal(
        closed_loop: MatRef<'_, f64>,
        rows: &[LawRow],
        max_steps: usize,
    ) -> Result<Self, TerminalSetError> {
        let caps = Caps {
            steps: max_steps,
            rows: MAX_ROWS,
        };
        Self::maximal_within(closed_loop, rows, caps)
    }

    /// As [`AdmissibleSet::maximal`], within the given caps.
    ///
    /// # Errors
    /// As [`AdmissibleSet::maximal`].
    pub fn maximal_within(
        closed_loop: MatRef<'_, f64>,
        rows: &[LawRow],
        caps: Caps,
    ) -> Result<Self, TerminalSetError> {
        let n = closed_loop.nrows();
        if n == 0 {
            return Err(InputError::Empty { name: "A_K" }.into());
        }
        let a = input::matrix("A_K", closed_loop, (n, n))?;
        for row in rows {
            input::matrix(
                "row",
                MatRef::from_column_major_slice(&row.row, row.row.len(), 1),
                (n, 1),
            )?;
            input::finite_not_negative("bound", row.bound)?;
        }
        let spectral_radius = spectrum::largest_modulus(&a).unwrap_or(f64::NAN);
        if !(spectral_radius < 1.0) {
            return Err(TerminalSetError::Unstable { spectral_radius });
        }
        let mut found: Vec<SetRow> = Vec::new();
        // Rows f_i A_K^t of the current step, one column each.
        let mut ahead = Mat::from_fn(n, rows.len(), |j, i| rows[i].row[j]);
        let transposed = a.transpose().to_owned();
        let room = least_room(rows);
        for step in 0..=caps.steps {
            let fresh: Vec<SetRow> = rows
                .iter()
                .enumerate()
                .filter_map(|(i, row)| normalised(ahead.col_as_slice(i), row, step))
                .collect();
            let before = found.len();
            for row in fresh {
                if !is_implied(&row, found.iter(), room) {
                    found.push(row);
                }
            }
            if found.len() == before {
                let index = step.saturating_sub(1);
                return Ok(Self {
                    rows: without_redundancy(found, room),
                    determination: Determination::Determined { index },
                });
            }
            if found.len() > caps.rows {
                found = without_redundancy(found, room);
            }
            if found.len() > caps.rows {
                return Ok(Self {
                    determination: Determination::RowCapMet {
                        rows: found.len(),
                        steps: step,
                    },
                    rows: found,
                });
            }
            ahead = mul(&transposed, &ahead);
        }
        Ok(Self {
            rows: without_redundancy(found, room),
            determination: Determination::CapMet { steps: caps.steps },
        })
    }

    /// The largest `row x - bound` over the rows: at most zero inside the set.
    ///
    /// # Errors
    /// [`InputError`] for an x of another length.
    pub fn violation(&self, x: &[f64]) -> Result<f64, InputError> {
        let n = self.rows.first().map_or(x.len(), |row| row.row.len());
        input::matrix("x", MatRef::from_column_major_slice(x, x.len(), 1), (n, 1))?;
        let excess =
            |row: &SetRow| row.row.iter().zip(x).map(|(f, x)| f * x).sum::<f64>() - row.bound;
        Ok(self
            .rows
            .iter()
            .map(excess)
            .fold(f64::NEG_INFINITY, f64::max))
    }

    /// The largest `row x` over the set; infinite in an unbounded direction, `None` where the linear program did not settle.
    ///
    /// # Errors
    /// [`InputError`] for a row of another length or with entries that are not finite.
    pub fn support(&self, row: &[f64]) -> Result<Option<f64>, InputError> {
        let n = self.rows.first().map_or(row.len(), |first| first.row.len());
        let column = MatRef::from_column_major_slice(row, row.len(), 1);
        input::matrix("row", column, (n, 1))?;
        Ok(match maximise(row, self.half_spaces()) {
            Maximum::Value(value) => Some(value),
            Maximum::Unbounded => Some(f64::INFINITY),
            Maximum::Unsettled => None,
        })
    }

    pub(crate) fn half_spaces(&self) -> impl Iterator<Item = (&[f64], f64)> {
        self.rows.iter().map(|r| (r.row.as_slice(), r.bound))
    }
}

/// The least bound that is not zero, of rows at unit length: the size of what is to be told apart.
pub(crate) fn least_room(rows: &[LawRow]) -> f64 {
    let bounds = rows
        .iter()
        .map(|row| row.bound / length(&row.row))
        .filter(|&bound| bound > 0.0 && bound.is_finite());
    bounds.reduce(f64::min).unwrap_or(1.0)
}

/// |row|
pub(crate) fn length(row: &[f64]) -> f64 {
    norm(&MatRef::from_column_major_slice(row, row.len(), 1).to_owned())
}

/// The row at unit length; `None` for one that does not act on the state.
fn normalised(row: &[f64], origin: &LawRow, steps_ahead: usize) -> Option<SetRow> {
    let length = length(row);
    (length > 0.0).then(|| SetRow {
        row: row.iter().map(|x| x / length).collect(),
        bound: origin.bound / length,
        name: origin.name.clone(),
        steps_ahead,
    })
}

/// Whether the other rows imply this one. An unsettled program counts as no: a row too many is harmless.
fn is_implied<'a>(row: &SetRow, others: impl Iterator<Item = &'a SetRow>, room: f64) -> bool {
    match maximise(&row.row, others.map(|r| (r.row.as_slice(), r.bound))) {
        Maximum::Value(value) => value <= row.bound + IMPLIED * (room + row.bound),
        Maximum::Unbounded | Maximum::Unsettled => false,
    }
}

/// Drops each row that the remaining ones imply, latest first: they are the likeliest.
fn without_redundancy(mut rows: Vec<SetRow>, room: f64) -> Vec<SetRow> {
    let mut at = rows.len();
    while at > 0 {
        at -= 1;
        let others = rows
            .iter()
            .enumerate()
            .filter(|&(i, _)| i != at)
            .map(|(_, row)| row);
        // One row at a time, against those that are still there: of two that imply each other one stays.
        if is_implied(&rows[at], others, room) {
            rows.remove(at);
        }
    }
    rows
}
