//! The cost of a trajectory, what soft constraints that give way cost included.

use crate::multipliers::{Slacks, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::{Penalty, Softening};
use nalgebra::SVector;

impl<const NX: usize, const NU: usize> OcpQp<NX, NU> {
    /// The cost of a trajectory, penalties on slacks included. Lengths: N + 1 states, N inputs.
    #[must_use]
    pub fn objective(
        &self,
        x: &[SVector<f64, NX>],
        u: &[SVector<f64, NU>],
        slacks: &Slacks<NX>,
    ) -> f64 {
        let running: f64 = self
            .stages
            .iter()
            .zip(x.iter().zip(u))
            .map(|(stage, (x, u))| stage.cost(x, u))
            .sum();
        let terminal = x.last().map_or(0.0, |x| self.terminal.cost(x));
        running + terminal + self.penalty(slacks)
    }

    fn penalty(&self, slacks: &Slacks<NX>) -> f64 {
        let Softening {
            state_bounds,
            rows,
            terminal_set,
        } = &self.softening;
        let price = |penalty: &Penalty, values: &[f64]| {
            values
                .iter()
                .map(|value| penalty.cost(value.abs()))
                .sum::<f64>()
        };
        let bounds = |low: &SVector<f64, NX>, high: &SVector<f64, NX>| {
            price(state_bounds, low.as_slice()) + price(state_bounds, high.as_slice())
        };
        let running: f64 = slacks
            .stages
            .iter()
            .map(|stage| bounds(&stage.x_min, &stage.x_max) + price(rows, &stage.rows))
            .sum();
        let set = match &slacks.terminal.set {
            TerminalSetSlacks::None => 0.0,
            TerminalSetSlacks::Equality(violation) => price(terminal_set, violation.as_slice()),
            TerminalSetSlacks::Polytope(violations) => price(terminal_set, violations),
            TerminalSetSlacks::Ellipsoid(growth) => terminal_set.cost(*growth),
        };
        running + bounds(&slacks.terminal.x_min, &slacks.terminal.x_max) + set
    }
}
