//! Jacobians of discrete steps and residuals against finite differences and matrix exponentials.

use nalgebra::{SMatrix, Vector6};
use needle_model::{
    EulerIntegrator, EulerPlant, EulerState, Input, Needle, Pose, pose_residual, position_residual,
    se3, tangent_residual,
};
use proptest::prelude::*;

use crate::chart::chart_point;
use crate::finite_difference::derivative;
use crate::kinematics::twist_within;

/// Step of the differences: with values up to 100 mm, truncation h^4 |f'''''| and rounding
/// 1e-14 / h balance near 1e-3; both are then about 1e-11.
const H: f64 = 1e-3;

fn input() -> impl Strategy<Value = Input> {
    let v = prop_oneof![Just(0.0), -1e-6..1e-6_f64, -20.0..20.0_f64];
    let omega = prop_oneof![Just(0.0), -1e-6..1e-6_f64, -20.0..20.0_f64];
    (v, omega).prop_map(|(v_mm_s, omega_rad_s)| Input {
        v_mm_s,
        omega_rad_s,
    })
}

fn curvature() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), 0.0..1e-6_f64, 0.0..0.05_f64]
}

fn ith(i: usize, t: f64) -> Vector6<f64> {
    Vector6::ith(i, t)
}

proptest! {
    #[test]
    fn step_jacobians_equal_the_augmented_matrix_exponential(
        input in input(), kappa in curvature(), dt in prop_oneof![Just(0.0), 1e-4..1.0_f64],
    ) {
        let needle = Needle::new(kappa).unwrap();
        let j = needle.linearise(input, dt).unwrap();
        // exp([[-ad_V, V1, V2, dV/dkappa], [0, 0]] dt) = [[A, B, b_kappa], [0, I]].
        let mut m = SMatrix::<f64, 9, 9>::zeros();
        m.fixed_view_mut::<6, 6>(0, 0).copy_from(&(-se3::ad(&needle.twist(input))));
        m[(2, 6)] = 1.0;
        m[(3, 6)] = kappa;
        m[(5, 7)] = 1.0;
        m[(3, 8)] = input.v_mm_s;
        let truth = (m * dt).exp();
        // Two values of 20 at most; scaling and squaring loses two digits of 1e-16.
        let tolerance = 2e-13 * (1.0 + truth.norm());
        prop_assert!((j.a - truth.fixed_view::<6, 6>(0, 0)).norm() < tolerance);
        prop_assert!((j.b - truth.fixed_view::<6, 2>(0, 6)).norm() < tolerance);
        prop_assert!((j.curvature - truth.fixed_view::<6, 1>(0, 8)).norm() < tolerance);
    }

    #[test]
    fn step_jacobians_equal_central_differences(
        at in twist_within(50.0, 3.0), input in input(), kappa in 0.01..0.05_f64, dt in 1e-3..0.3_f64,
    ) {
        let needle = Needle::new(kappa).unwrap();
        let pose = Pose::exp(&at);
        let next = needle.step(&pose, input, dt).unwrap();
        let j = needle.linearise(input, dt).unwrap();
        for i in 0..6 {
            let column = derivative(H, |t| {
                needle.step(&pose.perturbed(&ith(i, t)), input, dt).unwrap().error_from(&next)
            });
            prop_assert!((column - j.a.column(i)).norm() < 1e-9);
        }
        let by_v = derivative(H, |t| {
            let moved = Input { v_mm_s: input.v_mm_s + t, ..input };
            needle.step(&pose, moved, dt).unwrap().error_from(&next)
        });
        let by_omega = derivative(H, |t| {
            let moved = Input { omega_rad_s: input.omega_rad_s + t, ..input };
            needle.step(&pose, moved, dt).unwrap().error_from(&next)
        });
        let by_curvature = derivative(H, |t| {
            Needle::new(kappa + t).unwrap().step(&pose, input, dt).unwrap().error_from(&next)
        });
        prop_assert!((by_v - j.b.column(0)).norm() < 1e-9);
        prop_assert!((by_omega - j.b.column(1)).norm() < 1e-9);
        // h^4 times the fifth derivative by curvature, (v dt)^5 with v dt up to 6 mm.
        prop_assert!((by_curvature - j.curvature).norm() < 1e-8);
    }

    #[test]
    fn error_of_the_same_input_propagates_without_remainder(
        at in twist_within(50.0, 3.0), xi in twist_within(5.0, 1.0), input in input(), kappa in curvature(),
    ) {
        let needle = Needle::new(kappa).unwrap();
        let pose = Pose::exp(&at);
        let moved = needle.step(&pose.perturbed(&xi), input, 0.1).unwrap();
        let error = moved.error_from(&needle.step(&pose, input, 0.1).unwrap());
        let predicted = needle.linearise(input, 0.1).unwrap().a * xi;
        // Not first order but exact, for errors of any size below half a turn.
        prop_assert!((error - predicted).norm() < 1e-12 * (1.0 + error.norm()));
    }

    #[test]
    fn jacobian_inverses_invert(xi in twist_within(20.0, 1.8)) {
        // Angles up to pi, where the inverse is regular and the half-angle tangent is not.
        let i = nalgebra::Matrix6::identity();
        prop_assert!((se3::left_jacobian(&xi) * se3::left_jacobian_inverse(&xi) - i).norm() < 1e-11);
        prop_assert!((se3::right_jacobian(&xi) * se3::right_jacobian_inverse(&xi) - i).norm() < 1e-11);
    }

    #[test]
    fn step_residual_jacobians_equal_central_differences(
        at in twist_within(50.0, 3.0), defect in twist_within(2.0, 1.0), input in input(),
        kappa in 0.01..0.05_f64,
    ) {
        let needle = Needle::new(kappa).unwrap();
        let pose = Pose::exp(&at);
        let target = needle.step(&pose, input, 0.1).unwrap().perturbed(&defect);
        let r = needle.step_residual(&pose, input, &target, 0.1).unwrap();
        let value = |p: &Pose, u: Input, t: &Pose, k: f64| {
            Needle::new(k).unwrap().step_residual(p, u, t, 0.1).unwrap().value
        };
        // The defect turns up to 1.7 rad, where fifth derivatives of the logarithm are of order 10.
        let tolerance = 1e-8;
        for i in 0..6 {
            let by_pose = derivative(H, |t| value(&pose.perturbed(&ith(i, t)), input, &target, kappa));
            let by_target = derivative(H, |t| value(&pose, input, &target.perturbed(&ith(i, t)), kappa));
            prop_assert!((by_pose - r.by_pose.column(i)).norm() < tolerance);
            prop_assert!((by_target - r.by_target.column(i)).norm() < tolerance);
        }
        let by_v = derivative(H, |t| value(&pose, Input { v_mm_s: input.v_mm_s + t, ..input }, &target, kappa));
        let by_omega = derivative(H, |t| value(&pose, Input { omega_rad_s: input.omega_rad_s + t, ..input }, &target, kappa));
        let by_curvature = derivative(H, |t| value(&pose, input, &target, kappa + t));
        prop_assert!((by_v - r.by_input.column(0)).norm() < tolerance);
        prop_assert!((by_omega - r.by_input.column(1)).norm() < tolerance);
        prop_assert!((by_curvature - r.by_curvature).norm() < tolerance);
    }

    #[test]
    fn pose_position_and_tangent_jacobians_equal_central_differences(
        at in twist_within(50.0, 3.0), off in twist_within(5.0, 1.0),
    ) {
        let reference = Pose::exp(&at);
        let pose = reference.perturbed(&off);
        let target = reference.position_mm;
        let full = pose_residual(&pose, &reference).unwrap();
        let position = position_residual(&pose, &target);
        let tangent = tangent_residual(&pose, &reference.tangent());
        for i in 0..6 {
            let moved = |t: f64| pose.perturbed(&ith(i, t));
            let d = derivative(H, |t| pose_residual(&moved(t), &reference).unwrap().value);
            prop_assert!((d - full.by_pose.column(i)).norm() < 1e-8);
            let d = derivative(H, |t| pose_residual(&pose, &reference.perturbed(&ith(i, t))).unwrap().value);
            prop_assert!((d - full.by_reference.column(i)).norm() < 1e-8);
            let d = derivative(H, |t| position_residual(&moved(t), &target).value);
            prop_assert!((d - position.by_pose.column(i)).norm() < 1e-9);
            let d = derivative(H, |t| tangent_residual(&moved(t), &reference.tangent()).value);
            prop_assert!((d - tangent.by_pose.column(i)).norm() < 1e-9);
        }
    }

    #[test]
    fn chart_jacobians_of_every_integrator_equal_central_differences(
        state in chart_point(), input in input(), kappa in curvature(), dt in 1e-3..0.2_f64,
    ) {
        for integrator in [EulerIntegrator::ForwardEuler, EulerIntegrator::PaperOrder, EulerIntegrator::Rk4] {
            let plant = EulerPlant { needle: Needle::new(kappa).unwrap(), integrator };
            // A stage of Runge-Kutta may step over the singularity: such draws prove nothing.
            let Ok(j) = plant.linearise(&state, input, dt) else { continue };
            let beyond = state.beta_rad.abs() + kappa * input.v_mm_s.abs() * dt;
            prop_assume!(beyond < 1.45);
            // Near beta = 1.45, sec(beta) = 8: fifth derivatives grow as sec^6, h^4 with h = 1e-4.
            let h = 1e-4;
            for i in 0..6 {
                let column = derivative(h, |t| {
                    let moved = EulerState::from_vector(&(state.to_vector() + ith(i, t)));
                    plant.step(&moved, input, dt).unwrap().to_vector()
                });
                prop_assert!((column - j.a.column(i)).norm() < 1e-8, "{integrator:?} {i}");
            }
            let by_v = derivative(h, |t| {
                plant.step(&state, Input { v_mm_s: input.v_mm_s + t, ..input }, dt).unwrap().to_vector()
            });
            let by_omega = derivative(h, |t| {
                plant.step(&state, Input { omega_rad_s: input.omega_rad_s + t, ..input }, dt).unwrap().to_vector()
            });
            prop_assert!((by_v - j.b.column(0)).norm() < 1e-8, "{integrator:?} v");
            prop_assert!((by_omega - j.b.column(1)).norm() < 1e-8, "{integrator:?} omega");
        }
    }

    #[test]
    fn the_step_solved_for_its_target_is_exact_to_first_order_at_any_finite_defect(
        at in twist_within(50.0, 3.0), defect in twist_within(2.0, 1.0),
        delta in twist_within(1.0, 1.0), input in input(), kappa in curvature(),
    ) {
        let needle = Needle::new(kappa).unwrap();
        let pose = Pose::exp(&at);
        let end = needle.step(&pose, input, 0.1).unwrap();
        for share in [0.0, 0.1, 1.0] {
            let target = end.perturbed(&(defect * share));
            let step = needle.step_residual(&pose, input, &target, 0.1).unwrap().solved_for_target();
            // The defect stays; only the perturbation shrinks. What the linear map misses is second
            // order in it, so central differences see the map to their own fourth order.
            let moved = |t: f64| {
                let u = Input { v_mm_s: input.v_mm_s + t, omega_rad_s: input.omega_rad_s - t };
                needle.step(&pose.perturbed(&(delta * t)), u, 0.1).unwrap().error_from(&target)
            };
            let predicted = step.a * delta + step.b * nalgebra::Vector2::new(1.0, -1.0);
            let error = (derivative(H, moved) - predicted).norm();
            prop_assert!((moved(0.0) - step.c).norm() < 1e-12);
            prop_assert!(error < 1e-8 * (1.0 + predicted.norm()), "{share} {error:e}");
        }
    }
}

