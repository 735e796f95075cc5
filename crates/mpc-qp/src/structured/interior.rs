//! Mehrotra's predictor-corrector, with the active-set finish.

use super::StructuredSolver;
use super::clipping::Cuts;
use super::cone::Cone;
use super::kernel::run;
use super::passes::{Advance, Backward, ConeTerm, Factorise, Forward, Weigh};
use super::soft::Price;
use super::solves::Ray;
use super::sweeps::Patience;
use crate::certificate::{cancel_opposite_multipliers, examine_certificate};
use crate::problem::OcpQp;
use crate::solution::{Solution, SolveStatus};

/// Part of the way to the boundary that a step leaves over, at least.
const NARROW: f64 = 0.005;

/// At most, in steps that aim at much centring: an ellipsoid that is nearly touched has its slack and its multiplier small in turn, and
/// shortens the steps that follow.
const WIDE: f64 = 0.03;

/// What is left of the starting residuals where such steps begin. Infeasible problems, whose residuals stay, are found out sooner by
/// long steps.
const NEARLY_FEASIBLE: f64 = 0.1;

/// Active-set sweeps tried after an iteration that looks like having identified the set; few wrong places, or none of it.
const FINISH: Patience = Patience {
    sweeps: 6,
    wrong: 2,
    free: 1,
};

/// The same once such sweeps have failed.
const FINISH_AGAIN: Patience = Patience { wrong: 1, ..FINISH };

/// Refinements of an iterate that has converged in all but stationarity.
pub(super) const REFINEMENTS: usize = 3;

/// Part of the gap tolerance at which an iterate that is not stationary will not become so.
const EXHAUSTED: f64 = 1e-4;

/// Iterations after which the careful pass takes over unless there is progress. Problems with hardly any curvature that ask for nearly
/// all that the inputs can do have been seen to converge after 70.
const USUAL_ITERATIONS: usize = 40;

/// Iterations after which it takes over all the same.
const MOST_ITERATIONS: usize = 100;

/// Progress: after so many more iterations the products or the residuals have fallen to this part. Where they were asked to halve, a cart over 200
/// stages with inputs nearly free was lost of 26 that are solved; to a tenth, 22.
const WATCHED: usize = 10;
const FALLEN: f64 = 0.9;

/// Residual at which a ray is taken: a few more steps cost little and prove ten times as much as a proof has to.
const RAY_TOLERANCE: f64 = 1e-7;

