//! A sparse column matrix whose pattern is made once and whose values are written in place.
//!
//! faer sorts the index pairs into its symbolic structure and returns the order; that order, inverted, says where the n-th
//! emitted value goes. Every pair is emitted exactly once.

use crate::error::SolveError;
use faer::sparse::{Pair, SparseColMat, SymbolicSparseColMat};

/// Pattern, values, and the place of each emitted value.
#[derive(Clone)]
pub(super) struct Pattern {
    symbolic: SymbolicSparseColMat<usize>,
    values: Vec<f64>,
    slots: Vec<usize>,
}

impl Pattern {
    /// The pattern of these (row, column) pairs, in the order in which values will be emitted.
    pub(super) fn new(
        rows: usize,
        columns: usize,
        pairs: &[Pair<usize, usize>],
    ) -> Result<Self, SolveError> {
        let refused = |source| SolveError::SparsePattern {
            rows,
            columns,
            source,
        };
        let (symbolic, order) =
            SymbolicSparseColMat::try_new_from_indices(rows, columns, pairs).map_err(refused)?;
        // Filled with the ordinal numbers of emission, the matrix tells which of them went where.
        let ordinals: Vec<f64> = (0..pairs.len()).map(|ordinal| ordinal as f64).collect();
        let matrix = SparseColMat::new_from_argsort(symbolic, &order, &ordinals)
            .map_err(|error| refused(error.into()))?;
        let (symbolic, mut values) = matrix.into_parts();
        debug_assert_eq!(values.len(), pairs.len(), "a pair was emitted twice");
        let mut slots = vec![0; pairs.len()];
        for (position, &ordinal) in values.iter().enumerate() {
            slots[ordinal as usize] = position;
        }
        values.fill(0.0);
        Ok(Self {
            symbolic,
            values,
            slots,
        })
    }

    /// Writes the value emitted as number `ordinal`.
    pub(super) fn write(&mut self, ordinal: usize, value: f64) {
        self.values[self.slots[ordinal]] = value;
    }

    pub(super) fn shape(&self) -> (usize, usize) {
        (self.symbolic.nrows(), self.symbolic.ncols())
    }

    pub(super) fn column_starts(&self) -> &[usize] {
        self.symbolic.col_ptr()
    }

    pub(super) fn row_indices(&self) -> &[usize] {
        self.symbolic.row_idx()
    }

    pub(super) fn values(&self) -> &Vec<f64> {
        &self.values
    }
}
