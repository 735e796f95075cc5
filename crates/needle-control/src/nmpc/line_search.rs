//! How far the plan moves along a step: all the way in the real-time iteration unless that raises the cost, by a line search on an
//! exact penalty function when the program is to be solved.

use super::plan::Plan;
use super::shooting::Shooting;
use crate::corridor::WALLS;
use crate::follower::Follower;
use crate::tracking::Tracker;
use nalgebra::Vector2;
use needle_model::{Input, Needle};

/// Step lengths of a line search, largest first: 1, 1/2, ... .
const LINE_SEARCH_STEPS: i32 = 12;

/// Fraction of the predicted decrease that a step must bring (Armijo).
const SUFFICIENT_DECREASE: f64 = 1e-4;

/// Difference of inputs, mm/s and rad/s, that is none.
const ROUNDING: f64 = 1e-9;

impl Shooting {
    /// Moves the plan along the step as far as the exact penalty function falls enough; false if nowhere.
    pub(crate) fn search(&mut self, needle: &Needle, tracker: &Tracker) -> bool {
        let costates = &self.programs.solution().multipliers.costates;
        let dual = costates
            .iter()
            .map(nalgebra::Matrix::amax)
            .fold(0.0, f64::max);
        // Costates belong to half the cost; twice that bounds the multipliers of the cost itself.
        self.penalty = self.penalty.max(3.0 * dual);
        let gap = self.gap(&self.plan, needle, tracker);
        let merit = self.priced_cost(&self.plan, tracker) + self.penalty * gap;
        let slope = self.cost_slope(tracker) + self.price_slope(tracker) - self.penalty * gap;
        for halvings in 0..LINE_SEARCH_STEPS {
            let length = 0.5_f64.powi(halvings);
            self.try_step(length);
            let trial = self.priced_cost(&self.trial, tracker)
                + self.penalty * self.gap(&self.trial, needle, tracker);
            let rounding = 1e-12 * merit.abs();
            if trial <= merit + SUFFICIENT_DECREASE * length * slope.min(0.0) + rounding {
                std::mem::swap(&mut self.plan, &mut self.trial);
                return true;
            }
        }
        false
    }

    /// Moves the plan by the full step if that does not raise the cost of its inputs, simulated from its first pose; else by half of it,
    /// else not. Gauss-Newton leaves out the roll's curvature: far from the path full steps overshoot and alternate for good.
    /// False, and the plan unchanged, if the full step is not finite. Inputs that cannot be reached from the one applied last, `reach_s`
    /// ago, are compared as what would be applied: a plan shifted over a stop or a late sample promises more than it can keep.
    pub(crate) fn take_falling_step(&mut self, follower: &Follower, reach_s: f64) -> bool {
        let before = self.simulate(0.0, follower, reach_s);
        // A cost that is no number is no reason to doubt the step: it is judged by its own numbers.
        if !(self.simulate(1.0, follower, reach_s) > before) {
            return self.take_full_step();
        }
        if self.simulate(0.5, follower, reach_s) > before {
            self.simulate(0.0, follower, reach_s);
        }
        std::mem::swap(&mut self.plan, &mut self.trial);
        true
    }

    /// Replaces a plan whose inputs cannot all be reached from the one applied last, `reach_s` ago, by what would be applied of it. A
    /// search that ends short of a step mixes the inputs of the plan with reachable ones: it needs both to be reachable.
    pub(crate) fn bring_within_reach(&mut self, follower: &Follower, reach_s: f64) {
        self.simulate(0.0, follower, reach_s);
        let beyond = |(applied, planned): (&Input, &Input)| {
            (applied.v_mm_s - planned.v_mm_s).abs() > ROUNDING
                || (applied.omega_rad_s - planned.omega_rad_s).abs() > ROUNDING
        };
        if self.trial.inputs.iter().zip(&self.plan.inputs).any(beyond) {
            std::mem::swap(&mut self.plan, &mut self.trial);
        }
    }

