//! When to trust active-set sweeps: the warm path, the cold attempt, and the finish of the interior point.

use super::StructuredSolver;
use super::kernel::run;
use super::passes::{ConeTerm, Factorise};
use super::read::Read;
use super::soft::Price;
use super::solves::{HoldActive, Resolve, Settle, SolveAbsolute};
use crate::solution::Solution;

/// Weight that holds a bound (the cost's curvature in the inputs is about one): large enough that each further solve gains six digits,
/// small enough that the first loses none that matter.
const OMEGA: f64 = 1e7;

/// Sweeps of the warm path before the cold attempt.
const WARM_SWEEPS: usize = 5;

/// Sweeps of the cold attempt before the interior point.
const COLD_SWEEPS: usize = 3;

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Whether active-set sweeps can treat the problem: all but a soft ellipsoid.
    pub(super) fn sweepable(&self) -> bool {
        self.newton
            .cone
            .as_ref()
            .is_none_or(|cone| cone.price == Price::Hard)
    }

    /// Sweeps from the guess of a previous answer's multipliers and its inputs.
    pub(super) fn warm_sweeps(&mut self, solution: &Solution<NX, NU>) -> bool {
        if !self.sweepable() {
            return false;
        }
        run(Read {
            newton: &mut self.newton,
            solution,
        });
        self.sweep(WARM_SWEEPS)
    }

    /// Sweeps from the bounds that the solution without bounds violates.
    pub(super) fn cold_sweeps(&mut self) -> bool {
        for channel in self.newton.channels() {
            channel.omega = OMEGA;
        }
        for channel in self.newton.channels() {
            channel.center(0.0);
        }
        run(SolveAbsolute(&mut self.newton));
        for channel in self.newton.channels() {
            channel.guess_from_values();
        }
        if let Some(cone) = &mut self.newton.cone {
            cone.held = false;
        }
        let bounded = self.newton.channels().iter().any(|channel| channel.any())
            || self.newton.cone.is_some();
        if !bounded {
            self.iterations += 1;
            return self.stationary(self.settings.tolerance);
        }
        self.sweepable() && self.sweep(COLD_SWEEPS)
    }

    /// Sweeps until the guess is right; true if the optimality conditions hold then.
    pub(super) fn sweep(&mut self, limit: usize) -> bool {
        let tolerance = self.settings.tolerance;
        let mut fewest = usize::MAX;
        for channel in self.newton.channels() {
            channel.omega = OMEGA;
        }
        for sweep in 0..limit {
            if self.out_of_time() {
                return false;
            }
            self.iterations += 1;
            let newton = &mut self.newton;
            run(HoldActive(newton));
            run(Factorise {
                newton,
                cone: ConeTerm::Held(OMEGA),
            });
            let mut verdict = run(Settle(newton));
            for _ in 0..6 {
                if verdict.changes > 0 || verdict.distance <= 0.01 * tolerance {
                    break;
                }
                run(HoldActive(newton));
                run(Resolve(newton));
                verdict = run(Settle(newton));
            }
            if verdict.changes == 0 {
                if verdict.distance.is_nan() || verdict.distance > 0.1 * tolerance {
                    return false;
                }
                for channel in newton.channels() {
                    channel.finish_soft();
                }
                return self.stationary(tolerance);
            }
            // A method that cycles stops improving: better to leave early.
            if verdict.changes >= fewest && sweep >= 3 {
                return false;
            }
            fewest = fewest.min(verdict.changes);
        }
        false
    }
}
