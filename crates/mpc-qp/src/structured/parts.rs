//! The Newton system taken apart once a pass, into slices as long as the horizon: what a stage reads of data, values and constraints, and
//! what the recursion leaves behind. Indexed stage by stage through the vectors, bounds checks and reloads were a fifth of a pass.

use super::channel::Channel;
use super::elimination::{Curvature, Value, eliminate};
use super::kernel::{Lanes, add_product, dot};
use super::newton::{Newton, RowData};
use super::riccati::{Gain, Stage, backward};

/// An array over the horizon, stage by stage.
#[inline(always)]
pub(super) fn by_stage<const M: usize>(values: &[[f64; 4]], n: usize) -> &[[f64; M]] {
    &values.as_flattened().as_chunks::<M>().0[..n]
}

/// The same, to write.
#[inline(always)]
pub(super) fn by_stage_mut<const M: usize>(values: &mut [[f64; 4]], n: usize) -> &mut [[f64; M]] {
    &mut values.as_flattened_mut().as_chunks_mut::<M>().0[..n]
}

/// Weights and forces of one kind of bounds.
struct Pull<'a, const M: usize> {
    weight: &'a [[f64; M]],
    force: &'a [[f64; M]],
}

impl<'a, const M: usize> Pull<'a, M> {
    #[inline(always)]
    fn of(channel: &'a Channel, n: usize) -> Self {
        Self {
            weight: by_stage(&channel.weight, n),
            force: by_stage(&channel.force, n),
        }
    }
}

/// What a pass reads.
pub(super) struct Data<'a, const NX: usize, const NU: usize> {
    stages: &'a [Stage<NX, NU>],
    x0: &'a [f64; NX],
    x: &'a [[f64; NX]],
    u: &'a [[f64; NU]],
    inputs: Pull<'a, NU>,
    rates: Pull<'a, NU>,
    /// Of the states 1..=N, if they have any.
    states: Option<Pull<'a, NX>>,
    row_start: &'a [usize],
    row_data: &'a [RowData<NX, NU>],
    row_weight: &'a [f64],
    row_force: &'a [f64],
    closed_loop: bool,
}

/// What a pass leaves behind.
pub(super) struct Recursion<'a, const NX: usize, const NU: usize> {
    /// Cost to go at each of 0..=N.
    pub(super) values: &'a mut [Value<NX, NU>],
    /// Factorised stages.
    pub(super) gains: &'a mut [Gain<NX, NU>],
    /// Feedforward inputs.
    pub(super) feedforward: &'a mut [[f64; NU]],
    /// Gradient of the cost without constraints.
    pub(super) gradient: &'a mut [([f64; NX], [f64; NU])],
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// The system as slices.
    #[inline(always)]
    pub(super) fn parts(&mut self) -> (Data<'_, NX, NU>, Recursion<'_, NX, NU>) {
        let n = self.n;
        let closed_loop = self.weighs_states() || self.stiff_end;
        let data = Data {
            stages: &self.stages[..n],
            x0: &self.x0,
            x: by_stage(&self.states.v, n),
            u: by_stage(&self.inputs.v, n),
            inputs: Pull::of(&self.inputs, n),
            rates: Pull::of(&self.rates, n),
            states: self.states.any().then(|| Pull::of(&self.states, n)),
            row_start: &self.row_start[..=n],
            row_data: &self.row_data,
            row_weight: self.rows.weight.as_flattened(),
            row_force: self.rows.force.as_flattened(),
            closed_loop,
        };
        let recursion = Recursion {
            values: &mut self.values[..=n],
            gains: &mut self.gains[..n],
            feedforward: &mut self.feedforward[..n],
            gradient: &mut self.gradient[..n],
        };
        (data, recursion)
    }
}

