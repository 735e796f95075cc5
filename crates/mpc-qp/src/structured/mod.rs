//! Structured interior point: Mehrotra's predictor-corrector on the stage structure.

mod bounds;
mod channel;
mod cone;
mod kernel;
mod load;
mod newton;
mod riccati;
mod soft;
mod write;

use crate::error::SolveError;
use crate::problem::OcpQp;
use crate::residuals::Residuals;
use crate::solution::{Solution, SolveStatus};
use crate::solver::{OcpSolver, SolverSettings, Start};
use kernel::{Lanes, Phase, run};
use newton::{Advance, Backward, Costates, Factorise, Forward, Newton, SolveAbsolute, Weigh};
use std::time::Instant;

/// Structured interior-point solver.
#[derive(Clone, Debug)]
pub struct StructuredSolver<const NX: usize, const NU: usize> {
    settings: SolverSettings,
    newton: Newton<NX, NU>,
}

struct Load<'a, const NX: usize, const NU: usize>(&'a mut Newton<NX, NU>, &'a OcpQp<NX, NU>);

impl<const NX: usize, const NU: usize> Phase for Load<'_, NX, NU> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.load(lanes, self.1);
    }
}

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Memory for problems of the structure of `problem`.
    pub fn new(problem: &OcpQp<NX, NU>, settings: SolverSettings) -> Result<Self, SolveError> {
        settings.validate()?;
        Ok(Self { settings, newton: Newton::new(problem) })
    }

    fn start(&mut self) -> (f64, f64) {
        let rho: f64 = std::env::var("RHO").ok().and_then(|v| v.parse().ok()).unwrap_or(1e-3);
        let least: f64 = std::env::var("LEAST").ok().and_then(|v| v.parse().ok()).unwrap_or(0.1);
        let mu0: f64 = std::env::var("MU0").ok().and_then(|v| v.parse().ok()).unwrap_or(1.0);
        let omega = 1e8;
        for channel in self.newton.channels() {
            channel.omega = omega;
            channel.center(rho);
        }
        run(SolveAbsolute(&mut self.newton));
        
        let mut count = 0.0;
        let mu = mu0;
        for channel in self.newton.channels() {
            channel.enter(least, mu);
            count += channel.count();
        }
        let x = *self.newton.x(self.newton.n);
        if let Some(cone) = &mut self.newton.cone {
            cone.start(&x, mu);
            count += cone.count();
        }
        (mu, count)
    }

    fn iterate(&mut self, trace: bool) -> (SolveStatus, usize) {
        let (mut mu, count) = self.start();
        let newton = &mut self.newton;
        let mut infeasible = 1.0;
        for iteration in 0..self.settings.max_iterations {
            let fixed = newton.channels().iter().map(|c| c.fixed_residual()).fold(0.0, f64::max);
            if trace {
                println!("{iteration:3} mu {mu:.2e} infeasible {infeasible:.2e} fixed {fixed:.2e}");
            }
            if mu * count.max(1.0) < 0.1 * self.settings.tolerance && infeasible < 0.1 * self.settings.tolerance && iteration > 0 {
                return (SolveStatus::Solved, iteration);
            }
            run(Weigh(newton));
            run(Factorise(newton));
            let reach = run(Forward { newton, affine: true });
            let alpha = 1.0 / reach.ratio.max(1.0);
            let mut target = 0.0;
            if count > 0.0 {
                let affine = (1.0 - alpha) * mu + alpha * alpha * reach.product / count;
                let sigma = (affine / mu).clamp(0.0, 1.0).powi(3);
                target = sigma * mu;
                run(Backward { newton, target_mu: target });
                let reach = run(Forward { newton, affine: false });
                let fraction = 1.0 - (0.1_f64).min(mu.max(1e-4)).min(0.005);
                let step = (fraction / reach.ratio.max(1e-300)).min(1.0);
                infeasible *= 1.0 - step;
                mu = run(Advance { newton, alpha: step }) / count;
                if trace {
                    println!("      alpha_aff {alpha:.3} sigma {sigma:.1e} step {step:.4}");
                }
            } else {
                run(Advance { newton, alpha: 1.0 });
                infeasible = 0.0;
            }
            let _ = target;
        }
        (SolveStatus::IterationLimit, self.settings.max_iterations)
    }
}

impl<const NX: usize, const NU: usize> OcpSolver<NX, NU> for StructuredSolver<NX, NU> {
    fn solve(
        &mut self,
        problem: &OcpQp<NX, NU>,
        _start: Start,
        solution: &mut Solution<NX, NU>,
    ) -> Result<(), SolveError> {
        let clock = Instant::now();
        self.newton.check_shape(problem)?;
        run(Load(&mut self.newton, problem));
        let (status, iterations) = self.iterate(std::env::var("TRACE").is_ok());
        self.newton.write(solution);
        run(Costates { newton: &mut self.newton, costates: &mut solution.multipliers.costates });
        solution.status = status;
        solution.iterations = iterations;
        solution.time = clock.elapsed();
        solution.residuals = Residuals::evaluate(problem, solution);
        solution.objective = problem.objective(&solution.x, &solution.u, &solution.slacks);
        Ok(())
    }
}
