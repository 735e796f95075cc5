//! The plant on SE(3) against closed forms and a matrix exponential.

use std::f64::consts::PI;

use nalgebra::{Matrix4, Vector3, Vector6};
use needle_model::{Input, Needle, Pose, StepError};
use proptest::prelude::*;

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

fn needle(curvature_per_mm: f64) -> Needle {
    Needle::new(curvature_per_mm).expect("valid curvature")
}

pub(crate) fn twist_within(
    linear_mm: f64,
    angular_rad: f64,
) -> impl Strategy<Value = Vector6<f64>> {
    let (l, a) = (-linear_mm..linear_mm, -angular_rad..angular_rad);
    (l.clone(), l.clone(), l, a.clone(), a.clone(), a)
        .prop_map(|(x, y, z, p, q, r)| Vector6::new(x, y, z, p, q, r))
}

fn homogeneous_twist(xi: &Vector6<f64>) -> Matrix4<f64> {
    let mut m = Vector3::new(xi[3], xi[4], xi[5])
        .cross_matrix()
        .to_homogeneous();
    m[(3, 3)] = 0.0;
    for i in 0..3 {
        m[(i, 3)] = xi[i];
    }
    m
}

#[test]
fn without_rotation_the_tip_traces_a_circle_of_radius_one_over_kappa() {
    let steps = 1000;
    let turn_mm = std::f64::consts::TAU / KAPPA_PER_MM;
    let input = Input {
        v_mm_s: 10.0,
        omega_rad_s: 0.0,
    };
    let dt_s = turn_mm / 10.0 / f64::from(steps);
    let centre = Vector3::new(0.0, -1.0 / KAPPA_PER_MM, 0.0);
    let mut pose = Pose::identity();
    let mut worst_mm = 0.0_f64;
    for _ in 0..steps {
        pose = needle(KAPPA_PER_MM).step(&pose, input, dt_s).unwrap();
        let radius_mm = (pose.position_mm - centre).norm();
        worst_mm = worst_mm.max((radius_mm - 1.0 / KAPPA_PER_MM).abs());
    }
    // Absolute; rounding of 1000 compositions at 150 mm is half of it.
    assert!(worst_mm < 1e-12, "{worst_mm:e}");
    assert!(pose.position_mm.norm() < 1e-12);
}

#[test]
fn an_untwisted_needle_bends_toward_minus_y() {
    let input = Input {
        v_mm_s: 1.0,
        omega_rad_s: 0.0,
    };
    let p = needle(KAPPA_PER_MM)
        .step(&Pose::identity(), input, 10.0)
        .unwrap()
        .position_mm;
    assert!(p.y < 0.0 && p.x == 0.0 && p.z > 0.0);
}

#[test]
fn constant_rotation_gives_the_helix_of_closed_form_radius_and_pitch() {
    // Body twist (v e3, w): the axis is w = (kappa v, 0, omega), so the radius is
    // |w x v| / |w|^2 = kappa v^2 / |w|^2 and the pitch 2 pi (w . v) / |w|^2.
    for (kappa, v, omega) in [
        (KAPPA_PER_MM, 10.0, 1.0),
        (0.02, 5.0, -0.3),
        (1e-4, 3.0, 4.0),
    ] {
        let w = Vector3::new(kappa * v, 0.0, omega);
        let radius_mm = kappa * v * v / w.norm_squared();
        let pitch_mm = std::f64::consts::TAU * omega * v / w.norm_squared();
        let point_on_axis = w.cross(&Vector3::new(0.0, 0.0, v)) / w.norm_squared();
        let axis = w.normalize();
        let period_s = std::f64::consts::TAU / w.norm();
        let steps = 97;
        let input = Input {
            v_mm_s: v,
            omega_rad_s: omega,
        };
        let mut pose = Pose::identity();
        for _ in 0..steps {
            pose = needle(kappa)
                .step(&pose, input, period_s / f64::from(steps))
                .unwrap();
            let from_axis = (pose.position_mm - point_on_axis).cross(&axis).norm();
            assert!((from_axis - radius_mm).abs() < 1e-12 * (1.0 + pitch_mm.abs()));
        }
        let advance = pose.position_mm.dot(&axis);
        // One period turns the body once about the axis: rounding of 97 steps only.
        assert!((advance - pitch_mm).abs() < 1e-11 * (1.0 + pitch_mm.abs()));
    }
}

