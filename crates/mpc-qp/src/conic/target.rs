//! Receivers of the assembled entries: one learns the pattern, one refills the values.

use super::pattern::Pattern;
use faer::sparse::Pair;

/// Receiver of the entries.
pub(super) trait Target {
    fn cost(&mut self, row: usize, column: usize, value: f64);
    fn constraint(&mut self, row: usize, column: usize, value: f64);
    fn linear(&mut self, column: usize, value: f64);
    fn right(&mut self, row: usize, value: f64);
}

/// Collects the places of the entries.
#[derive(Default)]
pub(super) struct Indices {
    pub(super) cost: Vec<Pair<usize, usize>>,
    pub(super) constraints: Vec<Pair<usize, usize>>,
}

impl Target for Indices {
    fn cost(&mut self, row: usize, col: usize, _value: f64) {
        self.cost.push(Pair { row, col });
    }
    fn constraint(&mut self, row: usize, col: usize, _value: f64) {
        self.constraints.push(Pair { row, col });
    }
    fn linear(&mut self, _column: usize, _value: f64) {}
    fn right(&mut self, _row: usize, _value: f64) {}
}

/// Writes the entries into an existing pattern, costs multiplied by `cost_scale`.
pub(super) struct Values<'a> {
    cost_scale: f64,
    cost: &'a mut Pattern,
    constraints: &'a mut Pattern,
    linear: &'a mut [f64],
    right: &'a mut [f64],
    cost_ordinal: usize,
    constraint_ordinal: usize,
}

impl<'a> Values<'a> {
    pub(super) fn new(
        cost: &'a mut Pattern,
        constraints: &'a mut Pattern,
        linear: &'a mut [f64],
        right: &'a mut [f64],
        cost_scale: f64,
    ) -> Self {
        Self {
            cost_scale,
            cost,
            constraints,
            linear,
            right,
            cost_ordinal: 0,
            constraint_ordinal: 0,
        }
    }
}

impl Target for Values<'_> {
    fn cost(&mut self, _row: usize, _column: usize, value: f64) {
        self.cost.write(self.cost_ordinal, value * self.cost_scale);
        self.cost_ordinal += 1;
    }
    fn constraint(&mut self, _row: usize, _column: usize, value: f64) {
        self.constraints.write(self.constraint_ordinal, value);
        self.constraint_ordinal += 1;
    }
    fn linear(&mut self, column: usize, value: f64) {
        self.linear[column] = value * self.cost_scale;
    }
    fn right(&mut self, row: usize, value: f64) {
        self.right[row] = value;
    }
}
