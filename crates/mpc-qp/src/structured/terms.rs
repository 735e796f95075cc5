//! What constraints and cost add at the end of the horizon, and the forward pass: values of states and inputs, of rates and rows.

use super::clipping::Limits;
use super::elimination::Value;
use super::kernel::{Lanes, add_product, dot};
use super::newton::{Newton, at};
use super::parts::{by_stage, by_stage_mut};
use super::riccati::forward;

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// Rates, rows and terminal values from states and inputs; `step` does the same for their steps.
    #[inline(always)]
    pub(super) fn spread<L: Lanes>(&mut self, lanes: L, step: bool) {
        if !self.rows.any() && !self.terminal.any() {
            return;
        }
        let zero = [0.0; NX];
        for k in 0..self.n {
            let inputs = if step {
                &self.inputs.dv
            } else {
                &self.inputs.v
            };
            let states = if step {
                &self.states.dv
            } else {
                &self.states.v
            };
            let u: &[f64; NU] = at(inputs, k);
            let x: &[f64; NX] = if k == 0 { &zero } else { at(states, k - 1) };
            for i in self.row_start[k]..self.row_start[k + 1] {
                let row = &self.row_data[i];
                let value = dot(lanes, &row.gx, x) + dot(lanes, &row.hu, u);
                let rows = if step {
                    &mut self.rows.dv
                } else {
                    &mut self.rows.v
                };
                rows[i / 4][i % 4] = value;
            }
        }
        let states = if step {
            &self.states.dv
        } else {
            &self.states.v
        };
        let x: &[f64; NX] = at(states, self.n - 1);
        for (i, face) in self.faces.iter().enumerate() {
            let terminal = if step {
                &mut self.terminal.dv
            } else {
                &mut self.terminal.v
            };
            terminal[i / 4][i % 4] = dot(lanes, face, x);
        }
    }

    /// Gradient at x_N: cost, bounds, faces; the cone is added by its owner.
    #[inline(always)]
    pub(super) fn terminal_force<L: Lanes>(&self, lanes: L) -> [f64; NX] {
        let mut g = self.terminal_gradient;
        if self.states.any() {
            let force: &[f64; NX] = at(&self.states.force, self.n - 1);
            for i in 0..NX {
                g[i] += force[i];
            }
        }
        for (i, face) in self.faces.iter().enumerate() {
            g = add_product(lanes, &[*face], &[self.terminal.force[i / 4][i % 4]], &g);
        }
        g
    }

    #[inline(always)]
    pub(super) fn terminal_value<L: Lanes>(
        &self,
        lanes: L,
        costate: &mut [f64; NX],
    ) -> Value<NX, NU> {
        let mut value = Value {
            xx: self.p,
            xp: [[0.0; NX]; NU],
            pp: [[0.0; NU]; NU],
        };
        *costate = self.terminal_force(lanes);
        if self.states.any() {
            let weight: &[f64; NX] = at(&self.states.weight, self.n - 1);
            for i in 0..NX {
                value.xx[i][i] += weight[i];
            }
        }
        for (i, face) in self.faces.iter().enumerate() {
            let weight = self.terminal.weight[i / 4][i % 4];
            for j in 0..NX {
                value.xx[j] = add_product(lanes, &[*face], &[weight * face[j]], &value.xx[j]);
            }
        }
        value
    }

    /// Forward pass: the steps of all values. With `clipped` the feedback of the inputs that the active-set guess leaves free is cut off
    /// at their limits; true if any was.
    #[inline(always)]
    pub(super) fn roll<L: Lanes>(&mut self, lanes: L, clipped: bool) -> bool {
        let n = self.n;
        let stages = self.stages[..n].iter().zip(&self.gains[..n]);
        let mut limits = Limits {
            inputs: &mut self.inputs.sides,
            rates: &mut self.rates.sides,
        };
        let u = by_stage::<NU>(&self.inputs.v, n);
        let steps = by_stage_mut::<NX>(&mut self.states.dv, n)
            .iter_mut()
            .zip(by_stage_mut::<NU>(&mut self.inputs.dv, n))
            .zip(by_stage_mut::<NU>(&mut self.rates.dv, n));
        let mut cut = false;
        let (mut dx, mut dp, mut last) = ([0.0; NX], [0.0; NU], &self.u_last);
        let all = stages.zip(&self.feedforward[..n]).zip(steps).zip(u);
        for (k, ((((stage, gain), feedforward), steps), u)) in all.enumerate() {
            let before = dx;
            let mut du = forward(lanes, stage, gain, feedforward, &mut dx, &dp);
            if clipped {
                let (mut to, mut from) = (*u, dp);
                for i in 0..NU {
                    to[i] += du[i];
                    from[i] += last[i];
                }
                if limits.clip(k, &mut to, &from, gain, None) {
                    cut = true;
                    for i in 0..NU {
                        du[i] = to[i] - u[i];
                    }
                    let free = add_product(lanes, &stage.a, &before, &[0.0; NX]);
                    dx = add_product(lanes, &stage.b, &du, &free);
                }
                last = u;
            }
            let ((state, input), rate) = steps;
            (*state, *input) = (dx, du);
            for i in 0..NU {
                rate[i] = du[i] - dp[i];
            }
            dp = du;
        }
        self.spread(lanes, true);
        cut
    }
}
