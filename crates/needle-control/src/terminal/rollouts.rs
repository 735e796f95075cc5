//! Terminal sets of every kind along random references, checked by rollouts that share nothing with what makes the sets: the error
//! dynamics by differences of the needle for the linear controller, the needle itself for the nonlinear one, limits and stage cost as the
//! controllers state them. From a point of X_i the law must keep inputs and rates within the limits, lower V by the stage cost and
//! end in X_{i+1}.

use super::{ALL_COORDINATES, Chosen, End, TerminalChoice};
use crate::limits::InputLimits;
use crate::ltv::{LinearConfiguration, LinearWeights};
use crate::nmpc::{NmpcConfiguration, NmpcWeights, SpinTarget, terminal};
use nalgebra::{DMatrix, DVector, Matrix6, Matrix6x2, Vector2, Vector6};
use needle_model::{Input, Needle, Pose, ReferencePath};
use std::ops::Range;

#[path = "../../tests/deviates/mod.rs"]
mod deviates;
use deviates::Deviates;

/// References of each kind.
const REFERENCES: usize = 8;

/// Steps of the law from each point.
const STEPS: usize = 6;

/// Relative slack: derivatives are wrong by 1e-12 and pass through a P whose condition is 1e6 at times.
const ROUNDING: f64 = 1e-6;

const KINDS: [TerminalChoice; 3] = [
    TerminalChoice::HelixDare,
    TerminalChoice::Periodic { period: 4 },
    TerminalChoice::RiccatiChain,
];

/// What the law is rolled out on.
enum Dynamics {
    /// (xi, deviation applied last) of the linearised needle.
    Linear(LinearWeights),
    /// xi of the needle itself.
    Exact(NmpcWeights),
}

/// Terminal sets along a reference.
struct Sets {
    needle: Needle,
    path: ReferencePath,
    limits: InputLimits,
    corridor_mm: Option<f64>,
    chosen: Chosen,
    dynamics: Dynamics,
    /// Derivatives of the error after each step of the path by error and input.
    jacobians: Vec<(Matrix6<f64>, Matrix6x2<f64>)>,
}

fn vector(input: Input) -> Vector2<f64> {
    Vector2::new(input.v_mm_s, input.omega_rad_s)
}

fn input(u: Vector2<f64>) -> Input {
    Input {
        v_mm_s: u[0],
        omega_rad_s: u[1],
    }
}

/// Of a function of one number at zero, by five points: an error of h^4, and of rounding over h.
fn slope(f: impl Fn(f64) -> Vector6<f64>) -> Vector6<f64> {
    const H: f64 = 2e-3;
    ((f(H) - f(-H)) * 8.0 - (f(2.0 * H) - f(-2.0 * H))) / (12.0 * H)
}

/// A needle, an executed path of the kind, and limits that leave it some room.
fn drawn(kind: TerminalChoice, draw: &mut Deviates) -> (Needle, ReferencePath, InputLimits) {
    let mut within = |low: f64, high: f64| low + (high - low) * draw.uniform();
    let needle = Needle::new(1.0 / within(50.0, 300.0)).unwrap();
    let dt_s = within(0.05, 0.15);
    let (v, omega) = (
        within(1.0, 8.0),
        within(0.4, 3.0) * within(-1.0, 1.0).signum(),
    );
    let (length, varied) = match kind {
        TerminalChoice::HelixDare => (1, 0.0),
        TerminalChoice::Periodic { period } => (period, 0.1),
        _ => (30, 0.1),
    };
    let of_period: Vec<_> = (0..length)
        .map(|_| Input {
            v_mm_s: v * (1.0 + varied * within(-1.0, 1.0)),
            omega_rad_s: omega * (1.0 + varied * within(-1.0, 1.0)),
        })
        .collect();
    let inputs = of_period.iter().copied().cycle().take(length.max(20));
    let path = ReferencePath::from_inputs(needle, Pose::identity(), inputs.collect(), dt_s);
    let limits = InputLimits {
        v_min_mm_s: 0.0,
        v_max_mm_s: v * within(1.3, 2.5),
        omega_max_rad_s: omega.abs() * within(1.3, 4.0),
        v_rate_max_mm_s2: (0.2 * v + within(0.1, 2.0)) / dt_s,
        omega_rate_max_rad_s2: (0.2 * omega.abs() + within(0.1, 2.0)) / dt_s,
    };
    (needle, path.unwrap(), limits)
}

