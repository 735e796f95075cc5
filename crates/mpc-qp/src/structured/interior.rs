//! Mehrotra's predictor-corrector from a centred start, with the active-set finish.

use super::StructuredSolver;
use super::kernel::run;
use super::newton::{Advance, Backward, Factorise, Forward, SolveAbsolute, Weigh};
use crate::solution::SolveStatus;

/// Weight toward the middle of the bounds in the starting solve, in units of the starting products.
const CENTERING: f64 = 10.0;

/// Least starting slack as a fraction of the bounds' distance.
const LEAST_SLACK: f64 = 0.1;

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Starting point; returns the average complementarity product and the number of products.
    fn start_interior(&mut self) -> (f64, f64) {
        let (mut sum, mut active) = (0.0, 0.0);
        for channel in self.newton.channels() {
            let (products, count) = channel.product_scale();
            sum += products;
            active += count;
        }
        let omega = self.omega();
        let scale: f64 = if active > 0.0 { sum / active } else { self.newton.curvature };
        let mu = 0.1 * if scale.is_finite() { scale.clamp(1e-6, 1e12) } else { 1.0 };
        for channel in self.newton.channels() {
            channel.omega = omega;
            channel.center(CENTERING * mu);
        }
        run(SolveAbsolute(&mut self.newton));
        let mut count = 0.0;
        for channel in self.newton.channels() {
            channel.enter(LEAST_SLACK, mu);
            count += channel.count();
        }
        let x = *self.newton.x(self.newton.n);
        if let Some(cone) = &mut self.newton.cone {
            cone.start(&x, mu);
            count += cone.count();
        }
        (mu, count)
    }

    /// Active-set sweeps from the iterate's guess; comes back to the iterate if they do not settle.
    fn finish(&mut self, sweeps: usize) -> bool {
        if !self.sweepable() {
            return false;
        }
        for channel in self.newton.channels() {
            channel.save();
            channel.guess_from_iterate();
        }
        let kept = self.newton.cone.clone();
        if let Some(cone) = &mut self.newton.cone {
            cone.guess_from_iterate();
        }
        if self.sweep(sweeps) {
            return true;
        }
        for channel in self.newton.channels() {
            channel.restore();
        }
        self.newton.cone = kept;
        false
    }

    /// The interior point.
    pub(super) fn interior_point(&mut self) -> SolveStatus {
        let (mut mu, count) = self.start_interior();
        let mut infeasible = 1.0;
        let tolerance = self.settings.tolerance;
        while self.iterations < self.settings.max_iterations {
            if self.out_of_time() {
                return SolveStatus::TimeLimit;
            }
            self.iterations += 1;
            let newton = &mut self.newton;
            run(Weigh(newton));
            run(Factorise { newton, omega: None });
            let reach = run(Forward { newton, affine: true });
            let alpha = 1.0 / reach.ratio.max(1.0);
            let affine = (1.0 - alpha) * mu + alpha * alpha * reach.product / count.max(1.0);
            let sigma = (affine / mu).clamp(0.0, 1.0).powi(3);
            run(Backward { newton, target_mu: sigma * mu });
            let reach = run(Forward { newton, affine: false });
            let step = (0.995 / reach.ratio.max(1e-300)).min(1.0);
            if !step.is_finite() {
                return SolveStatus::NumericalTrouble;
            }
            infeasible *= 1.0 - step;
            mu = run(Advance { newton, alpha: step }) / count.max(1.0);
            if !mu.is_finite() {
                return SolveStatus::NumericalTrouble;
            }
            if std::env::var("TRACE").is_ok() { println!("{:3} mu {mu:.2e} inf {infeasible:.2e} alpha {alpha:.3} sigma {sigma:.1e} step {step:.4} curv {:.1e}", self.iterations, newton.curvature); }
            if step > 0.5 && sigma < 0.1 && infeasible < 1e-3 && self.finish(2) {
                return SolveStatus::Solved;
            }
            let newton = &mut self.newton;
            let fixed = newton.channels().iter().map(|channel| channel.fixed_residual()).fold(0.0, f64::max);
            if mu * count < 0.1 * tolerance && infeasible < 0.1 * tolerance && fixed < 0.1 * tolerance && self.stationary(tolerance) {
                return SolveStatus::Solved;
            }
        }
        SolveStatus::IterationLimit
    }
}