#[test]
fn at_a_fixed_defect_the_step_solved_for_its_target_errs_by_the_square_of_the_perturbation() {
    let needle = Needle::new(1.0 / 150.0).unwrap();
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 1.0,
    };
    let pose = Pose::exp(&Vector6::new(10.0, -4.0, 30.0, 0.4, -0.2, 1.1));
    let end = needle.step(&pose, input, 0.1).unwrap();
    let delta = Vector6::new(0.3, -0.5, 0.2, 0.4, 0.1, -0.6);
    for defect in [
        Vector6::new(0.5, -0.3, 0.4, 0.3, 0.2, -0.5),
        Vector6::new(-2.0, 1.0, 3.0, 0.0, 0.9, 0.7),
        Vector6::new(0.0, 0.0, 1.0, -1.2, 0.3, 0.1),
    ] {
        let target = end.perturbed(&defect);
        let step = needle
            .step_residual(&pose, input, &target, 0.1)
            .unwrap()
            .solved_for_target();
        let missed = |t: f64| {
            let next = needle.step(&pose.perturbed(&(delta * t)), input, 0.1);
            let truth = next.unwrap().error_from(&target);
            (truth - step.a * delta * t - step.c).norm()
        };
        // Halving the perturbation quarters what is missed; the next term is 1e-3 of it.
        let ratio = missed(1e-3) / missed(5e-4);
        assert!((ratio - 4.0).abs() < 0.05, "{defect} {ratio}");
    }
}
