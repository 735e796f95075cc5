//! The Newton system of one iteration: sweeps over the stages that join Riccati recursion and constraints.
//!
//! The unknowns step from the present point. The states always satisfy the dynamics, so the step's dynamics are
//! homogeneous. Costates are not iterated: each solve yields them afresh, and the gradient is evaluated at the present point
//! in every iteration, so rounding in one step is corrected by the next, like iterative refinement.

use super::channel::Channel;
use super::cone::{Cone, Place};
use super::elimination::Value;
use super::riccati::{Gain, Stage};
use std::ops::RangeInclusive;

/// Distances of two bounds between which the solver's constants serve: at 1e-4 the barrier that is left at the end has been seen to move
/// inputs by a hundredth.
const ORDINARY_WIDTH: RangeInclusive<f64> = 0.0078125..=1024.0;

/// A general row's coefficients.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowData<const NX: usize, const NU: usize> {
    /// On the state (zero at stage 0, where the state is given).
    pub(super) gx: [f64; NX],
    /// On the input.
    pub(super) hu: [f64; NU],
}

/// What the factorisation at hand belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Factorised {
    /// Other data than the present.
    Stale,
    /// The present data and an ellipsoid that adds curvature.
    WithCone,
    /// The present data, and weights on nothing but the channels' values.
    Plain,
}

impl Factorised {
    /// Of the present data, with or without an ellipsoid that adds curvature.
    pub(super) fn of(with_cone: bool) -> Self {
        if with_cone {
            Self::WithCone
        } else {
            Self::Plain
        }
    }
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
    /// The kind of terminal set that the memory was made for.
    pub(super) set_kind: &'static str,
    /// The problem's cost over the cost in here, whose curvature in the inputs is about one.
    pub(super) cost_unit: f64,
    /// Cost to go at each of 0..=N as factorised.
    pub(super) values: Vec<Value<NX, NU>>,
    /// What the factorisation at hand belongs to.
    pub(super) factorised: Factorised,
    /// Whether the ellipsoid's weight at the end of the horizon calls for the closed-loop form.
    pub(super) stiff_end: bool,
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
pub(super) fn at<const M: usize>(values: &[[f64; 4]], k: usize) -> &[f64; M] {
    &values.as_flattened().as_chunks::<M>().0[k]
}

#[inline(always)]
fn at_mut<const M: usize>(values: &mut [[f64; 4]], k: usize) -> &mut [f64; M] {
    &mut values.as_flattened_mut().as_chunks_mut::<M>().0[k]
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// All channels.
    pub(super) fn channels(&mut self) -> [&mut Channel; 5] {
        [
            &mut self.inputs,
            &mut self.rates,
            &mut self.states,
            &mut self.rows,
            &mut self.terminal,
        ]
    }

    /// True if constraints put weights on states.
    #[inline(always)]
    pub(super) fn weighs_states(&self) -> bool {
        self.states.any() || self.rows.any() || self.terminal.any()
    }

    /// Whether the solver's constants may not suit the units: weights on states meet what inputs do to them, and gap, starting products and
    /// starting slacks count in the unit of cost and in widths. An ellipsoid alone has what is given as its only size.
    pub(super) fn depends_on_units(&self) -> bool {
        let ordinary = |width: f64| ORDINARY_WIDTH.contains(&width);
        let bounded = self.inputs.any() || self.rates.any();
        let far = |x: &f64| !ordinary(x.abs()) && *x != 0.0;
        self.weighs_states()
            || !(1e-6..=1e6).contains(&self.cost_unit)
            || !self
                .inputs
                .widths()
                .chain(self.rates.widths())
                .all(ordinary)
            || (!bounded && self.cone.is_some() && self.x0.iter().any(far))
    }

    /// How many of the first stages an active-set sweep has to factorise anew: those up to the last input or rate whose weight is not
    /// what it was in the factorisation at hand. What comes after them has not changed.
    pub(super) fn stages_to_factorise(&self) -> usize {
        let cone_is_free = self
            .cone
            .as_ref()
            .is_none_or(|cone| cone.place == Place::Inside);
        if self.factorised != Factorised::Plain || !cone_is_free || self.weighs_states() {
            return self.n;
        }
        let weights = self.inputs.reweighted.max(self.rates.reweighted);
        weights.div_ceil(NU).min(self.n)
    }

    /// Zero values and multipliers, after an iterate was lost.
    pub(super) fn reset(&mut self) {
        for channel in self.channels() {
            channel.reset();
        }
        if let Some(cone) = &mut self.cone {
            cone.reset();
        }
    }

    /// State at k, from 0 to N.
    #[inline(always)]
    pub(super) fn x(&self, k: usize) -> &[f64; NX] {
        if k == 0 {
            &self.x0
        } else {
            at(&self.states.v, k - 1)
        }
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
}