impl<const NX: usize, const NU: usize> Data<'_, NX, NU> {
    /// Stage k's dynamics and cost.
    #[inline(always)]
    pub(super) fn stage(&self, k: usize) -> &Stage<NX, NU> {
        &self.stages[k]
    }

    /// Forces of the rates at k.
    #[inline(always)]
    pub(super) fn rate_force(&self, k: usize) -> &[f64; NU] {
        &self.rates.force[k]
    }

    /// Cost gradient at stage k.
    #[inline(always)]
    pub(super) fn cost_gradient<L: Lanes>(&self, lanes: L, k: usize) -> ([f64; NX], [f64; NU]) {
        let stage = &self.stages[k];
        let x = if k == 0 { self.x0 } else { &self.x[k - 1] };
        let u = &self.u[k];
        let gx = add_product(lanes, &stage.q, x, &stage.qv);
        let gx = add_product(lanes, &stage.s, u, &gx);
        let mut gu = add_product(lanes, &stage.r, u, &stage.rv);
        for i in 0..NU {
            gu[i] += dot(lanes, &stage.s[i], x);
        }
        (gx, gu)
    }

    /// Adds the forces of input and state bounds and of the rows at k.
    #[inline(always)]
    pub(super) fn forces<L: Lanes>(
        &self,
        lanes: L,
        k: usize,
        gx: &mut [f64; NX],
        gu: &mut [f64; NU],
    ) {
        for i in 0..NU {
            gu[i] += self.inputs.force[k][i];
        }
        if k > 0
            && let Some(states) = &self.states
        {
            for i in 0..NX {
                gx[i] += states.force[k - 1][i];
            }
        }
        for i in self.row_start[k]..self.row_start[k + 1] {
            let force = [self.row_force[i]];
            *gx = add_product(lanes, &[self.row_data[i].gx], &force, gx);
            *gu = add_product(lanes, &[self.row_data[i].hu], &force, gu);
        }
    }

    /// Eliminates stage k: value at k and gain from the value at k+1.
    #[inline(always)]
    pub(super) fn eliminate<L: Lanes>(
        &self,
        lanes: L,
        k: usize,
        next: &Value<NX, NU>,
        found: (&mut Value<NX, NU>, &mut Gain<NX, NU>),
    ) {
        let stage = &self.stages[k];
        let (first, last) = (self.row_start[k], self.row_start[k + 1]);
        let (value, gain) = found;
        let (mut q, mut s, mut r);
        let mut cost = Curvature {
            q: &stage.q,
            s: &stage.s,
            r: &stage.r,
            u_weight: self.inputs.weight[k],
            rate_weight: self.rates.weight[k],
            closed_loop: self.closed_loop,
        };
        if first < last {
            (q, s, r) = (stage.q, stage.s, stage.r);
            for i in first..last {
                let RowData { gx, hu } = self.row_data[i];
                let weight = self.row_weight[i];
                for j in 0..NX {
                    q[j] = add_product(lanes, &[gx], &[weight * gx[j]], &q[j]);
                }
                for j in 0..NU {
                    s[j] = add_product(lanes, &[gx], &[weight * hu[j]], &s[j]);
                    r[j] = add_product(lanes, &[hu], &[weight * hu[j]], &r[j]);
                }
            }
            (cost.q, cost.s, cost.r) = (&q, &s, &r);
        }
        eliminate(lanes, stage, &cost, next, (value, gain));
        if k > 0
            && let Some(states) = &self.states
        {
            for i in 0..NX {
                value.xx[i][i] += states.weight[k - 1][i];
            }
        }
    }

    /// Backward step of a solve at k for the gradient of the cost: the feedforward input.
    #[inline(always)]
    pub(super) fn backward<L: Lanes>(
        &self,
        lanes: L,
        k: usize,
        (mut gx, mut gu): ([f64; NX], [f64; NU]),
        gain: &Gain<NX, NU>,
        costate: &mut ([f64; NX], [f64; NU]),
    ) -> [f64; NU] {
        self.forces(lanes, k, &mut gx, &mut gu);
        let gr = &self.rates.force[k];
        backward(lanes, &self.stages[k], gain, (&gx, &gu, gr), costate)
    }
}
