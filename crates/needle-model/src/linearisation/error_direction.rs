//! Names for directions of the left-invariant error, for people who read a report.
//!
//! In the body frame of the reference the bevel bends in the y-z plane: an error in y lies in that
//! plane, an error in x across it; a heading error about x turns within the plane.

use std::fmt;

use nalgebra::Vector6;

/// Field names of the six coordinates of the error (linear, angular).
const NAMES: [&str; 6] = [
    "out-of-plane cross-track",
    "in-plane cross-track",
    "along-track",
    "in-plane heading",
    "out-of-plane heading",
    "roll",
];

/// Components below this fraction of the largest are left out of the words.
const NAMED_FRACTION: f64 = 0.05;

/// A direction of the error xi = (linear mm, angular rad).
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorDirection {
    /// The direction in physical units (mm, rad), of unit length after dividing lengths by the
    /// report's length scale.
    pub xi: Vector6<f64>,
    /// The same direction as a functional of errors, (1/mm, 1/rad): for a direction that no input can
    /// correct, `functional.dot(e)` is zero for every error e that inputs can make, and so it is what
    /// inputs conserve of the error at the end. `xi` itself is orthogonal to those errors only in
    /// the scaled units: `xi` = diag(L^2, L^2, L^2, 1, 1, 1) `functional`, L the report's length scale.
    pub functional: Vector6<f64>,
    /// The coordinates that take part, e.g. "in-plane cross-track", joined by "with".
    pub words: String,
}

impl fmt::Display for ErrorDirection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words)
    }
}

impl ErrorDirection {
    /// From a unit vector whose lengths are in units of `length_mm`.
    pub(crate) fn from_scaled(scaled: &Vector6<f64>, length_mm: f64) -> Self {
        let largest = scaled.amax();
        let mut parts: Vec<usize> = (0..6)
            .filter(|&i| scaled[i].abs() > NAMED_FRACTION * largest)
            .collect();
        // Equal parts to rounding: angles first, they are what a surgeon would correct.
        parts.sort_by_key(|&i| (-(scaled[i].abs() * 1e6).round() as i64, 6 - i));
        let words: Vec<&str> = parts.iter().map(|&i| NAMES[i]).collect();
        let (mut xi, mut functional) = (*scaled, *scaled);
        for i in 0..3 {
            xi[i] *= length_mm;
            functional[i] /= length_mm;
        }
        Self {
            xi,
            functional,
            words: words.join(" with "),
        }
    }
}

/// A basis of the same space with as many zeros as elimination gives, so that a direction that is a
/// plain coordinate is named by it. Rows are unit vectors.
pub(crate) fn sparse_basis(mut rows: Vec<Vector6<f64>>) -> Vec<Vector6<f64>> {
    let mut used = [false; 6];
    for pivot_row in 0..rows.len() {
        let pivot = (0..6).filter(|&c| !used[c]).max_by(|&a, &b| {
            let (x, y) = (rows[pivot_row][a].abs(), rows[pivot_row][b].abs());
            x.total_cmp(&y)
        });
        let Some(pivot) = pivot else { break };
        used[pivot] = true;
        let scaled = rows[pivot_row] / rows[pivot_row][pivot];
        rows[pivot_row] = scaled;
        for other in (0..rows.len()).filter(|&r| r != pivot_row) {
            let factor = rows[other][pivot];
            rows[other] -= scaled * factor;
        }
    }
    // Rounding of the elimination is not a direction.
    let clean = |row: Vector6<f64>| row.map(|x| if x.abs() < 1e-9 { 0.0 } else { x });
    let mut basis: Vec<_> = rows.into_iter().map(|row| clean(row.normalize())).collect();
    basis.sort_by_key(|row| row.iter().position(|x| x.abs() > 0.0));
    basis
}
