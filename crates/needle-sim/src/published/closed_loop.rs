//! The loop that the straight and the bevelled needle share: solve, apply the first input, record.

use super::horizon::{Horizon, HorizonSolver};
use super::{DT_S, PublishedError};
use crate::log::{LogRow, RunLog};
use nalgebra::{SVector, Vector2};

/// One of the two published needles with its path.
pub(super) trait PublishedNeedle<const NX: usize> {
    /// Program of the step that starts at `state`.
    fn horizon(&self, state: &SVector<f64, NX>) -> Horizon<NX>;

    /// The plant, one step.
    fn advance(&self, state: &SVector<f64, NX>, input: &Vector2<f64>) -> SVector<f64, NX>;

    /// State and input in the log's units, without a reference point.
    fn row(step: usize, state: &SVector<f64, NX>, input: Option<&Vector2<f64>>) -> LogRow;

    /// `row` with the reference point nearest to `state`.
    fn with_reference(&self, row: LogRow, state: &SVector<f64, NX>) -> LogRow;
}

/// `steps` steps from rest at the origin.
pub(super) fn closed_loop<const NX: usize, P: PublishedNeedle<NX>>(
    run: &str,
    needle: &P,
    tolerance: f64,
    steps: usize,
) -> Result<RunLog, PublishedError> {
    let mut solver = HorizonSolver::new(tolerance);
    let mut state = SVector::zeros();
    let mut rows = vec![needle.with_reference(P::row(0, &state, None), &state)];
    for step in 0..steps {
        let horizon = needle.horizon(&state);
        let answer = solver.first_input(step, &horizon, state)?;
        // A failed solve moves nothing.
        let input = answer
            .u
            .map_or_else(Vector2::zeros, |u| u + horizon.inputs[0]);
        state = needle.advance(&state, &input);
        let row = answer.recorded_in(P::row(step + 1, &state, Some(&input)));
        rows.push(needle.with_reference(row, &state));
    }
    Ok(RunLog {
        run: run.into(),
        dt_s: DT_S,
        rows,
    })
}
