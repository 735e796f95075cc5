//! The nonlinear controller against the linear one, under a moved world, and on both solvers.

use crate::scene::{CURVATURE_PER_MM, DT_S, Scene};
use mpc_qp::{ClarabelSolver, SolverSettings};
use nalgebra::Vector6;
use needle_control::{
    Controller, Convergence, InputLimits, LinearConfiguration, LinearWeights, LtvController,
    Measurement, NmpcConfiguration, NmpcController, NmpcWeights, SpinTarget, TerminalChoice,
};
use needle_model::{Input, Needle, Pose, ReferencePath};

const HELIX: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 1.0,
};

/// First inputs of a converged nonlinear and a linear controller with equal weights, from the same small error.
fn first_inputs(size: f64) -> [Input; 2] {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let path =
        ReferencePath::from_inputs(needle, Pose::identity(), vec![HELIX; 100], DT_S).unwrap();
    let limits = InputLimits {
        v_min_mm_s: -100.0,
        v_max_mm_s: 100.0,
        omega_max_rad_s: 100.0,
        ..unlimited_rates()
    };
    let weights = NmpcWeights {
        position: 1.0,
        tangent: 10.0,
        roll: 1.0,
        v: 0.1,
        omega: 0.1,
        end_position: 1.0,
        end_tangent: 10.0,
        end_roll: 1.0,
    };
    let nonlinear = NmpcConfiguration {
        limits,
        weights,
        spin_target: SpinTarget::Reference,
        terminal: TerminalChoice::None,
        convergence: Convergence::Full {
            tolerance: 1e-9,
            max_iterations: 50,
        },
        start_iterations: 50,
        ..NmpcConfiguration::default()
    };
    let linear = LinearConfiguration {
        limits,
        terminal: TerminalChoice::None,
        // No weight on changes is allowed to vanish: this one changes the input by 1e-9 of itself.
        weights: LinearWeights {
            v_change: 1e-10,
            omega_change: 1e-10,
            ..LinearWeights::default()
        },
        ..LinearConfiguration::default()
    };
    let xi = Vector6::new(0.5, -0.3, 0.2, 0.02, -0.03, 0.1) * size;
    let measured = Measurement::of(Pose::identity().perturbed(&xi));
    let mut nonlinear = NmpcController::new(needle, path.clone(), nonlinear).unwrap();
    let mut linear = LtvController::new(needle, path, linear).unwrap();
    [
        nonlinear.step(&measured, 0.0).input,
        linear.step(&measured, 0.0).input,
    ]
}

fn unlimited_rates() -> InputLimits {
    InputLimits {
        v_rate_max_mm_s2: f64::INFINITY,
        omega_rate_max_rad_s2: f64::INFINITY,
        ..InputLimits::default()
    }
}

#[test]
fn nonlinear_equals_linear_to_second_order_of_the_error() {
    let gap = |size: f64| {
        let [nonlinear, linear] = first_inputs(size);
        (nonlinear.v_mm_s - linear.v_mm_s)
            .abs()
            .max((nonlinear.omega_rad_s - linear.omega_rad_s).abs())
    };
    let (coarse, fine) = (gap(0.1), gap(0.025));
    // A quarter of the error leaves a sixteenth of the gap; an eighth tells second order from first.
    assert!(fine < coarse / 8.0, "{coarse} {fine}");
    assert!(coarse < 0.1, "{coarse}");
}

#[test]
fn moving_the_world_changes_no_input() {
    let scene = Scene::default();
    let world = Pose::exp(&Vector6::new(30.0, -20.0, 10.0, 1.0, -2.0, 0.5));
    let original = scene.path();
    let poses = original
        .poses()
        .iter()
        .map(|pose| world.compose(pose))
        .collect();
    let moved = ReferencePath::from_samples(poses, original.inputs().to_vec(), DT_S).unwrap();
    let mut here =
        NmpcController::new(scene.model, original, NmpcConfiguration::default()).unwrap();
    let mut there = NmpcController::new(scene.model, moved, NmpcConfiguration::default()).unwrap();
    let mut pose = Pose::exp(&Vector6::new(0.1, -0.2, 0.0, 0.02, -0.01, 0.3));
    for step in 0..5 {
        let time_s = step as f64 * DT_S;
        let input = here.step(&Measurement::of(pose), time_s).input;
        let same = there
            .step(&Measurement::of(world.compose(&pose)), time_s)
            .input;
        // Rounding of 40 mm coordinates, amplified by a program that is not convex; the solver's tolerance is 1e-8.
        assert!(
            (input.v_mm_s - same.v_mm_s).abs() < 1e-4
                && (input.omega_rad_s - same.omega_rad_s).abs() < 1e-4,
            "{step}"
        );
        pose = scene.model.step(&pose, input, DT_S).unwrap();
    }
}

#[test]
fn both_solvers_give_the_same_input() {
    let scene = Scene::default();
    // Solvers agree in the objective to 1e-8; at a spin weight of 4.5e-5 that leaves the spin itself loose by 1e-3.
    let weights = NmpcWeights {
        omega: 1.0,
        v: 10.0,
        position: 100.0,
        tangent: 2500.0,
        ..NmpcWeights::default()
    };
    let configuration = NmpcConfiguration {
        weights,
        start_iterations: 1,
        ..NmpcConfiguration::default()
    };
    let mut structured =
        NmpcController::new(scene.model, scene.path(), configuration.clone()).unwrap();
    let mut clarabel =
        NmpcController::with_solver(scene.model, scene.path(), configuration, |problem| {
            ClarabelSolver::new(problem, SolverSettings::default())
        })
        .unwrap();
    let mut pose = Pose::identity();
    for step in 0..10 {
        let time_s = step as f64 * DT_S;
        let input = structured.step(&Measurement::of(pose), time_s).input;
        let other = clarabel.step(&Measurement::of(pose), time_s).input;
        let difference = (input.v_mm_s - other.v_mm_s)
            .abs()
            .max((input.omega_rad_s - other.omega_rad_s).abs());
        assert!(difference < 1e-5, "step {step}: {input:?} {other:?}");
        pose = scene.model.step(&pose, input, DT_S).unwrap();
    }
}

#[test]
fn symmetric_start_is_broken_by_the_controller_itself() {
    // A straight path, a bevelled needle, no spin in the reference: at rest the gradient by the spin is zero.
    let scene = Scene {
        path_curvature_ratio: 0.0,
        torsion_rad_per_mm: 0.0,
        ..Scene::default()
    };
    let mut controller =
        NmpcController::new(scene.model, scene.path(), NmpcConfiguration::default()).unwrap();
    let input = controller
        .step(&Measurement::of(Pose::identity()), 0.0)
        .input;
    assert!(input.omega_rad_s.abs() > 0.1, "{input:?}");
}
