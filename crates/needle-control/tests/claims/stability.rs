//! "Asymptotically stable" and "recursively feasible", as claims about closed loops from random starts: V_N falls by at least the
//! stage cost at every step, and no start that is feasible ever ceases to be. The first step that breaks either is printed.

use crate::deviates::Deviates;
use crate::linear::{HELIX, needle, path};
use crate::scene::DT_S;
use mpc_qp::{ClarabelSolver, SolverSettings};
use nalgebra::{Vector2, Vector6};
use needle_control::{
    ControlStep, Controller, LinearConfiguration, LinearController, LinearWeights, LtvController,
    Measurement, Origin, StraightController, TerminalChoice,
};
use needle_model::{Input, Needle, ReferencePath, StepJacobians};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The error system itself as plant: the pose whose left-invariant error obeys the linear model exactly.
pub(crate) struct LinearPlant<'a> {
    reference: &'a ReferencePath,
    /// Of the reference's first step; its inputs are constant.
    model: StepJacobians,
    xi: Vector6<f64>,
    step: usize,
}

impl<'a> LinearPlant<'a> {
    pub(crate) fn new(reference: &'a ReferencePath, needle: Needle, xi: Vector6<f64>) -> Self {
        Self {
            reference,
            model: needle.linearise(reference.inputs()[0], DT_S).unwrap(),
            xi,
            step: 0,
        }
    }

    pub(crate) fn measurement(&self) -> Measurement {
        Measurement::of(self.reference.poses()[self.step].perturbed(&self.xi))
    }

    pub(crate) fn advance(&mut self, input: Input) {
        self.xi = self.model.a * self.xi + self.model.b * self.deviation(input);
        self.step += 1;
    }

    pub(crate) fn time_s(&self) -> f64 {
        self.step as f64 * DT_S
    }

    fn wanted(&self) -> Input {
        self.reference.inputs()[self.step]
    }

    fn deviation(&self, input: Input) -> Vector2<f64> {
        let wanted = self.wanted();
        Vector2::new(
            input.v_mm_s - wanted.v_mm_s,
            input.omega_rad_s - wanted.omega_rad_s,
        )
    }
}

/// Cost of a stage as the controller counts it.
fn stage_cost(
    weights: &LinearWeights,
    xi: &Vector6<f64>,
    d: &Vector2<f64>,
    d_previous: &Vector2<f64>,
) -> f64 {
    let error: f64 = (0..6).map(|i| weights.error[i] * xi[i] * xi[i]).sum();
    let change = d - d_previous;
    error
        + weights.v * d[0] * d[0]
        + weights.omega * d[1] * d[1]
        + weights.v_change * change[0] * change[0]
        + weights.omega_change * change[1] * change[1]
}

/// A start that was feasible.
#[derive(Debug, Clone, Copy, Default)]
struct Survived {
    /// Steps in which the terminal set had to be asked for: the plan did not end in it by itself.
    held_by_set: usize,
}

/// By which V may fall less, relative to the last V and absolute. Both values carry the solver's relative tolerance of 1e-8, some
/// digits lost in the sum of the stages; the fall itself is some per cent of V. The floor is the square of an error of 1e-6.
const SLACK: [f64; 2] = [1e-6, 1e-12];

/// Runs the error system from a start; `None` if the start itself is infeasible.
fn descends<const NX: usize>(
    controller: &mut LinearController<NX>,
    mut plant: LinearPlant<'_>,
    steps: usize,
) -> Option<Survived>
where
    LinearController<NX>: Controller,
{
    controller.reset();
    let start = plant.xi;
    let mut survived = Survived::default();
    let mut before: Option<(f64, f64)> = None;
    // At rest.
    let mut d_previous = plant.deviation(Input::ZERO);
    for step in 0..steps {
        let ControlStep {
            input,
            origin,
            statistics,
            ..
        } = controller.step(&plant.measurement(), plant.time_s());
        if step == 0 && origin != Origin::Optimal {
            return None;
        }
        assert!(
            origin == Origin::Optimal,
            "feasibility lost at step {step} from {start:?}: {origin:?}"
        );
        survived.held_by_set += usize::from(statistics.solves > 1);
        let value = controller.value();
        if let Some((last, cost)) = before {
            let slack = SLACK[0] * last + SLACK[1];
            assert!(
                value <= last - cost + slack,
                "V fell too little at step {step} from {start:?}: {value} after {last}, stage cost {cost}"
            );
        }
        let d = plant.deviation(input);
        let weights = &controller.configuration().weights;
        before = Some((value, stage_cost(weights, &plant.xi, &d, &d_previous)));
        d_previous = d;
        plant.advance(input);
    }
    Some(survived)
}