#[test]
fn rotations_stay_orthonormal_over_a_million_steps() {
    let needle = needle(KAPPA_PER_MM);
    let mut pose = Pose::identity();
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 3.7,
    };
    for _ in 0..1_000_000 {
        pose = needle.step(&pose, input, 1e-3).unwrap();
    }
    let r = pose.rotation_matrix();
    let drift = (r.transpose() * r - nalgebra::Matrix3::identity()).norm();
    // A few units in the last place: the drift does not grow with the number of steps.
    assert!(drift < 2e-15, "{drift:e}");
}

#[test]
fn invalid_steps_are_errors_as_values() {
    let n = needle(KAPPA_PER_MM);
    let good = Input {
        v_mm_s: 1.0,
        omega_rad_s: 0.0,
    };
    let bad = Input {
        v_mm_s: f64::NAN,
        omega_rad_s: 0.0,
    };
    let mut lost = Pose::identity();
    lost.position_mm.x = f64::INFINITY;
    assert!(Needle::new(-1.0).is_err() && Needle::new(f64::NAN).is_err());
    assert_eq!(n.step(&lost, good, 0.1), Err(StepError::NonFiniteState));
    assert!(matches!(
        n.step(&Pose::identity(), bad, 0.1),
        Err(StepError::NonFiniteInput { .. })
    ));
    assert!(matches!(
        n.step(&Pose::identity(), good, -0.1),
        Err(StepError::InvalidTimeStep { .. })
    ));
}

proptest! {
    #[test]
    fn exponential_equals_the_matrix_exponential(xi in twist_within(50.0, 6.0)) {
        let truth = homogeneous_twist(&xi).exp();
        let error = (Pose::exp(&xi).to_homogeneous() - truth).norm();
        // Scaling and squaring itself is accurate to some 1e-14 of the norm.
        prop_assert!(error < 1e-12 * (1.0 + truth.norm()), "{error:e}");
    }

    #[test]
    fn logarithm_inverts_the_exponential(
        direction in twist_within(1.0, 1.0),
        angle in prop_oneof![0.0..1e-7, 0.0..1e-3, 0.0..PI - 1e-4],
        length_mm in prop_oneof![0.0..1e-6, 0.0..1e3],
    ) {
        let norm = direction.fixed_rows::<3>(3).norm().max(1e-9);
        let mut xi: Vector6<f64> = direction * (angle / norm);
        for i in 0..3 {
            xi[i] = direction[i] * length_mm;
        }
        prop_assume!(xi.fixed_rows::<3>(3).norm() < PI - 1e-4);
        let error = (Pose::exp(&xi).log() - xi).norm();
        // At an angle of pi - 1e-4 the half angle is still well conditioned: rounding only.
        prop_assert!(error < 1e-13 * (1.0 + xi.norm()), "{error:e}");
    }

    #[test]
    fn moving_the_world_frame_changes_nothing(
        world in twist_within(100.0, 3.0),
        start in twist_within(100.0, 3.0),
        v in -20.0..20.0_f64, omega in -30.0..30.0_f64, kappa in prop_oneof![Just(0.0), 0.0..0.1],
    ) {
        let (world, start) = (Pose::exp(&world), Pose::exp(&start));
        let input = Input { v_mm_s: v, omega_rad_s: omega };
        let n = needle(kappa);
        let moved = n.step(&world.compose(&start), input, 0.1).unwrap();
        let stepped = world.compose(&n.step(&start, input, 0.1).unwrap());
        // Positions are some 300 mm: 1e-12 mm is their rounding.
        prop_assert!(moved.error_from(&stepped).norm() < 1e-12);
    }

    #[test]
    fn two_half_steps_are_one_step(
        v in -20.0..20.0_f64, omega in -30.0..30.0_f64, kappa in prop_oneof![Just(0.0), 0.0..0.1],
    ) {
        let input = Input { v_mm_s: v, omega_rad_s: omega };
        let n = needle(kappa);
        let once = n.step(&Pose::identity(), input, 0.2).unwrap();
        let half = n.step(&Pose::identity(), input, 0.1).unwrap();
        let twice = n.step(&half, input, 0.1).unwrap();
        prop_assert!(twice.error_from(&once).norm() < 1e-13);
    }
}
