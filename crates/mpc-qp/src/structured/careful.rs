//! The careful pass, for what the interior point does not settle: a proximal method of multipliers.
//!
//! Two convex problems are minimised by Newton's method with exact line search (both are piecewise quadratic but for the
//! ellipsoid, and continuously differentiable, so it converges from anywhere). First the elastic problem, the sum of squared
//! violations: if its least value is not zero, the violations themselves are a Farkas ray, since their gradient vanishes.
//! Then the augmented Lagrangian, multipliers updated after each minimisation. A proximal term of weight 1e-9 makes both strictly convex
//! and moves along with the iterate (Hermans, Themelis, Patrinos, QPALM, 2022). Slower than the interior point, and without its
//! ill-conditioned last iterations.

use super::StructuredSolver;
use super::kernel::{Lanes, Phase, add_product, dot, larger, run};
use super::newton::{Newton, at};
use super::passes::{ConeTerm, Factorise};
use super::penalty::Penalty;
use super::solves::SolveAbsolute;
use super::sweeps::Patience;
use crate::problem::OcpQp;
use crate::solution::{Solution, SolveStatus};

/// Weight of the proximal term; the cost's curvature in the inputs is about one.
const PROXIMAL: f64 = 1e-9;

/// Newton steps in one minimisation.
const NEWTON_STEPS: usize = 60;

/// Proximal steps of the elastic problem.
const ELASTIC_STEPS: usize = 8;

/// Weight of the proximal term of the elastic problem after a minimisation that did not converge.
const HEAVY: f64 = 1e-2;

/// Gradient of the proximal term that is no longer a correction: inputs that moved by 1e4 and more.
const FAR: f64 = 1e-5;

/// Steps in a row that may go that far.
const FAR_STEPS: usize = 4;

/// Squared length, in the Hessian's norm, of a Newton step that no longer matters.
const LEAST_DECREMENT: f64 = 1e-22;

/// Updates of the multipliers; those that converge have been seen to take ten or so.
const MULTIPLIER_UPDATES: usize = 60;

/// Active-set sweeps tried after an update of the multipliers.
const POLISH: Patience = Patience {
    sweeps: 3,
    wrong: usize::MAX,
    free: 3,
};

/// One Newton step with exact line search; returns the step's squared length in the Hessian's norm.
struct Descend<'a, const NX: usize, const NU: usize>(&'a mut Newton<NX, NU>, Penalty);