/// Errors up to about twice what a horizon can bring into the terminal set, so that the set's boundary is met.
fn random_errors(count: usize) -> Vec<Vector6<f64>> {
    let mut deviates = Deviates::seeded(13);
    let size = Vector6::new(0.8, 0.8, 1.5, 0.06, 0.06, 1.0);
    (0..count)
        .map(|_| size.map(|s| s * deviates.either_way()))
        .collect()
}

fn certified(horizon: usize) -> LinearConfiguration {
    LinearConfiguration {
        horizon,
        terminal: TerminalChoice::HelixDare,
        ..LinearConfiguration::default()
    }
}

/// The starts that were feasible, each run for `steps` by one of as many controllers as there are cores.
fn survivors<const NX: usize>(
    starts: &[Vector6<f64>],
    steps: usize,
    needle: Needle,
    make: impl Fn(ReferencePath) -> LinearController<NX> + Sync,
) -> Vec<Survived>
where
    LinearController<NX>: Controller,
{
    let reference = path(needle, HELIX, steps + 100);
    let next = AtomicUsize::new(0);
    let work = || {
        let mut controller = make(reference.clone());
        assert!(controller.certificate().unwrap().holds());
        let taken = std::iter::from_fn(|| starts.get(next.fetch_add(1, Ordering::Relaxed)));
        taken
            .filter_map(|xi| {
                let plant = LinearPlant::new(&reference, needle, *xi);
                descends(&mut controller, plant, steps)
            })
            .collect::<Vec<_>>()
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        // A worker that found a violation has printed it.
        workers
            .into_iter()
            .flat_map(|worker| worker.join().unwrap())
            .collect()
    })
}

/// At least 2000 starts, and the terminal set met often enough: a test in which neither happened would say nothing.
fn assert_many(survivors: &[Survived], held_at_least: usize) {
    let held: usize = survivors.iter().map(|s| s.held_by_set).sum();
    let count = survivors.len();
    assert!(
        count >= 2_000 && held >= held_at_least,
        "{count} starts, set met in {held} steps"
    );
}

#[test]
fn helical_cost_falls_and_feasibility_stays_for_500_steps_from_2000_starts() {
    let starts: Vec<_> = random_errors(3_000).iter().map(|xi| 0.6 * xi).collect();
    let survivors = survivors(&starts, 500, needle(), |reference| {
        LtvController::new(needle(), reference, certified(5)).unwrap()
    });
    assert_many(&survivors, 500);
}

#[test]
fn straight_cost_falls_and_feasibility_stays_for_500_steps_from_2000_starts() {
    let straight = Needle::new(0.0).unwrap();
    // Depth and roll are all that a straight needle can correct.
    let starts: Vec<_> = random_errors(2_900)
        .iter()
        .map(|xi| Vector6::new(0.0, 0.0, 4.0 * xi[2], 0.0, 0.0, 3.0 * xi[5]))
        .collect();
    let survivors = survivors(&starts, 500, straight, |reference| {
        StraightController::new(straight, reference, certified(5)).unwrap()
    });
    assert_many(&survivors, 200);
}

#[test]
fn clarabel_sees_the_same_descent_on_the_boundary_of_the_feasible_set() {
    let survivors = survivors(&random_errors(200), 4, needle(), |reference| {
        LtvController::with_solver(needle(), reference, certified(8), |problem| {
            ClarabelSolver::new(problem, SolverSettings::default())
        })
        .unwrap()
    });
    assert!(survivors.len() > 50, "{}", survivors.len());
}
