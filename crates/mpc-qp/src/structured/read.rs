//! From a guess in the caller's solution to an iterate: the warm start's inputs and multipliers.

use super::channel::Channel;
use super::kernel::{Lanes, Phase, add_product};
use super::newton::Newton;
use crate::multipliers::TerminalSetMultipliers;
use crate::solution::Solution;
use nalgebra::SVector;

fn read_pairs<const M: usize>(
    channel: &mut Channel,
    k: usize,
    lower: &SVector<f64, M>,
    upper: &SVector<f64, M>,
) {
    for i in 0..M {
        let index = k * M + i;
        channel.sides[0][index / 4].z[index % 4] = lower[i];
        channel.sides[1][index / 4].z[index % 4] = upper[i];
    }
}

fn read_fixed<const M: usize>(channel: &mut Channel, of: impl Fn(usize, usize) -> f64) {
    for fixed in &mut channel.fixed {
        fixed.y = of(fixed.index / M, fixed.index % M);
    }
}

/// Takes inputs and multipliers from a solution; the states follow from the given one.
pub(super) struct Read<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// The guess.
    pub(super) solution: &'a Solution<NX, NU>,
}

impl<const NX: usize, const NU: usize> Phase for Read<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { newton, solution } = self;
        let unit = newton.cost_unit;
        let mut x = newton.x0;
        let mut last = newton.u_last;
        let (states, rows) = (newton.states.any(), newton.rows.any());
        for k in 0..newton.n {
            let u: [f64; NU] = solution.u[k].into();
            let stage = &newton.stages[k];
            x = add_product(
                lanes,
                &stage.b,
                &u,
                &add_product(lanes, &stage.a, &x, &stage.c),
            );
            *newton.u_mut(k) = u;
            *newton.x_mut(k + 1) = x;
            for i in 0..NU {
                let index = k * NU + i;
                newton.rates.v[index / 4][index % 4] = u[i] - last[i];
            }
            last = u;
            let from = &solution.multipliers.stages[k];
            read_pairs(&mut newton.inputs, k, &from.u_min, &from.u_max);
            read_pairs(&mut newton.rates, k, &from.du_min, &from.du_max);
            if states && k > 0 {
                read_pairs(&mut newton.states, k - 1, &from.x_min, &from.x_max);
            }
            if rows {
                for (i, &z) in from.rows.iter().enumerate() {
                    let index = newton.row_start[k] + i;
                    newton.rows.sides[1][index / 4].z[index % 4] = z;
                }
            }
        }
        let from = &solution.multipliers.terminal;
        if states {
            read_pairs(&mut newton.states, newton.n - 1, &from.x_min, &from.x_max);
        }
        newton.spread(lanes, false);
        newton.read_equalities(solution);
        newton.read_terminal_set(&from.set);
        for channel in newton.channels() {
            channel.scale_multipliers(1.0 / unit);
            channel.guess_from_multipliers();
        }
    }
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    fn read_equalities(&mut self, solution: &Solution<NX, NU>) {
        let (stages, terminal) = (&solution.multipliers.stages, &solution.multipliers.terminal);
        read_fixed::<NU>(&mut self.inputs, |k, i| {
            stages[k].u_max[i] - stages[k].u_min[i]
        });
        read_fixed::<NU>(&mut self.rates, |k, i| {
            stages[k].du_max[i] - stages[k].du_min[i]
        });
        read_fixed::<NX>(&mut self.states, |k, i| match stages.get(k + 1) {
            Some(stage) => stage.x_max[i] - stage.x_min[i],
            None => terminal.x_max[i] - terminal.x_min[i],
        });
    }

    fn read_terminal_set(&mut self, set: &TerminalSetMultipliers<NX>) {
        let unit = self.cost_unit;
        match set {
            TerminalSetMultipliers::None => {}
            TerminalSetMultipliers::Equality(multiplier) => {
                read_fixed::<NX>(&mut self.terminal, |_, i| multiplier[i]);
                if self.terminal.used[0] {
                    let lower = multiplier.map(|z| (-z).max(0.0));
                    let upper = multiplier.map(|z| z.max(0.0));
                    read_pairs(&mut self.terminal, 0, &lower, &upper);
                }
            }
            TerminalSetMultipliers::Polytope(multipliers) => {
                for (i, &z) in multipliers.iter().enumerate() {
                    self.terminal.sides[1][i / 4].z[i % 4] = z;
                }
            }
            TerminalSetMultipliers::Ellipsoid { radius, .. } => {
                if let Some(cone) = &mut self.cone {
                    cone.guess(*radius / unit);
                }
            }
        }
    }
}
