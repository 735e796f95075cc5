//! The passes of an interior-point iteration: weights, factorisation, corrector, direction, step.

use super::bounds::Reach;
use super::cone::Place;
use super::kernel::{Lanes, Phase, add_product};
use super::newton::{Factorised, Newton, at};
use super::penalty::Penalty;

/// Weight of the ellipsoid on a state, in units of the terminal cost's (of the inputs' where there is none), from which the textbook form loses too many digits.
const STIFF: f64 = 1e4;

/// Factorises the system and does the backward pass for the channels' present forces.
pub(super) struct Factorise<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// What the terminal ellipsoid adds.
    pub(super) cone: ConeTerm,
}

/// The ellipsoid's part in the Newton system.
#[derive(Clone, Copy, Debug)]
pub(super) enum ConeTerm {
    /// The interior point's scaling.
    Scaling,
    /// The boundary held with this weight, in an active-set sweep.
    Held(f64),
    /// The augmented Lagrangian of the careful pass.
    Penalty(Penalty),
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
        let (mut changed, mut with_cone) = (newton.n, newton.cone.is_some());
        if let ConeTerm::Held(_) = self.cone {
            changed = newton.stages_to_factorise();
            with_cone = newton
                .cone
                .as_ref()
                .is_some_and(|cone| cone.place != Place::Inside);
        }
        if let Some(cone) = &mut newton.cone {
            let (xx, gx) = (&mut value.xx, &mut costate.0);
            match self.cone {
                ConeTerm::Scaling => cone.weigh(lanes, xx, gx),
                ConeTerm::Held(omega) => cone.hold(lanes, &x, omega, Some(xx), gx),
                ConeTerm::Penalty(penalty) => cone.penalise(lanes, &x, penalty, xx, gx),
            }
        }
        newton.stiff_end = (0..NX).any(|i| {
            let own = newton.p[i][i];
            value.xx[i][i] > STIFF * if own > 0.0 { own } else { 1.0 }
        });
        newton.values[newton.n] = value;
        newton.factorised = Factorised::of(with_cone);
        let (data, recursion) = newton.parts();
        let n = recursion.gains.len();
        for k in (0..n).rev() {
            let gradient = data.cost_gradient(lanes, k);
            recursion.gradient[k] = gradient;
            if k < changed {
                let (before, after) = recursion.values.split_at_mut(k + 1);
                let found = (&mut before[k], &mut recursion.gains[k]);
                data.eliminate(lanes, k, &after[0], found);
            }
            recursion.feedforward[k] =
                data.backward(lanes, k, gradient, &recursion.gains[k], &mut costate);
        }
    }
}

/// Backward pass for new forces with the factorisation at hand.
pub(super) struct Backward<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Complementarity product that the corrector aims at; none for a refinement, which keeps the products and starts from the
    /// gradient at the present point.
    pub(super) target_mu: Option<f64>,
}

impl<const NX: usize, const NU: usize> Phase for Backward<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let newton = self.newton;
        if self.target_mu.is_none() {
            let x = *newton.x(newton.n);
            newton.terminal_gradient = add_product(lanes, &newton.p, &x, &newton.pv);
            let (data, recursion) = newton.parts();
            for (k, gradient) in recursion.gradient.iter_mut().enumerate() {
                *gradient = data.cost_gradient(lanes, k);
            }
        }
        for channel in newton.channels() {
            if channel.any() {
                channel.correct(lanes, self.target_mu);
            }
        }
        let mut costate = (newton.terminal_force(lanes), [0.0; NU]);
        if let Some(cone) = &mut newton.cone {
            cone.correct(lanes, self.target_mu, &mut costate.0);
        }
        let (data, recursion) = newton.parts();
        for k in (0..recursion.gains.len()).rev() {
            let (gradient, gain) = (recursion.gradient[k], &recursion.gains[k]);
            recursion.feedforward[k] = data.backward(lanes, k, gradient, gain, &mut costate);
        }
    }
}

/// Forward pass: the step of every value, then of slacks and multipliers.
pub(super) struct Forward<'a, const NX: usize, const NU: usize> {
    /// The system.
    pub(super) newton: &'a mut Newton<NX, NU>,
    /// Whether this is the corrector, not the predictor.
    pub(super) corrected: bool,
}

impl<const NX: usize, const NU: usize> Phase for Forward<'_, NX, NU> {
    type Output = Reach;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Reach {
        let newton = self.newton;
        newton.roll(lanes, false);
        let mut reach = Reach::FREE;
        for channel in newton.channels() {
            if channel.any() {
                reach = reach.and(channel.aim(lanes, self.corrected));
            }
        }
        if let Some(cone) = &mut newton.cone {
            reach = reach.and(cone.direction(lanes, at(&newton.states.dv, newton.n - 1)));
        }
        reach
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
