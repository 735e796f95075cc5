//! When to trust active-set sweeps: the warm path, the cold attempt, and the finish of the interior point.

use super::StructuredSolver;
use super::clipping::{Cuts, FEW};
use super::cone::Place;
use super::interior::REFINEMENTS;
use super::kernel::run;
use super::passes::{ConeTerm, Factorise};
use super::read::Read;
use super::solves::{HoldActive, Resolve, Settle, SolveAbsolute};
use crate::solution::Solution;

/// Weight that holds a bound (the cost's curvature in the inputs is about one): large enough that each further solve gains six digits,
/// small enough that the first loses none that matter.
const OMEGA: f64 = 1e7;

/// The same for the ellipsoid, where most inputs may be at their limits and those that are left hardly move its normal: a distance that
/// falls by ten a sweep shows that the weight is too small.
const CONE_OMEGA: f64 = 1e10;

/// Distance from a bound that rounding may leave of values near one, after the weights have driven it down as far as they can.
const ROUNDING: f64 = 1e-12;

/// When to give sweeps up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    /// Sweeps at most.
    pub(super) sweeps: usize,
    /// Wrong places in the guess that another sweep is not expected to mend.
    pub(super) wrong: usize,
    /// Sweeps whose number of wrong places need not fall.
    pub(super) free: usize,
}

/// Further sweeps where the guess is right and only the ellipsoid has to be linearised anew.
const LINEARISATIONS: usize = 3;

/// The warm path before the cold attempt. A guess that is a place or three wrong is mended in as many sweeps; another plan's is mostly dropped after one.
const WARM: Patience = Patience {
    sweeps: 4,
    wrong: 3,
    free: 1,
};

/// The cold attempt before the interior point, from the guess of the clipped feedback.
const COLD: Patience = Patience {
    sweeps: 8,
    wrong: 8,
    free: 3,
};

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Sweeps from the guess of a previous answer's multipliers and its inputs.
    pub(super) fn warm_sweeps(&mut self, solution: &Solution<NX, NU>) -> bool {
        run(Read {
            newton: &mut self.newton,
            solution,
        });
        self.sweep(WARM)
    }

    /// The solution without bounds, cut off at the limits of inputs and rates; what cut it, and which other bounds it violates,
    /// is the guess.
    pub(super) fn clipped_feedback(&mut self) -> Cuts {
        for channel in self.newton.channels() {
            channel.omega = OMEGA;
            // What a warm attempt left.
            channel.fixed.iter_mut().for_each(|fixed| fixed.y = 0.0);
            channel.center(0.0);
        }
        let newton = &mut self.newton;
        newton.inputs.guess_nothing();
        newton.rates.guess_nothing();
        let mut cuts = run(SolveAbsolute {
            newton,
            clipped: true,
        });
        cuts.runs_away = cuts.count > 0 && newton.runs_away();
        for channel in [&mut newton.states, &mut newton.rows, &mut newton.terminal] {
            channel.guess_from_values();
        }
        if let Some(cone) = &mut newton.cone {
            cone.place = Place::Inside;
        }
        cuts
    }

    /// Sweeps from the guess of the clipped feedback.
    pub(super) fn cold_sweeps(&mut self, cuts: &Cuts) -> bool {
        let bounded = self.newton.channels().iter().any(|channel| channel.any())
            || self.newton.cone.is_some();
        if !bounded {
            self.iterations += 1;
            return self.stationary(self.settings.tolerance);
        }
        cuts.count <= FEW && self.sweep(COLD)
    }

    /// Distance from a bound at which it is held: a tenth of the tolerance in the given units, as far as rounding lets it.
    fn held_within(&self) -> f64 {
        (0.1 * self.settings.tolerance / self.unit).max(ROUNDING)
    }

    /// Sweeps until the guess is right; true if the optimality conditions hold then.
    pub(super) fn sweep(&mut self, patience: Patience) -> bool {
        let tolerance = self.settings.tolerance;
        let within = self.held_within();
        let mut fewest = usize::MAX;
        let mut right = false;
        for channel in self.newton.channels() {
            channel.omega = OMEGA;
        }
        for sweep in 0..patience.sweeps + LINEARISATIONS {
            if self.stopped() || (sweep >= patience.sweeps && !right) {
                return false;
            }
            self.iterations += 1;
            let newton = &mut self.newton;
            run(HoldActive(newton));
            run(Factorise {
                newton,
                cone: ConeTerm::Held(CONE_OMEGA),
            });
            let mut verdict = run(Settle(newton));
            // The gap counts in the problem's unit of cost; rounding limits it where multipliers are huge.
            let unit = newton.cost_unit;
            let mut before = f64::INFINITY;
            for _ in 0..6 {
                let small = verdict.gap * unit <= 0.1 * tolerance || verdict.gap > 0.5 * before;
                if verdict.changes > 0
                    || verdict.rough
                    || (self.unit * verdict.distance <= 0.01 * tolerance && small)
                {
                    break;
                }
                before = verdict.gap;
                run(HoldActive(newton));
                run(Resolve(newton));
                verdict = run(Settle(newton));
            }
            if verdict.changes == 0 && !verdict.rough {
                // `larger` forgets a NaN, the sum of the gap does not.
                let held = verdict.distance <= within && verdict.gap.is_finite();
                if !held {
                    return false;
                }
                if !(self.stationary(tolerance) || self.refine_held(tolerance)) {
                    return false;
                }
                // Only now: an interior point that goes on needs its own slacks.
                for channel in self.newton.channels() {
                    channel.finish_soft();
                }
                return true;
            }
            right = verdict.changes == 0;
            // A method that cycles stops improving: better to leave early.
            if verdict.changes > patience.wrong
                || (verdict.changes >= fewest && sweep >= patience.free)
            {
                return false;
            }
            // The ellipsoid linearised anew may ask for other bounds than those that were right before.
            fewest = if right {
                usize::MAX
            } else {
                fewest.min(verdict.changes)
            };
        }
        false
    }

    /// Iterative refinement of a settled guess: solves for what is left of its conditions with the factorisation at hand. A weight of 1e10
    /// on a state that the inputs hardly reach leaves a residual beside which the tolerance is small.
    fn refine_held(&mut self, tolerance: f64) -> bool {
        let within = self.held_within();
        for _ in 0..REFINEMENTS {
            let newton = &mut self.newton;
            run(HoldActive(newton));
            run(Resolve(newton));
            let verdict = run(Settle(newton));
            // The factorisation at hand belongs to the guess before.
            if verdict.changes > 0 || verdict.rough || !verdict.gap.is_finite() {
                return false;
            }
            if verdict.distance <= within && self.stationary(tolerance) {
                return true;
            }
        }
        false
    }
}