/// A stop, unless it comes after the optimality conditions once held.
fn or_settled(stop: SolveStatus, settled: bool) -> SolveStatus {
    if settled { SolveStatus::Solved } else { stop }
}

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Active-set sweeps from the iterate's guess; comes back to the iterate if they do not settle. A guess that has `failed` before is
    /// not tried again.
    fn finish(&mut self, failed: &mut bool) -> bool {
        let mut fresh = !*failed;
        for channel in self.newton.channels() {
            fresh |= channel.guess_from_iterate();
            channel.save();
        }
        if let Some(cone) = &mut self.newton.cone {
            fresh |= cone.guess_from_iterate();
        }
        if !fresh {
            return false;
        }
        let kept = self.newton.cone.clone();
        if self.sweep(if *failed { FINISH_AGAIN } else { FINISH }) {
            return true;
        }
        for channel in self.newton.channels() {
            channel.restore();
        }
        self.newton.cone = kept;
        *failed = true;
        false
    }

    /// Whether the iterate's multipliers prove infeasibility. Writes the ray into `solution` if so; keeps the iterate. Soft constraints have no
    /// part in a contradiction: left in the ray, the multiplier of one far out of reach separates more than any tolerance sees of it.
    pub(super) fn infeasible(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &mut Solution<NX, NU>,
    ) -> Option<SolveStatus> {
        for channel in self.newton.channels() {
            channel.save();
            if channel.price != Price::Hard {
                channel.forget_multipliers();
            }
        }
        let kept = self.newton.cone.clone();
        if let Some(cone) = &mut self.newton.cone
            && cone.price != Price::Hard
        {
            cone.reset();
        }
        run(Ray {
            newton: &mut self.newton,
            costates: &mut self.costates,
        });
        self.newton.write(solution);
        solution
            .multipliers
            .costates
            .copy_from_slice(&self.costates);
        solution
            .multipliers
            .costates
            .iter_mut()
            .for_each(|costate| *costate *= self.newton.cost_unit);
        cancel_opposite_multipliers(&mut solution.multipliers);
        let (certificate, blame) = examine_certificate(problem, solution);
        if certificate.residual <= RAY_TOLERANCE && certificate.is_proof(solution) {
            return Some(SolveStatus::PrimalInfeasible { certificate, blame });
        }
        for channel in self.newton.channels() {
            channel.restore();
        }
        self.newton.cone = kept;
        None
    }

    /// Iterative refinement: solves for what is left of the optimality conditions with the factorisation at hand and constant
    /// complementarity products. The last factorisations are the least accurate; their error multiplies the remainder only.
    fn refine(&mut self, tolerance: f64) -> bool {
        for _ in 0..REFINEMENTS {
            let newton = &mut self.newton;
            run(Backward {
                newton,
                target_mu: None,
            });
            let reach = run(Forward {
                newton,
                corrected: true,
            });
            let step = ((1.0 - NARROW) / reach.ratio.max(1e-300)).min(1.0);
            if !(step > 1e-12 && reach.product.is_finite()) {
                return false;
            }
            run(Advance {
                newton,
                alpha: step,
            });
            if self.stationary(tolerance) {
                return true;
            }
        }
        false
    }

    /// Largest distance of what is held by the method of multipliers.
    fn fixed_residual(&mut self) -> f64 {
        let channels = self.newton.channels();
        let of_each = channels.iter().map(|channel| channel.fixed_residual());
        of_each.fold(0.0, f64::max)
    }

    /// The interior point.
    pub(super) fn interior_point(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &mut Solution<NX, NU>,
        cuts: &Cuts,
    ) -> SolveStatus {
        let (mut mu, count) = self.start_interior(cuts);
        // What is left of the starting residuals.
        let mut infeasible = 1.0;
        let mut short_steps = 0;
        let mut failed = false;
        let tolerance = self.settings.tolerance;
        let mut watched = (f64::INFINITY, f64::INFINITY);
        // Converged in all but the gap beside the objective: worth more than any stop.
        let mut settled = false;
        // Largest distance of what is held by the method of multipliers.
        let mut distance = f64::INFINITY;
        for iteration in 0..MOST_ITERATIONS {
            if self.iterations >= self.settings.max_iterations {
                break;
            }
            if iteration % WATCHED == 0 {
                let progress = mu < FALLEN * watched.0 || infeasible < FALLEN * watched.1;
                if iteration >= USUAL_ITERATIONS && !progress {
                    break;
                }
                watched = (mu, infeasible);
            }
            if self.out_of_time() {
                return or_settled(SolveStatus::TimeLimit, settled);
            }
            self.iterations += 1;
            let newton = &mut self.newton;
            run(Weigh(newton));
            run(Factorise {
                newton,
                cone: ConeTerm::Scaling,
            });
            let reach = run(Forward {
                newton,
                corrected: false,
            });
            let alpha = 1.0 / reach.ratio.max(1.0);
            let affine = (1.0 - alpha) * mu + alpha * alpha * reach.product / count.max(1.0);
            let sigma = (affine / mu).clamp(0.0, 1.0).powi(3);
            run(Backward {
                newton,
                target_mu: Some(sigma * mu),
            });
            let reach = run(Forward {
                newton,
                corrected: true,
            });
            let margin = if infeasible < NEARLY_FEASIBLE {
                sigma.clamp(NARROW, WIDE)
            } else {
                NARROW
            };
            let step = ((1.0 - margin) / reach.ratio.max(1e-300)).min(1.0);
            let before = mu;
            if step > 1e-12 && reach.product.is_finite() {
                infeasible *= 1.0 - step;
                mu = run(Advance {
                    newton,
                    alpha: step,
                }) / count.max(1.0);
            }
            let fixed = self.fixed_residual();
            // Equalities that contradict each other are left where they are by one full step after the other.
            let stands =
                infeasible <= 1e-10 && step > 0.9 && fixed > tolerance && fixed > 0.5 * distance;
            distance = fixed;
            let stuck = !(step > 1e-12 && reach.product.is_finite() && mu.is_finite() && mu < 1e40);
            short_steps = if step < 0.3 { short_steps + 1 } else { 0 };
            let growing = mu > before && infeasible > 1e-3;
            if (((stuck || short_steps >= 2 || growing) && infeasible > 1e-10) || stands)
                && let Some(status) = self.infeasible(problem, solution)
            {
                return status;
            }
            if stuck {
                return or_settled(SolveStatus::NumericalTrouble, settled);
            }
            let identified = step > 0.5 && sigma < 0.1 && infeasible < 3e-3;
            if identified && self.finish(&mut failed) {
                return SolveStatus::Solved;
            }
            let converged = mu * count < 0.1 * tolerance
                && infeasible < 0.1 * tolerance
                && fixed < 0.1 * tolerance;
            if converged && (self.stationary(tolerance) || self.refine(tolerance)) {
                settled = true;
                if self.gap_is_small(problem, solution) {
                    return SolveStatus::Solved;
                }
            }
            if (converged || stands) && mu * count < EXHAUSTED * tolerance {
                return or_settled(SolveStatus::NumericalTrouble, settled);
            }
        }
        if settled {
            return SolveStatus::Solved;
        }
        self.infeasible(problem, solution)
            .unwrap_or(SolveStatus::IterationLimit)
    }

    /// Whether multipliers times distances are small beside the problem's objective. The products alone are small beside the cost in here, and know
    /// nothing of what is left of large starting residuals.
    fn gap_is_small(&mut self, problem: &OcpQp<NX, NU>, solution: &mut Solution<NX, NU>) -> bool {
        let channels = self.newton.channels();
        let gap: f64 = channels.iter().map(|channel| channel.gap()).sum();
        let gap = gap + self.newton.cone.as_ref().map_or(0.0, Cone::gap);
        self.newton.write(solution);
        let objective = problem.objective(&solution.x, &solution.u, &solution.slacks);
        self.newton.cost_unit * gap <= self.settings.tolerance * objective.abs().max(1.0)
    }
}
