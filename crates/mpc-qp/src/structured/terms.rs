//! What constraints and cost add to a stage: values and their steps, gradients, weights; and a stage's step in the recursion.

use super::elimination::{Curvature, Value, eliminate};
use super::kernel::{Lanes, add_product, dot};
use super::newton::{Newton, RowData, at, at_mut};
use super::riccati::{backward, forward};

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

    /// Force of state bounds, and of stage rows on the state and input at k.
    #[inline(always)]
    pub(super) fn forces<L: Lanes>(
        &self,
        lanes: L,
        k: usize,
        gx: &mut [f64; NX],
        gu: &mut [f64; NU],
    ) {
        let input: &[f64; NU] = at(&self.inputs.force, k);
        for i in 0..NU {
            gu[i] += input[i];
        }
        if k > 0 && self.states.any() {
            let state: &[f64; NX] = at(&self.states.force, k - 1);
            for i in 0..NX {
                gx[i] += state[i];
            }
        }
        for i in self.row_start[k]..self.row_start[k + 1] {
            let force = [self.rows.force[i / 4][i % 4]];
            *gx = add_product(lanes, &[self.row_data[i].gx], &force, gx);
            *gu = add_product(lanes, &[self.row_data[i].hu], &force, gu);
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

    /// Cost gradient at stage k.
    #[inline(always)]
    pub(super) fn cost_gradient<L: Lanes>(&self, lanes: L, k: usize) -> ([f64; NX], [f64; NU]) {
        let stage = &self.stages[k];
        let (x, u) = (self.x(k), self.u(k));
        let gx = add_product(
            lanes,
            &stage.s,
            u,
            &add_product(lanes, &stage.q, x, &stage.qv),
        );
        let mut gu = add_product(lanes, &stage.r, u, &stage.rv);
        for i in 0..NU {
            gu[i] += dot(lanes, &stage.s[i], x);
        }
        (gx, gu)
    }

    /// Forward pass: the steps of all values. With `clipped` the feedback of the inputs that the active-set guess leaves free is cut off
    /// at their limits; true if any was.
    #[inline(always)]
    pub(super) fn roll<L: Lanes>(&mut self, lanes: L, clipped: bool) -> bool {
        let mut cut = false;
        let mut dx = [0.0; NX];
        let mut dp = [0.0; NU];
        for k in 0..self.n {
            let before = dx;
            let mut du = forward(
                lanes,
                &self.stages[k],
                &self.gains[k],
                &self.feedforward[k],
                &mut dx,
                &dp,
            );
            if clipped {
                let last = if k == 0 { self.u_last } else { *self.u(k - 1) };
                let (mut u, mut p) = (*self.u(k), dp);
                for i in 0..NU {
                    u[i] += du[i];
                    p[i] += last[i];
                }
                if self.clip(k, &mut u, &p, None) {
                    cut = true;
                    for i in 0..NU {
                        du[i] = u[i] - self.u(k)[i];
                    }
                    let stage = &self.stages[k];
                    let free = add_product(lanes, &stage.a, &before, &[0.0; NX]);
                    dx = add_product(lanes, &stage.b, &du, &free);
                }
            }
            *at_mut(&mut self.states.dv, k) = dx;
            *at_mut(&mut self.inputs.dv, k) = du;
            let rate: &mut [f64; NU] = at_mut(&mut self.rates.dv, k);
            for i in 0..NU {
                rate[i] = du[i] - dp[i];
            }
            dp = du;
        }
        self.spread(lanes, true);
        cut
    }

    #[inline(always)]
    pub(super) fn eliminate_stage<L: Lanes>(
        &mut self,
        lanes: L,
        k: usize,
        value: &mut Value<NX, NU>,
    ) {
        let stage = &self.stages[k];
        let (u_weight, rate_weight) = (*at(&self.inputs.weight, k), *at(&self.rates.weight, k));
        let (first, last) = (self.row_start[k], self.row_start[k + 1]);
        let weights_on_states = self.weighs_states() || self.stiff_end;
        if first == last {
            let cost = Curvature {
                q: &stage.q,
                s: &stage.s,
                r: &stage.r,
                u_weight,
                rate_weight,
                closed_loop: weights_on_states,
            };
            eliminate(lanes, stage, &cost, value, &mut self.gains[k]);
        } else {
            let (mut q, mut s, mut r) = (stage.q, stage.s, stage.r);
            for i in first..last {
                let RowData { gx, hu } = self.row_data[i];
                let weight = self.rows.weight[i / 4][i % 4];
                for j in 0..NX {
                    q[j] = add_product(lanes, &[gx], &[weight * gx[j]], &q[j]);
                }
                for j in 0..NU {
                    s[j] = add_product(lanes, &[gx], &[weight * hu[j]], &s[j]);
                    r[j] = add_product(lanes, &[hu], &[weight * hu[j]], &r[j]);
                }
            }
            let cost = Curvature {
                q: &q,
                s: &s,
                r: &r,
                u_weight,
                rate_weight,
                closed_loop: weights_on_states,
            };
            eliminate(lanes, stage, &cost, value, &mut self.gains[k]);
        }
        if k > 0 && self.states.any() {
            let weight: &[f64; NX] = at(&self.states.weight, k - 1);
            for i in 0..NX {
                value.xx[i][i] += weight[i];
            }
        }
        self.values[k] = *value;
    }

    #[inline(always)]
    pub(super) fn backward_stage<L: Lanes>(
        &mut self,
        lanes: L,
        k: usize,
        mut gx: [f64; NX],
        mut gu: [f64; NU],
        costate: &mut ([f64; NX], [f64; NU]),
    ) {
        self.forces(lanes, k, &mut gx, &mut gu);
        let gr: &[f64; NU] = at(&self.rates.force, k);
        self.feedforward[k] = backward(
            lanes,
            &self.stages[k],
            &self.gains[k],
            (&gx, &gu, gr),
            costate,
        );
    }
}
