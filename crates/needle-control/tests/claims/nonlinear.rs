//! The nonlinear controller against the linear one, under a moved world, and from a symmetric start.

use crate::linear::{largest_difference_under_a_move, moved};
use crate::scene::{CURVATURE_PER_MM, DT_S, Scene, apart};
use nalgebra::Vector6;
use needle_control::{
    Controller, Convergence, InputLimits, LinearConfiguration, LinearWeights, LtvController,
    Measurement, NmpcConfiguration, NmpcController, NmpcWeights, SpinTarget, TerminalChoice,
    Tracking,
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
        apart(nonlinear, linear)
    };
    let gaps = [0.1, 0.05, 0.025].map(gap);
    println!("{gaps:?}");
    for pair in gaps.windows(2) {
        // Half of the error leaves a quarter of the gap, up to the third order, a tenth here; a half would be first order.
        let rate = (pair[0] / pair[1]).log2();
        assert!((1.8..2.3).contains(&rate), "order {rate}: {gaps:?}");
    }
    assert!(gaps[0] < 0.1, "{gaps:?}");
}

#[test]
fn moving_the_world_changes_no_input() {
    let scene = Scene::default();
    let original = scene.path();
    let start = Pose::exp(&Vector6::new(0.1, -0.2, 0.0, 0.02, -0.01, 0.3));
    for tracking in [Tracking::Time, Tracking::Progress] {
        let made = |path| {
            let configuration = NmpcConfiguration {
                tracking,
                ..NmpcConfiguration::default()
            };
            NmpcController::new(scene.model, path, configuration).unwrap()
        };
        let (mut here, mut there) = (made(original.clone()), made(moved(&original)));
        let difference =
            largest_difference_under_a_move([&mut here, &mut there], scene.model, start, 5);
        // Rounding of 40 mm coordinates, amplified by a program that is not convex; the solver's tolerance is 1e-8.
        assert!(difference < 1e-4, "{tracking:?}: {difference}");
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