/// The error after a step from an error, with an input that deviates.
fn exact_error(
    (needle, wanted, dt_s): (Needle, Input, f64),
    xi: &Vector6<f64>,
    d: &Vector2<f64>,
) -> Vector6<f64> {
    let after = |pose: &Pose, u| needle.step(pose, u, dt_s).unwrap();
    let reference = after(&Pose::identity(), wanted);
    after(&Pose::exp(xi), input(vector(wanted) + d)).error_from(&reference)
}

fn jacobians(needle: Needle, path: &ReferencePath) -> Vec<(Matrix6<f64>, Matrix6x2<f64>)> {
    let of_step = |&wanted: &Input| {
        let after = |xi, d| exact_error((needle, wanted, path.dt_s()), &xi, &d);
        let of_error = |i| slope(|h| after(Vector6::ith(i, h), Vector2::zeros()));
        let of_input = |i| slope(|h| after(Vector6::zeros(), Vector2::ith(i, h)));
        (
            Matrix6::from_columns(&[0, 1, 2, 3, 4, 5].map(of_error)),
            Matrix6x2::from_columns(&[0, 1].map(of_input)),
        )
    };
    path.inputs().iter().map(of_step).collect()
}

impl Sets {
    fn linear(kind: TerminalChoice, draw: &mut Deviates, corridor_mm: Option<f64>) -> Self {
        let (needle, path, limits) = drawn(kind, draw);
        let mut weight = || 10_f64.powf(draw.either_way());
        let weights = LinearWeights {
            error: [(); 6].map(|()| weight()),
            v: weight(),
            omega: weight(),
            v_change: weight(),
            omega_change: weight(),
        };
        let configuration = LinearConfiguration {
            dt_s: path.dt_s(),
            limits,
            corridor_mm,
            weights,
            ..LinearConfiguration::default()
        };
        let problem = configuration.terminal_problem(needle, &path, ALL_COORDINATES);
        let chosen = problem.choose(kind).unwrap();
        Self {
            needle,
            limits,
            corridor_mm,
            jacobians: jacobians(needle, &path),
            chosen,
            dynamics: Dynamics::Linear(weights),
            path,
        }
    }

    fn exact(kind: TerminalChoice, draw: &mut Deviates, corridor_mm: Option<f64>) -> Self {
        let (needle, path, limits) = drawn(kind, draw);
        let mut weight = || 10_f64.powf(draw.either_way());
        let weights = NmpcWeights {
            position: weight(),
            tangent: 10.0 * weight(),
            roll: weight(),
            v: weight(),
            omega: weight(),
            end_position: weight(),
            end_tangent: 10.0 * weight(),
            end_roll: weight(),
        };
        let configuration = NmpcConfiguration {
            dt_s: path.dt_s(),
            limits,
            corridor_mm,
            weights,
            spin_target: SpinTarget::Reference,
            terminal: kind,
            ..NmpcConfiguration::default()
        };
        let chosen = terminal::chosen(needle, &path, &configuration).unwrap();
        Self {
            needle,
            limits,
            corridor_mm,
            jacobians: jacobians(needle, &path),
            chosen,
            dynamics: Dynamics::Exact(weights),
            path,
        }
    }

    fn wanted(&self, step: usize) -> Input {
        self.path.inputs()[step]
    }

    /// From the first step with one before it, for its change of the input, to the end of the path.
    fn steps(&self) -> Range<usize> {
        1..self.path.inputs().len()
    }

    /// Steps whose sets differ.
    fn starts(&self) -> Range<usize> {
        match self.chosen.choice {
            TerminalChoice::HelixDare => 1..2,
            TerminalChoice::Periodic { period } => 1..period + 1,
            // The last set too, though no law follows.
            _ => 1..self.path.inputs().len() + 1,
        }
    }

