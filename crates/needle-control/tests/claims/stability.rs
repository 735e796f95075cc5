//! "Asymptotically stable" and "recursively feasible", as claims about closed loops from random starts: V_N falls by at least the
//! stage cost at every step, and no start that is feasible ever ceases to be. The first step that breaks either is printed.

use crate::linear::{HELIX, needle, path};
use crate::scene::{DT_S, Noise};
use mpc_qp::{ClarabelSolver, SolverSettings};
use nalgebra::{Vector2, Vector6};
use needle_control::{
    ControlStep, Controller, LinearConfiguration, LinearController, LinearWeights, LtvController,
    Measurement, Origin, StraightController, TerminalChoice,
};
use needle_model::{Input, Needle, ReferencePath, StepJacobians};

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

/// Runs the error system from a start; false if the start itself is infeasible.
fn descends<const NX: usize>(
    controller: &mut LinearController<NX>,
    mut plant: LinearPlant<'_>,
    steps: usize,
) -> bool
where
    LinearController<NX>: Controller,
{
    controller.reset();
    let start = plant.xi;
    let mut before: Option<(f64, f64)> = None;
    // At rest.
    let mut d_previous = plant.deviation(Input::ZERO);
    for step in 0..steps {
        let ControlStep { input, origin, .. } =
            controller.step(&plant.measurement(), plant.time_s());
        if step == 0 && !matches!(origin, Origin::Optimal) {
            return false;
        }
        assert!(
            matches!(origin, Origin::Optimal),
            "feasibility lost at step {step} from {start:?}: {origin:?}"
        );
        let value = controller.value();
        if let Some((last, cost)) = before {
            // Both values carry the solver's relative tolerance of 1e-8, some digits lost in the sum of the stages.
            assert!(
                value <= last - cost + 1e-6 * (1.0 + last),
                "V fell too little at step {step} from {start:?}: {value} after {last}, stage cost {cost}"
            );
        }
        let d = plant.deviation(input);
        let weights = &controller.configuration().weights;
        before = Some((value, stage_cost(weights, &plant.xi, &d, &d_previous)));
        d_previous = d;
        plant.advance(input);
    }
    true
}

/// Errors up to about twice what a horizon can bring into the terminal set, so that the set's boundary is met.
fn random_error(noise: &mut Noise) -> Vector6<f64> {
    let size = Vector6::new(0.8, 0.8, 1.5, 0.06, 0.06, 1.0);
    size.map(|s| s * (2.0 * noise.uniform() - 1.0))
}

fn certified(horizon: usize) -> LinearConfiguration {
    LinearConfiguration {
        horizon,
        terminal: TerminalChoice::HelixDare,
        ..LinearConfiguration::default()
    }
}

fn helical(horizon: usize, reference: &ReferencePath) -> LtvController {
    let controller = LtvController::new(needle(), reference.clone(), certified(horizon)).unwrap();
    assert!(controller.certificate().unwrap().holds());
    controller
}

/// Starts that were feasible, of `starts` random ones scaled by `size`.
fn feasible(starts: usize, size: f64, mut trial: impl FnMut(Vector6<f64>) -> bool) -> usize {
    let mut noise = Noise(13);
    (0..starts)
        .filter(|_| trial(size * random_error(&mut noise)))
        .count()
}

#[test]
fn helical_cost_falls_by_the_stage_cost_from_a_thousand_starts() {
    let reference = path(needle(), HELIX, 600);
    let mut controller = helical(12, &reference);
    let count = feasible(1_500, 0.6, |xi| {
        descends(
            &mut controller,
            LinearPlant::new(&reference, needle(), xi),
            3,
        )
    });
    // A test in which no start were feasible would say nothing.
    assert!(count > 1_000, "{count}");
}

#[test]
fn helical_starts_stay_feasible_for_500_steps() {
    let reference = path(needle(), HELIX, 600);
    // The claim holds for any horizon; a short one meets the terminal set more often and is cheap enough for 500 steps.
    let mut controller = helical(3, &reference);
    let count = feasible(600, 0.6, |xi| {
        descends(
            &mut controller,
            LinearPlant::new(&reference, needle(), xi),
            500,
        )
    });
    assert!(count > 300, "{count}");
}

#[test]
fn straight_starts_descend_and_stay_feasible_for_500_steps() {
    let straight = Needle::new(0.0).unwrap();
    let reference = path(straight, HELIX, 600);
    let mut controller =
        StraightController::new(straight, reference.clone(), certified(3)).unwrap();
    assert!(controller.certificate().unwrap().holds());
    let count = feasible(700, 1.0, |xi| {
        // Depth and roll are all that a straight needle can correct.
        let xi = Vector6::new(0.0, 0.0, 2.0 * xi[2], 0.0, 0.0, 3.0 * xi[5]);
        descends(
            &mut controller,
            LinearPlant::new(&reference, straight, xi),
            500,
        )
    });
    assert!(count > 300, "{count}");
}

#[test]
fn clarabel_sees_the_same_descent_on_the_boundary_of_the_feasible_set() {
    let reference = path(needle(), HELIX, 600);
    let mut controller =
        LtvController::with_solver(needle(), reference.clone(), certified(8), |problem| {
            ClarabelSolver::new(problem, SolverSettings::default())
        })
        .unwrap();
    let count = feasible(200, 1.0, |xi| {
        descends(
            &mut controller,
            LinearPlant::new(&reference, needle(), xi),
            4,
        )
    });
    assert!(count > 50, "{count}");
}
