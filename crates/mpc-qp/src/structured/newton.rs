//! The Newton system of one iteration: sweeps over the stages that join Riccati recursion and constraints.
//!
//! The unknowns step from the present point. The states always satisfy the dynamics, so the step's dynamics are
//! homogeneous. Costates are not iterated: each solve yields them afresh, and the gradient is evaluated at the present point
//! in every iteration, so rounding in one step is corrected by the next, like iterative refinement.

use super::active::Verdict;
use super::bounds::Reach;
use super::channel::Channel;
use super::cone::Cone;
use super::kernel::{Lanes, Phase, add_product, dot, larger};
use super::riccati::{Curvature, Gain, Stage, Value, backward, eliminate, forward};

/// A general row's coefficients.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowData<const NX: usize, const NU: usize> {
    /// On the state (zero at stage 0, where the state is given).
    pub(super) gx: [f64; NX],
    /// On the input.
    pub(super) hu: [f64; NU],
}

/// Problem data, iterate and direction.
#[derive(Clone, Debug)]
pub(super) struct Newton<const NX: usize, const NU: usize> {
    /// Horizon.
    pub(super) n: usize,
    /// Stage data.
    pub(super) stages: Vec<Stage<NX, NU>>,
    /// Terminal weight.
    pub(super) p: [[f64; NX]; NX],
    /// Linear terminal cost.
    pub(super) pv: [f64; NX],
    /// Given state.
    pub(super) x0: [f64; NX],
    /// Input applied last.
    pub(super) u_last: [f64; NU],
    /// Rows of all stages, stage by stage.
    pub(super) row_data: Vec<RowData<NX, NU>>,
    /// First row of each stage; N + 1 entries.
    pub(super) row_start: Vec<usize>,
    /// Coefficients of the terminal polytope or of the terminal equality.
    pub(super) faces: Vec<[f64; NX]>,
    /// Inputs and their bounds.
    pub(super) inputs: Channel,
    /// Rates.
    pub(super) rates: Channel,
    /// States 1..=N.
    pub(super) states: Channel,
    /// General rows.
    pub(super) rows: Channel,
    /// Terminal polytope or equality.
    pub(super) terminal: Channel,
    /// Terminal ellipsoid.
    pub(super) cone: Option<Cone<NX>>,
    /// The problem's cost over the cost in here, whose curvature in the inputs is about one.
    pub(super) cost_unit: f64,
    /// Factorised stages.
    pub(super) gains: Vec<Gain<NX, NU>>,
    /// Feedforward inputs of the last backward pass.
    pub(super) feedforward: Vec<[f64; NU]>,
    /// Gradient of the cost without constraints, with respect to x_k and u_k.
    pub(super) gradient: Vec<([f64; NX], [f64; NU])>,
    /// Gradient of the terminal cost.
    pub(super) terminal_gradient: [f64; NX],
}

/// Stage k's part of an array over the horizon.
#[inline(always)]
fn at<const M: usize>(values: &[[f64; 4]], k: usize) -> &[f64; M] {
    &values.as_flattened().as_chunks::<M>().0[k]
}

