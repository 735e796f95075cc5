//! The passes around the iterations: starting solve, active-set sweeps, costates, Farkas ray.

use super::active::Verdict;
use super::clipping::{Cuts, Limits};
use super::kernel::{Lanes, Phase, add_product, dot, larger};
use super::newton::{Factorised, Newton, at};
use super::parts::by_stage_mut;
use super::riccati::{backward, forward};

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
            newton.parts().0.forces(lanes, k, &mut gx, &mut gu);
            let pull = add_product(lanes, &newton.stages[k].bt, &costate, &gu);
            for i in 0..NU {
                let index = k * NU + i;
                let rate = newton.rates.force[index / 4][index % 4];
                let next = if k + 1 < newton.n {
                    newton.rates.force[(index + NU) / 4][(index + NU) % 4]
                } else {
                    0.0
                };
                newton.inputs.absorb(index, pull[i] + rate - next);
            }
            costate = add_product(lanes, &newton.stages[k].at, &costate, &gx);
        }
    }
}

/// Weights and forces of the active-set guess.
pub(super) struct HoldActive<'a, const NX: usize, const NU: usize>(
    pub(super) &'a mut Newton<NX, NU>,
);

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
        let (data, recursion) = newton.parts();
        for k in (0..recursion.gains.len()).rev() {
            let gradient = data.cost_gradient(lanes, k);
            recursion.feedforward[k] =
                data.backward(lanes, k, gradient, &recursion.gains[k], &mut costate);
        }
    }
}

/// Forward pass with clipped feedback that moves the values by the full step and judges the active-set guess.
pub(super) struct Settle<'a, const NX: usize, const NU: usize>(pub(super) &'a mut Newton<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for Settle<'_, NX, NU> {
    type Output = Verdict;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Verdict {
        let newton = self.0;
        let cut = newton.roll(lanes, true);
        let mut verdict = Verdict::default();
        for channel in newton.channels() {
            verdict = verdict.and(channel.settle(lanes));
        }
        if let Some(cone) = &mut newton.cone {
            verdict = verdict.and(cone.settle(
                lanes,
                at(&newton.states.v, newton.n - 1),
                at(&newton.states.dv, newton.n - 1),
                cut,
            ));
        }
        verdict
    }
}

/// Costates at the present point and multipliers: the adjoint recursion, plain or kept stable by the gains at hand.
///
/// Fed back through the gain, each stage's input residual stays where it arises instead of growing with the powers of an
/// unstable A, and the states' conditions miss by the gain times that residual. Without, they hold exactly.
pub(super) struct Costates<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Costates of the N dynamics.
    pub(super) costates: &'a mut [nalgebra::SVector<f64, NX>],
    /// Whether to feed the input residuals back.
    pub(super) feedback: bool,
}

impl<const NX: usize, const NU: usize> Phase for Costates<'_, NX, NU> {
    /// Largest input residual, and the largest term that it should have cancelled.
    type Output = (f64, f64);
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> (f64, f64) {
        let newton = self.newton;
        // The shared residuals are relative to at least one in the problem's unit of cost.
        let (mut residual, mut scale) = (0.0, newton.cost_unit.recip().min(1.0));
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
        let (data, recursion) = newton.parts();
        let n = recursion.gains.len();
        let mut next = [0.0; NU];
        for k in (0..n).rev() {
            self.costates[k] = costate.0.into();
            let (mut gx, mut gu) = data.cost_gradient(lanes, k);
            data.forces(lanes, k, &mut gx, &mut gu);
            let (stage, gr) = (data.stage(k), data.rate_force(k));
            let pull = add_product(lanes, &stage.bt, &costate.0, &[0.0; NU]);
            for i in 0..NU {
                residual = larger(residual, (gu[i] + gr[i] - next[i] + pull[i]).abs());
                scale = larger(
                    scale,
                    larger(gu[i].abs(), larger(pull[i].abs(), gr[i].abs())),
                );
            }
            next = *gr;
            if self.feedback {
                let gain = &recursion.gains[k];
                recursion.feedforward[k] =
                    backward(lanes, stage, gain, (&gx, &gu, gr), &mut costate);
            } else {
                costate.0 = add_product(lanes, &stage.at, &costate.0, &gx);
            }
        }
        (residual, scale)
    }
}

/// Solves the problem with the channels' weights and forces in absolute values, from the given state: the starting point.
///
/// Forces are gradients at zero values; the affine terms of the dynamics enter here and nowhere else.
pub(super) struct SolveAbsolute<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Whether the feedback is cut off at the limits of input and rate on the way forward; what was cut off becomes the guess of the
    /// active set.
    pub(super) clipped: bool,
}

impl<const NX: usize, const NU: usize> Phase for SolveAbsolute<'_, NX, NU> {
    /// What was cut off.
    type Output = Cuts;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Cuts {
        let newton = self.newton;
        let mut costate = ([0.0; NX], [0.0; NU]);
        newton.terminal_gradient = newton.pv;
        newton.values[newton.n] = newton.terminal_value(lanes, &mut costate.0);
        newton.factorised = Factorised::Plain;
        newton.stiff_end = false;
        let (data, recursion) = newton.parts();
        let n = recursion.gains.len();
        for k in (0..n).rev() {
            let (before, after) = recursion.values.split_at_mut(k + 1);
            let (stage, next) = (data.stage(k), &after[0]);
            costate.0 = add_product(lanes, &next.xx, &stage.c, &costate.0);
            for i in 0..NU {
                costate.1[i] += dot(lanes, &next.xp[i], &stage.c);
            }
            let gain = &mut recursion.gains[k];
            data.eliminate(lanes, k, next, (&mut before[k], gain));
            let gradient = (stage.qv, stage.rv);
            recursion.feedforward[k] = data.backward(lanes, k, gradient, gain, &mut costate);
        }
        let (mut x, mut p) = (newton.x0, newton.u_last);
        let mut cuts = Cuts::default();
        let mut limits = Limits {
            inputs: &mut newton.inputs.sides,
            rates: &mut newton.rates.sides,
        };
        let steps = newton.stages[..n].iter().zip(&newton.gains[..n]);
        let values = by_stage_mut::<NX>(&mut newton.states.v, n)
            .iter_mut()
            .zip(by_stage_mut::<NU>(&mut newton.inputs.v, n))
            .zip(by_stage_mut::<NU>(&mut newton.rates.v, n));
        let all = steps.zip(&newton.feedforward[..n]).zip(values);
        for (k, (((stage, gain), feedforward), values)) in all.enumerate() {
            let before = x;
            let mut u = forward(lanes, stage, gain, feedforward, &mut x, &p);
            if self.clipped && limits.clip(k, &mut u, &p, gain, Some(&mut cuts)) {
                let free = add_product(lanes, &stage.a, &before, &[0.0; NX]);
                x = add_product(lanes, &stage.b, &u, &free);
            }
            for i in 0..NX {
                x[i] += stage.c[i];
            }
            let ((state, input), rate) = values;
            (*state, *input) = (x, u);
            for i in 0..NU {
                rate[i] = u[i] - p[i];
            }
            p = u;
        }
        newton.spread(lanes, false);
        cuts
    }
}