    fn end(&self, step: usize) -> End<'_> {
        self.chosen.ingredients.at(step)
    }

    fn value(&self, step: usize, x: &DVector<f64>) -> f64 {
        x.dot(&(self.end(step).p * x))
    }

    /// The law's input.
    fn law(&self, step: usize, x: &DVector<f64>) -> Input {
        let mut u = vector(self.wanted(step)) + self.end(step).k.unwrap() * x;
        if let Dynamics::Linear(_) = self.dynamics {
            u += x.rows(6, 2);
        }
        input(u)
    }

    /// The state after an input, and what the stage costs.
    fn advance(&self, step: usize, x: &DVector<f64>, applied: Input) -> (DVector<f64>, f64) {
        let wanted = self.wanted(step);
        let d = vector(applied) - vector(wanted);
        let xi: Vector6<f64> = x.fixed_rows::<6>(0).into_owned();
        match &self.dynamics {
            Dynamics::Linear(w) => {
                let (a, b) = &self.jacobians[step];
                let mut next = DVector::zeros(8);
                next.rows_mut(0, 6).copy_from(&(a * xi + b * d));
                next.rows_mut(6, 2).copy_from(&d);
                let change = d - x.fixed_rows::<2>(6);
                let squares = (0..6).map(|i| w.error[i] * xi[i] * xi[i]).sum::<f64>()
                    + w.v * d[0] * d[0]
                    + w.omega * d[1] * d[1]
                    + w.v_change * change[0] * change[0]
                    + w.omega_change * change[1] * change[1];
                (next, squares)
            }
            Dynamics::Exact(w) => {
                let pose = Pose::exp(&xi);
                let tangent = pose.tangent() - Pose::identity().tangent();
                // The twist about the tangent.
                let roll = 2.0 * f64::atan2(pose.rotation.k, pose.rotation.w);
                let squares = w.position * pose.position_mm.norm_squared()
                    + w.tangent * tangent.norm_squared()
                    + w.roll * roll * roll
                    + w.v * d[0] * d[0]
                    + w.omega * d[1] * d[1];
                let next = exact_error((self.needle, wanted, self.path.dt_s()), &xi, &d);
                (DVector::from_column_slice(next.as_slice()), squares)
            }
        }
    }

    /// How a rollout goes: the largest share of a limit that is used, and the least (V - V+ - l) / V. A set left counts as minus infinity.
    fn rollout(&self, first: usize, x: &DVector<f64>, enlarged: f64) -> (f64, f64) {
        let (mut x, mut used, mut fall) = (x.clone(), 0.0_f64, f64::INFINITY);
        let mut held = match self.dynamics {
            Dynamics::Linear(_) => Some(vector(self.wanted(first - 1)) + x.fixed_rows::<2>(6)),
            Dynamics::Exact(_) => None,
        };
        for step in first..(first + STEPS).min(self.steps().end) {
            let applied = self.law(step, &x);
            used = used
                .max(self.share(step, applied, held))
                .max(self.share_of_corridor(&x));
            let (next, spent) = self.advance(step, &x, applied);
            let (before, after) = (self.value(step, &x), self.value(step + 1, &next));
            fall = fall.min((before - after - spent) / before);
            if after > self.end(step + 1).level.unwrap() * enlarged * (1.0 + ROUNDING) {
                fall = f64::NEG_INFINITY;
            }
            (x, held) = (next, Some(vector(applied)));
        }
        (used.max(self.share_of_corridor(&x)), fall)
    }

    /// The largest share that an input uses of what the reference leaves of the box on its side, or of a rate limit.
    fn share(&self, step: usize, applied: Input, held: Option<Vector2<f64>>) -> f64 {
        let (l, dt_s) = (&self.limits, self.path.dt_s());
        let (u, wanted) = (vector(applied), vector(self.wanted(step)));
        let upper = Vector2::new(l.v_max_mm_s, l.omega_max_rad_s);
        let lower = Vector2::new(l.v_min_mm_s, -l.omega_max_rad_s);
        let rate = Vector2::new(l.v_rate_max_mm_s2, l.omega_rate_max_rad_s2) * dt_s;
        let above = (u - wanted).component_div(&(upper - wanted));
        let below = (u - wanted).component_div(&(lower - wanted));
        let change = held.map_or(0.0, |held| (u - held).component_div(&rate).amax());
        above.max().max(below.max()).max(change)
    }

    /// The share of the corridor that the offsets across the reference use: the error's own first coordinates where it is linear.
    fn share_of_corridor(&self, x: &DVector<f64>) -> f64 {
        let xi: Vector6<f64> = x.fixed_rows::<6>(0).into_owned();
        let across_mm = match self.dynamics {
            Dynamics::Linear(_) => xi.xy(),
            Dynamics::Exact(_) => Pose::exp(&xi).position_mm.xy(),
        };
        self.corridor_mm
            .map_or(0.0, |corridor_mm| across_mm.amax() / corridor_mm)
    }

    /// Rows whose value the limits bound: offsets across, inputs and their first changes, as linear functions of the state.
    fn rows(&self, step: usize) -> DMatrix<f64> {
        let k = self.end(step).k.unwrap();
        let n = k.ncols();
        let mut rows = DMatrix::zeros(6, n);
        (rows[(4, 0)], rows[(5, 1)]) = (1.0, 1.0);
        rows.view_mut((0, 0), (2, n)).copy_from(k);
        rows.view_mut((2, 0), (2, n)).copy_from(k);
        match self.dynamics {
            Dynamics::Linear(_) => {
                rows[(0, 6)] += 1.0;
                rows[(1, 7)] += 1.0;
            }
            Dynamics::Exact(_) => {
                let (a, b) = &self.jacobians[step.min(self.jacobians.len() - 1)];
                let change = self.end(step + 1).k.unwrap() * (a + b * k) - k;
                rows.rows_mut(2, 2).copy_from(&change);
            }
        }
        rows
    }

    /// Worst of rollouts from a set so much larger: from where each row is largest, P^-1 f by Cauchy-Schwarz, and from random points of
    /// the boundary and inside.
    fn worst(&self, enlarged: f64, random: usize, draw: &mut Deviates) -> (f64, f64) {
        let mut worst = (0.0_f64, f64::INFINITY);
        for step in self.starts() {
            let end = self.end(step);
            let radius = (end.level.unwrap() * enlarged).sqrt();
            let factor = end.p.clone().cholesky().unwrap();
            let mut from = |x: DVector<f64>, size: f64| {
                let x = &x * (size * radius / self.value(step, &x).sqrt());
                let (used, fall) = self.rollout(step, &x, enlarged);
                worst = (worst.0.max(used), worst.1.min(fall));
            };
            for row in self.rows(step).row_iter() {
                let x = factor.solve(&row.transpose());
                from(x.clone(), 1.0);
                from(-x, 1.0);
            }
            for _ in 0..random {
                let direction = DVector::from_fn(end.p.nrows(), |_, _| draw.normal());
                let x = factor.l().tr_solve_lower_triangular(&direction).unwrap();
                from(x.clone(), 1.0);
                from(x, draw.uniform());
            }
        }
        worst
    }
}