#[inline(always)]
fn at_mut<const M: usize>(values: &mut [[f64; 4]], k: usize) -> &mut [f64; M] {
    &mut values.as_flattened_mut().as_chunks_mut::<M>().0[k]
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// All channels.
    pub(super) fn channels(&mut self) -> [&mut Channel; 5] {
        [&mut self.inputs, &mut self.rates, &mut self.states, &mut self.rows, &mut self.terminal]
    }

    /// State at k, from 0 to N.
    #[inline(always)]
    pub(super) fn x(&self, k: usize) -> &[f64; NX] {
        if k == 0 { &self.x0 } else { at(&self.states.v, k - 1) }
    }

    /// Input at k.
    #[inline(always)]
    pub(super) fn u(&self, k: usize) -> &[f64; NU] {
        at(&self.inputs.v, k)
    }

    /// State to write, k from 1 to N.
    pub(super) fn x_mut(&mut self, k: usize) -> &mut [f64; NX] {
        at_mut(&mut self.states.v, k - 1)
    }

    /// Input to write.
    pub(super) fn u_mut(&mut self, k: usize) -> &mut [f64; NU] {
        at_mut(&mut self.inputs.v, k)
    }

    /// Rates, rows and terminal values from states and inputs; `step` does the same for their steps.
    #[inline(always)]
    pub(super) fn spread<L: Lanes>(&mut self, lanes: L, step: bool) {
        if !self.rows.any() && !self.terminal.any() {
            return;
        }
        let zero = [0.0; NX];
        for k in 0..self.n {
            let inputs = if step { &self.inputs.dv } else { &self.inputs.v };
            let states = if step { &self.states.dv } else { &self.states.v };
            let u: &[f64; NU] = at(inputs, k);
            let x: &[f64; NX] = if k == 0 { &zero } else { at(states, k - 1) };
            for i in self.row_start[k]..self.row_start[k + 1] {
                let row = &self.row_data[i];
                let value = dot(lanes, &row.gx, x) + dot(lanes, &row.hu, u);
                let rows = if step { &mut self.rows.dv } else { &mut self.rows.v };
                rows[i / 4][i % 4] = value;
            }
        }
        let states = if step { &self.states.dv } else { &self.states.v };
        let x: &[f64; NX] = at(states, self.n - 1);
        for (i, face) in self.faces.iter().enumerate() {
            let terminal = if step { &mut self.terminal.dv } else { &mut self.terminal.v };
            terminal[i / 4][i % 4] = dot(lanes, face, x);
        }
    }

    /// Force of state bounds, and of stage rows on the state and input at k.
    #[inline(always)]
    fn forces<L: Lanes>(&self, lanes: L, k: usize, gx: &mut [f64; NX], gu: &mut [f64; NU]) {
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
    fn terminal_force<L: Lanes>(&self, lanes: L) -> [f64; NX] {
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
    fn terminal_value<L: Lanes>(&self, lanes: L, costate: &mut [f64; NX]) -> Value<NX, NU> {
        let mut value = Value { xx: self.p, xp: [[0.0; NX]; NU], pp: [[0.0; NU]; NU] };
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
    fn cost_gradient<L: Lanes>(&self, lanes: L, k: usize) -> ([f64; NX], [f64; NU]) {
        let stage = &self.stages[k];
        let (x, u) = (self.x(k), self.u(k));
        let gx = add_product(lanes, &stage.s, u, &add_product(lanes, &stage.q, x, &stage.qv));
        let mut gu = add_product(lanes, &stage.r, u, &stage.rv);
        for i in 0..NU {
            gu[i] += dot(lanes, &stage.s[i], x);
        }
        (gx, gu)
    }
}

/// Factorises the system and does the backward pass for the channels' present forces.
pub(super) struct Factorise<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Weight of the held cone in an active-set sweep; none for the interior point's scaling.
    pub(super) omega: Option<f64>,
}

impl<const NX: usize, const NU: usize> Phase for Factorise<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let newton = self.newton;
        let mut costate = ([0.0; NX], [0.0; NU]);
        let x = *newton.x(newton.n);
        newton.terminal_gradient = add_product(lanes, &newton.p, &x, &newton.pv);
        let mut value = newton.terminal_value(lanes, &mut costate.0);
        if let Some(cone) = &mut newton.cone {
            match self.omega {
                None => cone.weigh(lanes, &mut value.xx, &mut costate.0),
                Some(omega) => cone.hold(lanes, &x, omega, Some(&mut value.xx), &mut costate.0),
            }
        }
        for k in (0..newton.n).rev() {
            let (gx, gu) = newton.cost_gradient(lanes, k);
            newton.gradient[k] = (gx, gu);
            newton.eliminate_stage(lanes, k, &mut value);
            newton.backward_stage(lanes, k, gx, gu, &mut costate);
        }
    }
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// Forward pass: the steps of all values.
    #[inline(always)]
    fn roll<L: Lanes>(&mut self, lanes: L) {
        let mut dx = [0.0; NX];
        let mut dp = [0.0; NU];
        for k in 0..self.n {
            let du = forward(lanes, &self.stages[k], &self.gains[k], &self.feedforward[k], &mut dx, &dp);
            *at_mut(&mut self.states.dv, k) = dx;
            *at_mut(&mut self.inputs.dv, k) = du;
            let rate: &mut [f64; NU] = at_mut(&mut self.rates.dv, k);
            for i in 0..NU {
                rate[i] = du[i] - dp[i];
            }
            dp = du;
        }
        self.spread(lanes, true);
    }

    #[inline(always)]
    fn eliminate_stage<L: Lanes>(&mut self, lanes: L, k: usize, value: &mut Value<NX, NU>) {
        let stage = &self.stages[k];
        let (u_weight, rate_weight) = (*at(&self.inputs.weight, k), *at(&self.rates.weight, k));
        let (first, last) = (self.row_start[k], self.row_start[k + 1]);
        if first == last {
            let cost = Curvature { q: &stage.q, s: &stage.s, r: &stage.r, u_weight, rate_weight };
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
            let cost = Curvature { q: &q, s: &s, r: &r, u_weight, rate_weight };
            eliminate(lanes, stage, &cost, value, &mut self.gains[k]);
        }
        if k > 0 && self.states.any() {
            let weight: &[f64; NX] = at(&self.states.weight, k - 1);
            for i in 0..NX {
                value.xx[i][i] += weight[i];
            }
        }
    }

    #[inline(always)]
    fn backward_stage<L: Lanes>(
        &mut self,
        lanes: L,
        k: usize,
        mut gx: [f64; NX],
        mut gu: [f64; NU],
        costate: &mut ([f64; NX], [f64; NU]),
    ) {
        self.forces(lanes, k, &mut gx, &mut gu);
        let gr: &[f64; NU] = at(&self.rates.force, k);
        self.feedforward[k] = backward(lanes, &self.stages[k], &self.gains[k], (&gx, &gu, gr), costate);
    }
}

