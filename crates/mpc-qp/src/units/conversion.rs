//! Problems and solutions from given units to chosen ones and back. All factors are powers of two, so no digit changes.

use super::Units;
use crate::multipliers::{StageMultipliers, TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::{Penalty, Softening};
use crate::solution::Solution;
use crate::stage::Stage;
use crate::terminal::{Terminal, TerminalSet};
use nalgebra::{SMatrix, SVector};

/// `left_i m_ij right_j`.
fn between<const M: usize, const N: usize>(
    left: &SVector<f64, M>,
    matrix: &SMatrix<f64, M, N>,
    right: &SVector<f64, N>,
) -> SMatrix<f64, M, N> {
    SMatrix::from_fn(|i, j| left[i] * matrix[(i, j)] * right[j])
}

/// A price in which the unit of violation is `unit`.
fn priced(penalty: Penalty, cost: f64, unit: f64) -> Penalty {
    match penalty {
        Penalty::Hard => Penalty::Hard,
        Penalty::Exact { weight } => Penalty::Exact {
            weight: cost * weight * unit,
        },
        Penalty::Quadratic { weight } => Penalty::Quadratic {
            weight: cost * weight * unit * unit,
        },
    }
}

impl<const NX: usize, const NU: usize> Units<NX, NU> {
    /// Writes `from` in these units into `to`, a problem of the same structure.
    pub(super) fn convert_problem(&self, from: &OcpQp<NX, NU>, to: &mut OcpQp<NX, NU>) {
        let inverse = self.state.map(f64::recip);
        to.initial_state = from.initial_state.component_mul(&inverse);
        to.previous_input = from.previous_input.component_div(&self.input);
        let mut factors = self.rows.iter();
        for (from, to) in from.stages.iter().zip(&mut to.stages) {
            self.convert_stage(&inverse, from, to);
            for ((from, to), factor) in from.rows.iter().zip(&mut to.rows).zip(&mut factors) {
                to.g_x = from.g_x.component_mul(&self.state) * *factor;
                to.h_u = from.h_u.component_mul(&self.input) * *factor;
                to.upper = from.upper * factor;
            }
        }
        self.convert_terminal(&inverse, &from.terminal, &mut to.terminal);
        to.shape_factor = SMatrix::from_fn(|i, j| self.state[i] * from.shape_factor[(i, j)]);
        let unit_of_set = match from.terminal.set {
            TerminalSet::Equality { .. } => self.state[0],
            _ => 1.0,
        };
        to.softening = Softening {
            state_bounds: priced(from.softening.state_bounds, self.cost, self.state[0]),
            rows: priced(from.softening.rows, self.cost, 1.0),
            terminal_set: priced(from.softening.terminal_set, self.cost, unit_of_set),
        };
    }

    fn convert_stage(
        &self,
        inverse: &SVector<f64, NX>,
        from: &Stage<NX, NU>,
        to: &mut Stage<NX, NU>,
    ) {
        let (state, input) = (&self.state, &self.input);
        to.a = between(inverse, &from.a, state);
        to.b = between(inverse, &from.b, input);
        to.c = from.c.component_mul(inverse);
        to.q = between(state, &from.q, state) * self.cost;
        to.r = between(input, &from.r, input) * self.cost;
        to.s = between(state, &from.s, input) * self.cost;
        to.q_linear = from.q_linear.component_mul(state) * self.cost;
        to.r_linear = from.r_linear.component_mul(input) * self.cost;
        to.u_min = from.u_min.component_div(input);
        to.u_max = from.u_max.component_div(input);
        to.du_min = from.du_min.component_div(input);
        to.du_max = from.du_max.component_div(input);
        to.x_min = from.x_min.component_mul(inverse);
        to.x_max = from.x_max.component_mul(inverse);
    }

    fn convert_terminal(
        &self,
        inverse: &SVector<f64, NX>,
        from: &Terminal<NX>,
        to: &mut Terminal<NX>,
    ) {
        let state = &self.state;
        to.p = between(state, &from.p, state) * self.cost;
        to.p_linear = from.p_linear.component_mul(state) * self.cost;
        to.x_min = from.x_min.component_mul(inverse);
        to.x_max = from.x_max.component_mul(inverse);
        match (&from.set, &mut to.set) {
            (TerminalSet::Equality { target: from }, TerminalSet::Equality { target }) => {
                *target = from.component_mul(inverse);
            }
            (TerminalSet::Polytope { faces: from }, TerminalSet::Polytope { faces }) => {
                for ((from, to), factor) in from.iter().zip(faces).zip(&self.faces) {
                    to.normal = from.normal.component_mul(state) * *factor;
                    to.upper = from.upper * factor;
                }
            }
            (
                TerminalSet::Ellipsoid {
                    shape: from,
                    center: from_center,
                    level: from_level,
                },
                TerminalSet::Ellipsoid {
                    shape,
                    center,
                    level,
                },
            ) => {
                *shape = between(state, from, state);
                *center = from_center.component_mul(inverse);
                *level = *from_level;
            }
            _ => {}
        }
    }

    /// Becomes the way back from `units`, in place.
    pub(super) fn undo(&mut self, units: &Self) {
        self.state = units.state.map(f64::recip);
        self.input = units.input.map(f64::recip);
        self.cost = units.cost.recip();
        let factors = self.rows.iter_mut().chain(&mut self.faces);
        for (to, from) in factors.zip(units.rows.iter().chain(&units.faces)) {
            *to = from.recip();
        }
    }

    /// Writes trajectory, multipliers and slacks of `from` in these units into `to`, a solution of the same shape.
    pub(crate) fn convert_solution(&self, from: &Solution<NX, NU>, to: &mut Solution<NX, NU>) {
        let (state, input, cost) = (&self.state, &self.input, self.cost);
        for (from, to) in from.x.iter().zip(&mut to.x) {
            *to = from.component_div(state);
        }
        for (from, to) in from.u.iter().zip(&mut to.u) {
            *to = from.component_div(input);
        }
        let (multipliers, slacks) = (&mut to.multipliers, &mut to.slacks);
        for (from, to) in from
            .multipliers
            .costates
            .iter()
            .zip(&mut multipliers.costates)
        {
            *to = from.component_mul(state) * cost;
        }
        let mut factors = self.rows.iter();
        let stages = from.multipliers.stages.iter().zip(&from.slacks.stages);
        let converted = multipliers.stages.iter_mut().zip(&mut slacks.stages);
        for ((from, from_slacks), (to, slacks)) in stages.zip(converted) {
            self.convert_multipliers(from, to);
            slacks.x_min = from_slacks.x_min.component_div(state);
            slacks.x_max = from_slacks.x_max.component_div(state);
            for (i, factor) in (&mut factors).take(from.rows.len()).enumerate() {
                to.rows[i] = from.rows[i] * cost / factor;
                slacks.rows[i] = from_slacks.rows[i] * factor;
            }
        }
        let terminal = &from.multipliers.terminal;
        multipliers.terminal.x_min = terminal.x_min.component_mul(state) * cost;
        multipliers.terminal.x_max = terminal.x_max.component_mul(state) * cost;
        self.convert_set_multipliers(&terminal.set, &mut multipliers.terminal.set);
        let terminal = &from.slacks.terminal;
        slacks.terminal.x_min = terminal.x_min.component_div(state);
        slacks.terminal.x_max = terminal.x_max.component_div(state);
        match (&terminal.set, &mut slacks.terminal.set) {
            (TerminalSetSlacks::Equality(from), TerminalSetSlacks::Equality(to)) => {
                *to = from.component_div(state);
            }
            (TerminalSetSlacks::Polytope(from), TerminalSetSlacks::Polytope(to)) => {
                let values = from.iter().zip(to).zip(&self.faces);
                values.for_each(|((from, to), factor)| *to = from * factor);
            }
            (TerminalSetSlacks::Ellipsoid(from), TerminalSetSlacks::Ellipsoid(to)) => *to = *from,
            _ => {}
        }
    }

    fn convert_multipliers(
        &self,
        from: &StageMultipliers<NX, NU>,
        to: &mut StageMultipliers<NX, NU>,
    ) {
        let of_input = |from: &SVector<f64, NU>| from.component_mul(&self.input) * self.cost;
        to.u_min = of_input(&from.u_min);
        to.u_max = of_input(&from.u_max);
        to.du_min = of_input(&from.du_min);
        to.du_max = of_input(&from.du_max);
        to.x_min = from.x_min.component_mul(&self.state) * self.cost;
        to.x_max = from.x_max.component_mul(&self.state) * self.cost;
    }

    fn convert_set_multipliers(
        &self,
        from: &TerminalSetMultipliers<NX>,
        to: &mut TerminalSetMultipliers<NX>,
    ) {
        match (from, to) {
            (TerminalSetMultipliers::Equality(from), TerminalSetMultipliers::Equality(to)) => {
                *to = from.component_mul(&self.state) * self.cost;
            }
            (TerminalSetMultipliers::Polytope(from), TerminalSetMultipliers::Polytope(to)) => {
                let values = from.iter().zip(to).zip(&self.faces);
                values.for_each(|((from, to), factor)| *to = from * self.cost / factor);
            }
            (
                TerminalSetMultipliers::Ellipsoid {
                    radius: from_radius,
                    offset: from_offset,
                },
                TerminalSetMultipliers::Ellipsoid { radius, offset },
            ) => {
                *radius = from_radius * self.cost;
                *offset = from_offset * self.cost;
            }
            _ => {}
        }
    }
}