impl<const NX: usize, const NU: usize> Phase for Descend<'_, NX, NU> {
    type Output = f64;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let Self(newton, penalty) = self;
        newton.roll(lanes, false);
        let (first, second) = newton.cost_along(lanes);
        let slope = |newton: &mut Newton<NX, NU>, alpha: f64| {
            let mut sum = first + alpha * second;
            for channel in newton.channels() {
                sum += channel.slope_along(penalty, alpha);
            }
            if let Some(cone) = &newton.cone {
                let step = (newton.x(newton.n), at(&newton.states.dv, newton.n - 1));
                sum += cone.slope_along(step, penalty, alpha);
            }
            sum
        };
        let start = slope(newton, 0.0);
        let mut alpha = 1.0;
        if slope(newton, 1.0) > 0.1 * start.abs() {
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..40 {
                alpha = 0.5 * (low + high);
                let here = slope(newton, alpha);
                if here.abs() <= 0.1 * start.abs() {
                    break;
                }
                if here > 0.0 {
                    high = alpha;
                } else {
                    low = alpha;
                }
            }
        }
        for channel in newton.channels() {
            channel.move_values(alpha);
        }
        -start
    }
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// First and second derivative of the cost along the step.
    #[inline(always)]
    fn cost_along<L: Lanes>(&self, lanes: L) -> (f64, f64) {
        let end: &[f64; NX] = at(&self.states.dv, self.n - 1);
        let mut first = dot(lanes, &self.terminal_gradient, end);
        let mut second = dot(lanes, end, &add_product(lanes, &self.p, end, &[0.0; NX]));
        for k in 0..self.n {
            let dx = if k == 0 {
                &[0.0; NX]
            } else {
                at(&self.states.dv, k - 1)
            };
            let du: &[f64; NU] = at(&self.inputs.dv, k);
            let stage = &self.stages[k];
            let (gx, gu) = &self.gradient[k];
            first += dot(lanes, gx, dx) + dot(lanes, gu, du);
            let cross = add_product(lanes, &stage.s, du, &[0.0; NX]).map(|entry| 2.0 * entry);
            second += dot(lanes, dx, &add_product(lanes, &stage.q, dx, &cross));
            second += dot(lanes, du, &add_product(lanes, &stage.r, du, &[0.0; NU]));
        }
        (first, second)
    }

    /// Sets the cost to that of `problem`, or to zero, plus a proximal term around the present inputs. Returns the largest change
    /// of the term's gradient.
    fn set_cost(&mut self, problem: &OcpQp<NX, NU>, proximal: f64, elastic: bool) -> f64 {
        let mut change: f64 = 0.0;
        for (k, data) in problem.stages().iter().enumerate() {
            let before = self.stages[k].rv;
            self.load_stage(k, data);
            let u = *self.u(k);
            let stage = &mut self.stages[k];
            if elastic {
                stage.q = [[0.0; NX]; NX];
                stage.s = [[0.0; NX]; NU];
                stage.r = [[0.0; NU]; NU];
                stage.qv = [0.0; NX];
                stage.rv = [0.0; NU];
            }
            for i in 0..NU {
                stage.r[i][i] += proximal;
                stage.rv[i] -= proximal * u[i];
                change = larger((stage.rv[i] - before[i]).abs(), change);
            }
        }
        self.load_terminal_cost(problem);
        if elastic {
            self.p = [[0.0; NX]; NX];
            self.pv = [0.0; NX];
        }
        change
    }
}

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Newton's method; false if a limit is reached or a number is no longer finite.
    fn minimise(&mut self, penalty: Penalty) -> bool {
        let mut before = f64::INFINITY;
        for _ in 0..NEWTON_STEPS {
            if self.stopped() {
                return false;
            }
            self.iterations += 1;
            let newton = &mut self.newton;
            for channel in newton.channels() {
                channel.penalise(penalty);
            }
            run(Factorise {
                newton,
                cone: ConeTerm::Penalty(penalty),
            });
            let decrement = run(Descend(newton, penalty));
            if !decrement.is_finite() {
                return false;
            }
            let stagnates = decrement < 1e-12 && decrement > 0.25 * before;
            if decrement <= LEAST_DECREMENT || stagnates {
                break;
            }
            before = decrement;
        }
        true
    }

    fn update_multipliers(&mut self, penalty: Penalty) -> f64 {
        let x = *self.newton.x(self.newton.n);
        let mut change: f64 = 0.0;
        for channel in self.newton.channels() {
            change = larger(channel.update_multipliers(penalty), change);
        }
        if let Some(cone) = &mut self.newton.cone {
            change = larger(cone.update_multiplier(&x, penalty), change);
        }
        change
    }

    fn drop_multipliers(&mut self) {
        for channel in self.newton.channels() {
            channel.forget_multipliers();
        }
        if let Some(cone) = &mut self.newton.cone {
            cone.reset();
        }
    }

    /// The unconstrained solution, with zero multipliers.
    fn start_unconstrained(&mut self, problem: &OcpQp<NX, NU>) {
        self.newton.set_cost(problem, 0.0, false);
        for channel in self.newton.channels() {
            channel.omega = 1.0;
            channel.center(0.0);
        }
        run(SolveAbsolute {
            newton: &mut self.newton,
            clipped: false,
        });
        self.drop_multipliers();
    }

    /// Least violations; the certificate if they prove that the constraints contradict each other.
    fn elastic(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &mut Solution<NX, NU>,
    ) -> Option<SolveStatus> {
        let penalty = Penalty {
            omega: 1.0,
            elastic: true,
        };
        let mut proximal = PROXIMAL;
        self.newton.set_cost(problem, proximal, true);
        for _ in 0..ELASTIC_STEPS {
            let before = self.iterations;
            if !self.minimise(penalty) {
                return None;
            }
            let violation = self.update_multipliers(penalty);
            if violation <= self.settings.tolerance {
                break;
            }
            if let Some(status) = self.infeasible(problem, solution) {
                return Some(status);
            }
            self.drop_multipliers();
            // Steps along flat directions end at the next kink: a heavier term shortens them, and grows lighter as they converge.
            proximal = if self.iterations - before >= NEWTON_STEPS {
                proximal.max(HEAVY)
            } else {
                (0.1 * proximal).max(PROXIMAL)
            };
            self.newton.set_cost(problem, proximal, true);
        }
        self.drop_multipliers();
        None
    }

    /// Active-set sweeps on the set of the present multipliers; comes back if they do not settle.
    fn polish(&mut self) -> bool {
        for channel in self.newton.channels() {
            channel.save();
            channel.guess_from_multipliers();
        }
        let kept = self.newton.cone.clone();
        if self.sweep(POLISH) {
            return true;
        }
        for channel in self.newton.channels() {
            channel.restore();
        }
        self.newton.cone = kept;
        false
    }

    /// The careful pass.
    pub(super) fn careful(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &mut Solution<NX, NU>,
    ) -> SolveStatus {
        self.start_unconstrained(problem);
        if let Some(status) = self.elastic(problem, solution) {
            return status;
        }
        let tolerance = self.settings.tolerance;
        let (mut omega, mut before, mut far) = (10.0, f64::INFINITY, 0);
        self.newton.set_cost(problem, PROXIMAL, false);
        for _ in 0..MULTIPLIER_UPDATES {
            let penalty = Penalty {
                omega,
                elastic: false,
            };
            if !self.minimise(penalty) {
                return if self.out_of_time() {
                    SolveStatus::TimeLimit
                } else if self.stopped() {
                    SolveStatus::IterationLimit
                } else {
                    SolveStatus::NumericalTrouble
                };
            }
            let residual = self.update_multipliers(penalty);
            let drift = self.newton.set_cost(problem, PROXIMAL, false);
            // The cost falls without end along a direction that no constraint closes.
            far = if drift > FAR { far + 1 } else { 0 };
            if far >= FAR_STEPS {
                return SolveStatus::NumericalTrouble;
            }
            let exact = residual <= 0.1 * tolerance && drift <= 0.1 * tolerance;
            if exact || residual <= 1e-4 {
                self.newton.set_cost(problem, 0.0, false);
                if self.polish() {
                    return SolveStatus::Solved;
                }
                if exact && self.stationary(tolerance) {
                    for channel in self.newton.channels() {
                        channel.finish_soft();
                    }
                    return SolveStatus::Solved;
                }
                self.newton.set_cost(problem, PROXIMAL, false);
            }
            if residual > 0.1 * before {
                omega = (10.0 * omega).min(1e8);
            }
            before = residual;
        }
        SolveStatus::NumericalTrouble
    }
}