/// Backward pass for new forces with the factorisation at hand.
pub(super) struct Backward<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Complementarity product that the corrector aims at.
    pub(super) target_mu: f64,
}

impl<const NX: usize, const NU: usize> Phase for Backward<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let newton = self.newton;
        for channel in newton.channels() {
            if channel.any() {
                channel.correct(lanes, self.target_mu);
            }
        }
        let mut costate = (newton.terminal_force(lanes), [0.0; NU]);
        if let Some(cone) = &mut newton.cone {
            cone.correct(lanes, self.target_mu, &mut costate.0);
        }
        for k in (0..newton.n).rev() {
            let (gx, gu) = newton.gradient[k];
            newton.backward_stage(lanes, k, gx, gu, &mut costate);
        }
    }
}

/// Forward pass: the step of every value, then of slacks and multipliers.
pub(super) struct Forward<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Whether this is the predictor.
    pub(super) affine: bool,
}

impl<const NX: usize, const NU: usize> Phase for Forward<'_, NX, NU> {
    type Output = Reach;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Reach {
        let newton = self.newton;
        newton.roll(lanes);
        let mut reach = Reach::FREE;
        for channel in newton.channels() {
            if channel.any() {
                reach = reach.and(if self.affine { channel.predict(lanes) } else { channel.aim(lanes) });
            }
        }
        if let Some(cone) = &mut newton.cone {
            reach = reach.and(cone.direction(lanes, at(&newton.states.dv, newton.n - 1)));
        }
        reach
    }
}

