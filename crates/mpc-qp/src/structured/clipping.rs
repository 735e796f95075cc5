//! Feedback cut off at the limits of inputs and rates on its way forward.
//!
//! A bound that the unconstrained plan violates at one stage is usually active at several: a rate that may not jump
//! climbs. Rolled out with every input cut off at its limits, the same feedback meets these bounds stage by stage, from states that can
//! be reached. What cut it is a far better guess of the active set than the violations of the free plan, and costs nothing more.
//!
//! Over long horizons feedback that knows no limits winds up and meets them at every stage. Such a guess is worthless, which
//! shows in the number of cuts.

use super::active::{HELD, MET, OUTSIDE, ROUNDING};
use super::bounds::Lane;
use super::channel::SIGN;
use super::handover::width;
use super::riccati::Gain;

/// What clipped feedback met.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cuts {
    /// How many values were cut off.
    pub(super) count: usize,
    /// Sum of multiplier times width over the first [`FEW`] of them. The multiplier is what the free cost to go asks for.
    pub(super) products: f64,
    /// Whether the plan ends far dearer than it begins, as cut-off feedback of an unstable plant does.
    pub(super) runs_away: bool,
}

/// Cuts up to which a guess is worth a sweep.
pub(super) const FEW: usize = 10;

impl Cuts {
    /// Mean product of multiplier and width, if anything was cut off.
    pub(super) fn mean_product(&self) -> Option<f64> {
        (self.count > 0).then(|| self.products / self.count.min(FEW) as f64)
    }
}

/// The bounds of inputs and rates.
pub(super) struct Limits<'a> {
    /// Lower and upper side of the inputs.
    pub(super) inputs: &'a mut [Vec<Lane>; 2],
    /// Of the rates.
    pub(super) rates: &'a mut [Vec<Lane>; 2],
}

impl Limits<'_> {
    /// Cuts the input of stage k off at its limits and at those of its rate from the input `before`, leaving components that the guess
    /// holds alone. What cut is held from now on, or only marked as met for `settle`. True if anything was cut.
    #[inline(always)]
    pub(super) fn clip<const NX: usize, const NU: usize>(
        &mut self,
        k: usize,
        u: &mut [f64; NU],
        before: &[f64; NU],
        gain: &Gain<NX, NU>,
        hold: Option<&mut Cuts>,
    ) -> bool {
        // Most inputs are within their limits, which is cheap to see.
        let mut within = true;
        for i in 0..NU {
            for side in 0..2 {
                within &= self.excess(side, k * NU + i, u[i], before[i]).is_none();
            }
        }
        !within && self.cut(k, u, before, gain, hold)
    }

    /// By how much an input is beyond the nearer of its limit and that of its rate on one side, that limit, and whether it is the input's.
    #[inline(always)]
    fn excess(&self, side: usize, index: usize, u: f64, before: f64) -> Option<(f64, f64, bool)> {
        let by_input = self.inputs[side][index / 4].limit(index % 4);
        let by_rate = self.rates[side][index / 4].limit(index % 4) + SIGN[side] * before;
        let (limit, of_input) = if by_input <= by_rate {
            (by_input, true)
        } else {
            (by_rate, false)
        };
        let excess = SIGN[side] * u - limit;
        (excess > ROUNDING * (1.0 + limit.abs())).then_some((excess, limit, of_input))
    }

    fn cut<const NX: usize, const NU: usize>(
        &mut self,
        k: usize,
        u: &mut [f64; NU],
        before: &[f64; NU],
        gain: &Gain<NX, NU>,
        hold: Option<&mut Cuts>,
    ) -> bool {
        let mark = if hold.is_some() { HELD } else { MET };
        let (mut count, mut products) = (0, 0.0);
        for i in 0..NU {
            let (l, j) = ((k * NU + i) / 4, (k * NU + i) % 4);
            let held = |sides: &[Vec<Lane>; 2]| sides.iter().any(|side| side[l].place[j] > OUTSIDE);
            if held(self.inputs) || held(self.rates) {
                continue;
            }
            for side in 0..2 {
                if let Some((excess, limit, of_input)) =
                    self.excess(side, k * NU + i, u[i], before[i])
                {
                    u[i] = SIGN[side] * limit;
                    let cutting = if of_input {
                        &mut self.inputs
                    } else {
                        &mut self.rates
                    };
                    cutting[side][l].place[j] = mark;
                    let width = width(&cutting[side][l], &cutting[1 - side][l], j);
                    products += excess * width / gain.inverse[i][i];
                    count += 1;
                    break;
                }
            }
        }
        if let Some(cuts) = hold {
            if cuts.count < FEW {
                cuts.products += products;
            }
            cuts.count += count;
        }
        count > 0
    }
}
