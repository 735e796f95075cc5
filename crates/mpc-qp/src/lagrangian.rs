//! Gradient of the Lagrangian of [`crate::Multipliers`], stage by stage, from the problem's own data.

use crate::multipliers::TerminalSetMultipliers;
use crate::problem::OcpQp;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// A sum of vectors with the largest entry met in any of them.
pub(crate) struct Balance<const N: usize> {
    pub(crate) sum: SVector<f64, N>,
    pub(crate) scale: f64,
}

impl<const N: usize> Balance<N> {
    fn zero() -> Self {
        Self {
            sum: SVector::zeros(),
            scale: 0.0,
        }
    }

    fn add(&mut self, term: SVector<f64, N>) {
        self.scale = self.scale.max(term.amax());
        self.sum += term;
    }
}

/// Gradient of the Lagrangian, or without cost of the constraints alone (for certificates).
pub(crate) struct LagrangianGradient<'a, const NX: usize, const NU: usize> {
    pub(crate) problem: &'a OcpQp<NX, NU>,
    pub(crate) solution: &'a Solution<NX, NU>,
    pub(crate) with_cost: bool,
}

impl<const NX: usize, const NU: usize> LagrangianGradient<'_, NX, NU> {
    /// With respect to `u_k`, k from 0 to N - 1.
    pub(crate) fn input(&self, k: usize) -> Balance<NU> {
        let (stage, multipliers) = (
            &self.problem.stages()[k],
            &self.solution.multipliers.stages[k],
        );
        let mut balance = Balance::zero();
        if self.with_cost {
            balance.add(stage.r * self.solution.u[k]);
            balance.add(stage.s.tr_mul(&self.solution.x[k]));
            balance.add(stage.r_linear);
        }
        balance.add(stage.b.tr_mul(&self.solution.multipliers.costates[k]));
        balance.add(multipliers.u_max - multipliers.u_min);
        balance.add(multipliers.du_max - multipliers.du_min);
        if let Some(next) = self.solution.multipliers.stages.get(k + 1) {
            balance.add(next.du_min - next.du_max);
        }
        for (row, &multiplier) in stage.rows.iter().zip(&multipliers.rows) {
            balance.add(row.h_u * multiplier);
        }
        balance
    }

    /// With respect to `x_k`, k from 1 to N.
    pub(crate) fn state(&self, k: usize) -> Balance<NX> {
        let costates = &self.solution.multipliers.costates;
        let mut balance = Balance::zero();
        balance.add(-costates[k - 1]);
        let Some(stage) = self.problem.stages().get(k) else {
            self.add_terminal_state(&mut balance);
            return balance;
        };
        let multipliers = &self.solution.multipliers.stages[k];
        if self.with_cost {
            balance.add(stage.q * self.solution.x[k]);
            balance.add(stage.s * self.solution.u[k]);
            balance.add(stage.q_linear);
        }
        balance.add(stage.a.tr_mul(&costates[k]));
        balance.add(multipliers.x_max - multipliers.x_min);
        for (row, &multiplier) in stage.rows.iter().zip(&multipliers.rows) {
            balance.add(row.g_x * multiplier);
        }
        balance
    }

    fn add_terminal_state(&self, balance: &mut Balance<NX>) {
        let (terminal, multipliers) =
            (self.problem.terminal(), &self.solution.multipliers.terminal);
        if self.with_cost {
            balance.add(terminal.p * self.solution.x[self.problem.horizon()]);
            balance.add(terminal.p_linear);
        }
        balance.add(multipliers.x_max - multipliers.x_min);
        match (&terminal.set, &multipliers.set) {
            (_, TerminalSetMultipliers::Equality(multiplier)) => balance.add(*multiplier),
            (TerminalSet::Polytope { faces }, TerminalSetMultipliers::Polytope(multipliers)) => {
                for (face, &multiplier) in faces.iter().zip(multipliers) {
                    balance.add(face.normal * multiplier);
                }
            }
            (_, TerminalSetMultipliers::Ellipsoid { offset, .. }) => {
                if let Some(cone) = self.problem.terminal_cone() {
                    balance.add(-(cone.factor * offset));
                }
            }
            _ => {}
        }
    }
}