/// Turns the multipliers into a Farkas ray: costates by the plain adjoint recursion, what is left in an input absorbed by the
/// multiplier of its bound where that bound is finite, so that the ray is exact whenever the inputs are bounded.
pub(super) struct Ray<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Costates of the N dynamics.
    pub(super) costates: &'a mut [nalgebra::SVector<f64, NX>],
}

impl<const NX: usize, const NU: usize> Phase for Ray<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let newton = self.newton;
        for channel in newton.channels() {
            if channel.any() {
                channel.present();
            }
        }
        newton.terminal_gradient = [0.0; NX];
        let mut costate = newton.terminal_force(lanes);
        if let Some(cone) = &newton.cone {
            for (sum, force) in costate.iter_mut().zip(cone.force()) {
                *sum += force;
            }
        }
        for k in (0..newton.n).rev() {
            self.costates[k] = costate.into();
            let (mut gx, mut gu) = ([0.0; NX], [0.0; NU]);
            newton.forces(lanes, k, &mut gx, &mut gu);
            let pull = add_product(lanes, &newton.stages[k].bt, &costate, &gu);
            for i in 0..NU {
                let index = k * NU + i;
                let rate = newton.rates.force[index / 4][index % 4];
                let next = if k + 1 < newton.n { newton.rates.force[(index + NU) / 4][(index + NU) % 4] } else { 0.0 };
                newton.inputs.absorb(index, pull[i] + rate - next);
            }
            costate = add_product(lanes, &newton.stages[k].at, &costate, &gx);
        }
    }
}

/// Weights and forces of the active-set guess.
pub(super) struct HoldActive<'a, const NX: usize, const NU: usize>(pub(super) &'a mut Newton<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for HoldActive<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for channel in self.0.channels() {
            if channel.any() {
                channel.hold_active(lanes);
            }
        }
    }
}

/// Backward pass of an active-set sweep for the present forces at the present point, with the factorisation at hand.
pub(super) struct Resolve<'a, const NX: usize, const NU: usize>(pub(super) &'a mut Newton<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for Resolve<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let newton = self.0;
        let x = *newton.x(newton.n);
        newton.terminal_gradient = add_product(lanes, &newton.p, &x, &newton.pv);
        let mut costate = (newton.terminal_force(lanes), [0.0; NU]);
        if let Some(cone) = &mut newton.cone {
            cone.hold(lanes, &x, 0.0, None, &mut costate.0);
        }
        for k in (0..newton.n).rev() {
            let (gx, gu) = newton.cost_gradient(lanes, k);
            newton.backward_stage(lanes, k, gx, gu, &mut costate);
        }
    }
}

/// Forward pass that moves the values by the full step and judges the active-set guess.
pub(super) struct Settle<'a, const NX: usize, const NU: usize>(pub(super) &'a mut Newton<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for Settle<'_, NX, NU> {
    type Output = Verdict;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Verdict {
        let newton = self.0;
        newton.roll(lanes);
        let mut verdict = Verdict::default();
        for channel in newton.channels() {
            verdict = verdict.and(channel.settle(lanes));
        }
        if let Some(cone) = &mut newton.cone {
            verdict = verdict.and(cone.settle(at(&newton.states.v, newton.n - 1), at(&newton.states.dv, newton.n - 1)));
        }
        verdict
    }
}

/// Weights and predictor forces of all channels.
pub(super) struct Weigh<'a, const NX: usize, const NU: usize>(pub(super) &'a mut Newton<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for Weigh<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for channel in self.0.channels() {
            if channel.any() {
                channel.weigh(lanes);
            }
        }
    }
}

/// Costates at the present point and multipliers: the adjoint recursion, kept stable by the gains at hand.
///
/// Each stage's input residual is fed back through the gain, so it stays where it arises instead of growing
/// with the powers of an unstable A; the states' conditions miss by the gain times that residual.
pub(super) struct Costates<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Costates of the N dynamics.
    pub(super) costates: &'a mut [nalgebra::SVector<f64, NX>],
}