    /// Simulates the inputs at this length along the step, as far as they can be reached, into the trial plan; its cost.
    fn simulate(&mut self, length: f64, follower: &Follower, reach_s: f64) -> f64 {
        let (from, to) = (&self.plan.inputs, &self.programs.solution().u);
        self.trial.poses[0] = self.plan.poses[0];
        let (limits, dt_s) = (self.limits, self.dt_s);
        let mut held = follower.guard.previous();
        self.trial.fill(0, &follower.needle, dt_s, |_, k| {
            let since_s = if k == 0 { reach_s } else { dt_s };
            held = limits.admissible(along(from[k], &to[k], length), held, since_s);
            held
        });
        self.priced_cost(&self.trial, &follower.tracker)
    }

    /// Largest entry of the step in poses and inputs.
    pub(crate) fn step_size(&self) -> f64 {
        let solution = self.programs.solution();
        let poses = solution.x.iter().map(nalgebra::Matrix::amax);
        let inputs = solution
            .u
            .iter()
            .zip(&self.plan.inputs)
            .map(|(u, planned)| {
                (u[0] - planned.v_mm_s)
                    .abs()
                    .max((u[1] - planned.omega_rad_s).abs())
            });
        poses.chain(inputs).fold(0.0, f64::max)
    }

    /// The plan moved along the step, into the trial plan.
    pub(super) fn try_step(&mut self, length: f64) {
        let (plan, solution) = (&self.plan, self.programs.solution());
        for (k, pose) in self.trial.poses.iter_mut().enumerate() {
            *pose = plan.poses[k].perturbed(&(solution.x[k] * length));
        }
        for (k, input) in self.trial.inputs.iter_mut().enumerate() {
            *input = along(plan.inputs[k], &solution.u[k], length);
        }
    }

    /// Sum of the defects' entries, and how far the end is outside the terminal set.
    fn gap(&self, plan: &Plan, needle: &Needle, tracker: &Tracker) -> f64 {
        let n = plan.inputs.len();
        let step = |k: usize| needle.step(&plan.poses[k], plan.inputs[k], self.dt_s);
        let defects: f64 = (0..n)
            .map(|k| {
                step(k).map_or(f64::INFINITY, |g| {
                    g.error_from(&plan.poses[k + 1]).lp_norm(1)
                })
            })
            .sum();
        defects + self.end.outside(&plan.poses[n], &tracker.poses[n])
    }

    /// Bound on the derivative of the corridor's price along the step: it is convex along the linearised one.
    fn price_slope(&self, tracker: &Tracker) -> f64 {
        let Some(corridor) = &self.corridor else {
            return 0.0;
        };
        let slacks = &self.programs.solution().slacks.stages;
        let walls = slacks
            .iter()
            .flat_map(|stage| stage.rows.iter().take(WALLS));
        let left_mm: f64 = walls.sum();
        corridor.price_per_mm * left_mm - corridor.cost(&self.plan.poses, &tracker.poses)
    }

    /// Derivative of the cost along the step.
    fn cost_slope(&self, tracker: &Tracker) -> f64 {
        let n = self.plan.inputs.len();
        let weights = &self.weights;
        let solution = self.programs.solution();
        let mut slope = 0.0;
        for k in 0..n {
            let (gradient, _) = weights
                .running()
                .model(&self.plan.poses[k], &tracker.poses[k]);
            let (wanted, input, to) =
                (self.wanted(tracker, k), self.plan.inputs[k], &solution.u[k]);
            slope += gradient.dot(&solution.x[k])
                + weights.v * (input.v_mm_s - wanted.v_mm_s) * (to[0] - input.v_mm_s)
                + weights.omega
                    * (input.omega_rad_s - wanted.omega_rad_s)
                    * (to[1] - input.omega_rad_s);
        }
        // A pose without a model gives no slope, and no step passes then.
        let end = self.end.model(&self.plan.poses[n], &tracker.poses[n]);
        2.0 * end.map_or(f64::NAN, |(gradient, _)| {
            slope + gradient.dot(&solution.x[n])
        })
    }
}

/// The input at this length of the way.
fn along(from: Input, to: &Vector2<f64>, length: f64) -> Input {
    // At full length the solver's own number, without rounding beyond a bound.
    if length == 1.0 {
        return Input {
            v_mm_s: to[0],
            omega_rad_s: to[1],
        };
    }
    Input {
        v_mm_s: from.v_mm_s + length * (to[0] - from.v_mm_s),
        omega_rad_s: from.omega_rad_s + length * (to[1] - from.omega_rad_s),
    }
}
