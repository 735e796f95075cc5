//! Gradient of the Lagrangian of [`crate::Multipliers`], stage by stage, from the problem's own data.

use crate::multipliers::TerminalSetMultipliers;
use crate::problem::OcpQp;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::{SMatrix, SVector};

/// A sum of vectors with the largest term of each component.
pub(crate) struct Balance<const N: usize> {
    pub(crate) sum: SVector<f64, N>,
    pub(crate) scale: SVector<f64, N>,
    terms: Terms,
}

/// What counts as a term of a matrix-vector product.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Terms {
    /// The product: cheap, and smaller where its own summands cancel.
    Products,
    /// The sum of the magnitudes of its summands.
    Summands,
}

impl<const N: usize> Balance<N> {
    pub(crate) fn new(terms: Terms) -> Self {
        Self {
            sum: SVector::zeros(),
            scale: SVector::zeros(),
            terms,
        }
    }

    pub(crate) fn add(&mut self, term: SVector<f64, N>) {
        self.scale = self.scale.sup(&term.abs());
        self.sum += term;
    }

    pub(crate) fn add_product<const M: usize>(
        &mut self,
        matrix: &SMatrix<f64, N, M>,
        vector: &SVector<f64, M>,
    ) {
        self.add(matrix * vector);
        if self.terms == Terms::Summands {
            self.scale = self.scale.sup(&(matrix.abs() * vector.abs()));
        }
    }

    fn add_transposed<const M: usize>(
        &mut self,
        matrix: &SMatrix<f64, M, N>,
        vector: &SVector<f64, M>,
    ) {
        self.add(matrix.tr_mul(vector));
        if self.terms == Terms::Summands {
            self.scale = self.scale.sup(&matrix.abs().tr_mul(&vector.abs()));
        }
    }
}

/// Gradient of the Lagrangian, or without cost of the constraints alone (for certificates).
pub(crate) struct LagrangianGradient<'a, const NX: usize, const NU: usize> {
    pub(crate) problem: &'a OcpQp<NX, NU>,
    pub(crate) solution: &'a Solution<NX, NU>,
    pub(crate) with_cost: bool,
    pub(crate) terms: Terms,
}

impl<'a, const NX: usize, const NU: usize> LagrangianGradient<'a, NX, NU> {
    /// What the constraints alone contribute.
    pub(crate) fn of_constraints(
        problem: &'a OcpQp<NX, NU>,
        solution: &'a Solution<NX, NU>,
    ) -> Self {
        Self {
            problem,
            solution,
            with_cost: false,
            terms: Terms::Products,
        }
    }

    /// With respect to `u_k`, k from 0 to N - 1.
    pub(crate) fn input(&self, k: usize) -> Balance<NU> {
        let (stage, multipliers) = (
            &self.problem.stages()[k],
            &self.solution.multipliers.stages[k],
        );
        let mut balance = Balance::new(self.terms);
        if self.with_cost {
            balance.add_product(&stage.r, &self.solution.u[k]);
            balance.add_transposed(&stage.s, &self.solution.x[k]);
            balance.add(stage.r_linear);
        }
        balance.add_transposed(&stage.b, &self.solution.multipliers.costates[k]);
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
        let mut balance = Balance::new(self.terms);
        balance.add(-costates[k - 1]);
        let Some(stage) = self.problem.stages().get(k) else {
            self.add_terminal_state(&mut balance);
            return balance;
        };
        let multipliers = &self.solution.multipliers.stages[k];
        if self.with_cost {
            balance.add_product(&stage.q, &self.solution.x[k]);
            balance.add_product(&stage.s, &self.solution.u[k]);
            balance.add(stage.q_linear);
        }
        balance.add_transposed(&stage.a, &costates[k]);
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
            balance.add_product(&terminal.p, &self.solution.x[self.problem.horizon()]);
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
                    balance.add_product(cone.factor, &-offset);
                }
            }
            _ => {}
        }
    }
}