impl<const NX: usize, const NU: usize> Phase for Costates<'_, NX, NU> {
    /// Largest input residual, and the largest term that it should have cancelled.
    type Output = (f64, f64);
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> (f64, f64) {
        let newton = self.newton;
        let (mut residual, mut scale) = (0.0, 1.0);
        for channel in newton.channels() {
            if channel.any() {
                channel.present();
            }
        }
        newton.terminal_gradient = add_product(lanes, &newton.p, newton.x(newton.n), &newton.pv);
        let mut costate = (newton.terminal_force(lanes), [0.0; NU]);
        if let Some(cone) = &newton.cone {
            for (sum, force) in costate.0.iter_mut().zip(cone.force()) {
                *sum += force;
            }
        }
        for k in (0..newton.n).rev() {
            self.costates[k] = costate.0.into();
            let (mut gx, mut gu) = newton.cost_gradient(lanes, k);
            newton.forces(lanes, k, &mut gx, &mut gu);
            let gr: &[f64; NU] = at(&newton.rates.force, k);
            let next: [f64; NU] = if k + 1 < newton.n { *at(&newton.rates.force, k + 1) } else { [0.0; NU] };
            let pull = add_product(lanes, &newton.stages[k].bt, &costate.0, &[0.0; NU]);
            for i in 0..NU {
                residual = larger(residual, (gu[i] + gr[i] - next[i] + pull[i]).abs());
                scale = larger(scale, larger(gu[i].abs(), larger(pull[i].abs(), gr[i].abs())));
            }
            newton.feedforward[k] = backward(lanes, &newton.stages[k], &newton.gains[k], (&gx, &gu, gr), &mut costate);
        }
        (residual, scale)
    }
}

/// Solves the problem with the channels' weights and forces in absolute values, from the given state: the starting point.
///
/// Forces are gradients at zero values; the affine terms of the dynamics enter here and nowhere else.
pub(super) struct SolveAbsolute<'a, const NX: usize, const NU: usize>(pub(super) &'a mut Newton<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for SolveAbsolute<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let newton = self.0;
        let mut costate = ([0.0; NX], [0.0; NU]);
        newton.terminal_gradient = newton.pv;
        let mut value = newton.terminal_value(lanes, &mut costate.0);
        for k in (0..newton.n).rev() {
            let stage = &newton.stages[k];
            costate.0 = add_product(lanes, &value.xx, &stage.c, &costate.0);
            for i in 0..NU {
                costate.1[i] += dot(lanes, &value.xp[i], &stage.c);
            }
            let (gx, gu) = (stage.qv, stage.rv);
            newton.eliminate_stage(lanes, k, &mut value);
            newton.backward_stage(lanes, k, gx, gu, &mut costate);
        }
        let (mut x, mut p) = (newton.x0, newton.u_last);
        for k in 0..newton.n {
            let stage = &newton.stages[k];
            let u = forward(lanes, stage, &newton.gains[k], &newton.feedforward[k], &mut x, &p);
            for i in 0..NX {
                x[i] += stage.c[i];
            }
            *at_mut(&mut newton.states.v, k) = x;
            *at_mut(&mut newton.inputs.v, k) = u;
            let rate: &mut [f64; NU] = at_mut(&mut newton.rates.v, k);
            for i in 0..NU {
                rate[i] = u[i] - p[i];
            }
            p = u;
        }
        newton.spread(lanes, false);
    }
}

/// Moves along the direction; returns the sum of the complementarity products.
pub(super) struct Advance<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Step length.
    pub(super) alpha: f64,
}

impl<const NX: usize, const NU: usize> Phase for Advance<'_, NX, NU> {
    type Output = f64;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let mut gap = 0.0;
        for channel in self.newton.channels() {
            gap += channel.advance(lanes, self.alpha);
        }
        if let Some(cone) = &mut self.newton.cone {
            gap += cone.advance(self.alpha);
        }
        gap
    }
}