/// Every other reference has a corridor, of 0.02 to 0.3 mm.
fn corridor_mm(reference: usize) -> Option<f64> {
    (reference % 2 == 1).then_some(0.04 * reference as f64 - 0.02)
}

#[test]
fn linear_sets_are_as_large_as_the_law_keeps_limits_and_cost_along_the_error_dynamics() {
    for kind in KINDS {
        let mut draw = Deviates::seeded(5);
        for reference in 0..REFERENCES {
            let sets = Sets::linear(kind, &mut draw, corridor_mm(reference));
            let (used, fall) = sets.worst(1.0, 20, &mut draw);
            // V falls by exactly the stage cost.
            assert!(
                used < 1.0 + ROUNDING && fall > -ROUNDING,
                "{kind:?} {reference}: {used} of a limit, fall {fall}"
            );
            // About one input the level is the largest of all.
            let one = kind == TerminalChoice::HelixDare;
            assert!(!one || used > 1.0 - ROUNDING, "{reference}: {used}");
            // A fifth more breaks a limit, though one box stands for the limits about every input of a path that varies by a tenth.
            let (beyond, _) = sets.worst(1.2, 0, &mut draw);
            assert!(beyond > 1.0, "{kind:?} {reference}: {beyond}");
        }
    }
}

#[test]
fn nonlinear_sets_keep_limits_and_cost_along_the_needle_itself() {
    let mut limited = 0;
    for kind in KINDS {
        let mut draw = Deviates::seeded(6);
        for reference in 0..REFERENCES {
            let sets = Sets::exact(kind, &mut draw, corridor_mm(reference));
            let (used, fall) = sets.worst(1.0, 60, &mut draw);
            assert!(
                used < 1.0 + ROUNDING && fall > 0.0,
                "{kind:?} {reference}: {used} of a limit, fall {fall}"
            );
            if used > 0.999 {
                limited += 1;
                let (beyond, _) = sets.worst(1.2, 0, &mut draw);
                assert!(beyond > 1.0, "{kind:?} {reference}: {beyond}");
            }
        }
    }
    // Most sets end where linearisation does; of the others a fifth more breaks a limit.
    assert!(limited >= 3, "{limited}");
}
