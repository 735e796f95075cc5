//! From the iterate to the caller's solution: states, inputs, multipliers, slacks.

use super::channel::Channel;
use super::newton::Newton;
use super::soft::Price;
use crate::multipliers::{Multipliers, TerminalSetMultipliers, TerminalSetSlacks};
use crate::solution::Solution;
use nalgebra::SVector;

/// Multiplier of value `index` on the lower and the upper side.
fn multipliers(channel: &Channel, index: usize) -> (f64, f64) {
    let side = |side: usize| {
        let lane = &channel.sides[side][index / 4];
        lane.on[index % 4] * lane.z[index % 4]
    };
    (side(0), side(1))
}

/// Slack of value `index` on the lower and the upper side.
fn slacks(channel: &Channel, index: usize) -> (f64, f64) {
    let side = |side: usize| {
        let lane = &channel.sides[side][index / 4];
        lane.on[index % 4]
            * match channel.price {
                Price::Hard => 0.0,
                Price::Quadratic(rho) => lane.z[index % 4] / rho,
                Price::Exact(_) => channel.slacks[side][index / 4].e[index % 4],
            }
    };
    (side(0), side(1))
}

fn write_pairs<const M: usize>(
    channel: &Channel,
    k: usize,
    of: fn(&Channel, usize) -> (f64, f64),
    lower: &mut SVector<f64, M>,
    upper: &mut SVector<f64, M>,
) {
    for i in 0..M {
        (lower[i], upper[i]) = of(channel, k * M + i);
    }
}

fn write_fixed<const M: usize>(channel: &Channel, mut write: impl FnMut(usize, usize, f64, f64)) {
    for fixed in &channel.fixed {
        write(
            fixed.index / M,
            fixed.index % M,
            (-fixed.y).max(0.0),
            fixed.y.max(0.0),
        );
    }
}

/// Multiplies every multiplier but the costates.
fn scale_multipliers<const NX: usize, const NU: usize>(
    multipliers: &mut Multipliers<NX, NU>,
    factor: f64,
) {
    for stage in &mut multipliers.stages {
        for group in [
            &mut stage.u_min,
            &mut stage.u_max,
            &mut stage.du_min,
            &mut stage.du_max,
        ] {
            *group *= factor;
        }
        stage.x_min *= factor;
        stage.x_max *= factor;
        stage.rows.iter_mut().for_each(|z| *z *= factor);
    }
    let terminal = &mut multipliers.terminal;
    terminal.x_min *= factor;
    terminal.x_max *= factor;
    match &mut terminal.set {
        TerminalSetMultipliers::None => {}
        TerminalSetMultipliers::Equality(multiplier) => *multiplier *= factor,
        TerminalSetMultipliers::Polytope(multipliers) => {
            multipliers.iter_mut().for_each(|z| *z *= factor);
        }
        TerminalSetMultipliers::Ellipsoid { radius, offset } => {
            *radius *= factor;
            *offset *= factor;
        }
    }
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// Writes everything but the costates, the status and the account.
    pub(super) fn write(&self, solution: &mut Solution<NX, NU>) {
        let n = self.n;
        solution.x[0] = self.x0.into();
        for k in 0..n {
            solution.x[k + 1] = (*self.x(k + 1)).into();
            solution.u[k] = (*self.u(k)).into();
            let to = &mut solution.multipliers.stages[k];
            write_pairs(&self.inputs, k, multipliers, &mut to.u_min, &mut to.u_max);
            write_pairs(&self.rates, k, multipliers, &mut to.du_min, &mut to.du_max);
            for (i, index) in (self.row_start[k]..self.row_start[k + 1]).enumerate() {
                to.rows[i] = multipliers(&self.rows, index).1;
                solution.slacks.stages[k].rows[i] = slacks(&self.rows, index).1;
            }
            if k > 0 && self.states.any() {
                write_pairs(
                    &self.states,
                    k - 1,
                    multipliers,
                    &mut to.x_min,
                    &mut to.x_max,
                );
                let to = &mut solution.slacks.stages[k];
                write_pairs(&self.states, k - 1, slacks, &mut to.x_min, &mut to.x_max);
            } else {
                let slack = &mut solution.slacks.stages[k];
                for unused in [&mut to.x_min, &mut to.x_max] {
                    unused.fill(0.0);
                }
                for unused in [&mut slack.x_min, &mut slack.x_max] {
                    unused.fill(0.0);
                }
            }
        }
        if self.states.any() {
            let to = &mut solution.multipliers.terminal;
            write_pairs(
                &self.states,
                n - 1,
                multipliers,
                &mut to.x_min,
                &mut to.x_max,
            );
            let to = &mut solution.slacks.terminal;
            write_pairs(&self.states, n - 1, slacks, &mut to.x_min, &mut to.x_max);
        } else {
            let (multipliers, slack) = (
                &mut solution.multipliers.terminal,
                &mut solution.slacks.terminal,
            );
            for unused in [&mut multipliers.x_min, &mut multipliers.x_max] {
                unused.fill(0.0);
            }
            for unused in [&mut slack.x_min, &mut slack.x_max] {
                unused.fill(0.0);
            }
        }
        self.write_fixed_multipliers(solution);
        self.write_terminal_set(solution);
        scale_multipliers(&mut solution.multipliers, self.cost_unit);
    }

    fn write_fixed_multipliers(&self, solution: &mut Solution<NX, NU>) {
        let stages = &mut solution.multipliers.stages;
        write_fixed::<NU>(&self.inputs, |k, i, low, high| {
            (stages[k].u_min[i], stages[k].u_max[i]) = (low, high);
        });
        write_fixed::<NU>(&self.rates, |k, i, low, high| {
            (stages[k].du_min[i], stages[k].du_max[i]) = (low, high);
        });
        let terminal = &mut solution.multipliers.terminal;
        write_fixed::<NX>(&self.states, |k, i, low, high| {
            if let Some(stage) = stages.get_mut(k + 1) {
                (stage.x_min[i], stage.x_max[i]) = (low, high);
            } else {
                (terminal.x_min[i], terminal.x_max[i]) = (low, high);
            }
        });
    }

    fn write_terminal_set(&self, solution: &mut Solution<NX, NU>) {
        let slack = &mut solution.slacks.terminal.set;
        match &mut solution.multipliers.terminal.set {
            TerminalSetMultipliers::None => {}
            TerminalSetMultipliers::Equality(to) => {
                for i in 0..NX {
                    let (low, high) = multipliers(&self.terminal, i);
                    to[i] = high - low;
                    if let TerminalSetSlacks::Equality(violation) = slack {
                        let lane = &self.terminal.sides[1][i / 4];
                        violation[i] =
                            lane.on[i % 4] * (self.terminal.v[i / 4][i % 4] - lane.bound[i % 4]);
                    }
                }
                for fixed in &self.terminal.fixed {
                    to[fixed.index] = fixed.y;
                }
            }
            TerminalSetMultipliers::Polytope(to) => {
                for (i, to) in to.iter_mut().enumerate() {
                    *to = multipliers(&self.terminal, i).1;
                    if let TerminalSetSlacks::Polytope(violations) = slack {
                        violations[i] = slacks(&self.terminal, i).1;
                    }
                }
            }
            TerminalSetMultipliers::Ellipsoid { radius, offset } => {
                if let Some(cone) = &self.cone {
                    let (head, tail) = cone.multiplier();
                    (*radius, *offset) = (head, tail.into());
                    if let TerminalSetSlacks::Ellipsoid(growth) = slack {
                        *growth = cone.growth();
                    }
                }
            }
        }
    }
}
