//! Closed-form arcs against the plant that executes them.

use nalgebra::Vector3;
use needle_model::{Arc, ArcError, Input, Needle, Pose};
use proptest::prelude::*;

use crate::kinematics::twist_within;

fn target() -> impl Strategy<Value = Vector3<f64>> {
    let c = prop_oneof![Just(0.0), -1e-9..1e-9_f64, -80.0..80.0_f64];
    (c.clone(), c, -20.0..100.0_f64).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn turn(pose: &Pose, angle_rad: f64) -> Pose {
    let spin = Input {
        v_mm_s: 0.0,
        omega_rad_s: angle_rad,
    };
    Needle::new(0.0).unwrap().step(pose, spin, 1.0).unwrap()
}

proptest! {
    #[test]
    fn a_needle_of_the_arcs_curvature_ends_at_the_target(at in twist_within(50.0, 3.0), q in target()) {
        let start = Pose::exp(&at);
        let goal = start.position_mm + start.rotation * q;
        // Straight behind the tip there is no arc, and close to that it is as long as one likes.
        prop_assume!(q.z > 0.0 || q.xy().norm() > 1e-3);
        let arc = Arc::to_point(&start, &goal).unwrap();
        let (insertion, duration_s) = arc.insertion(5.0).unwrap();
        let needle = Needle::new(arc.curvature_per_mm).unwrap();
        let end = needle.step(&turn(&start, arc.bevel_roll_rad), insertion, duration_s).unwrap();
        // Rounding of the coordinates (1e-14) grows with the length of the arc over its chord.
        let tolerance = 1e-12 * (1.0 + arc.length_mm);
        prop_assert!((end.position_mm - goal).norm() < tolerance, "{end:?} {goal:?}");
        prop_assert!(end.error_from(&arc.end).norm() < tolerance);
    }

    #[test]
    fn the_arc_between_the_poses_of_an_arc_is_that_arc(
        at in twist_within(50.0, 3.0), roll in -3.0..3.0_f64, final_roll in -3.0..3.0_f64,
        kappa in 1e-4..0.03_f64, length in 1.0..100.0_f64,
    ) {
        let start = Pose::exp(&at);
        let insertion = Input { v_mm_s: length, omega_rad_s: 0.0 };
        let end = Needle::new(kappa).unwrap().step(&turn(&start, roll), insertion, 1.0).unwrap();
        let target = turn(&end, final_roll);
        let (arc, last) = Arc::to_pose(&start, &target, 1e-9).unwrap();
        prop_assert!((arc.curvature_per_mm - kappa).abs() < 1e-12);
        prop_assert!((arc.length_mm - length).abs() < 1e-10);
        prop_assert!(turn(&arc.end, last).error_from(&target).norm() < 1e-9);
    }
}

proptest! {
    #[test]
    fn behind_any_pose_there_is_no_arc(at in twist_within(50.0, 3.0), behind_mm in 0.0..100.0_f64) {
        let start = Pose::exp(&at);
        let goal = start.position_mm - start.tangent() * behind_mm;
        let arc = Arc::to_point(&start, &goal);
        let refused = matches!(arc, Err(ArcError::Unreachable { behind_mm: found })
            if (found - behind_mm).abs() < 1e-12 * 200.0);
        prop_assert!(refused, "{arc:?}");
    }

    #[test]
    fn a_needle_can_make_the_arc_that_it_made(
        at in twist_within(50.0, 3.0), kappa in 1e-4..0.05_f64, length in 1.0..60.0_f64,
    ) {
        let (needle, start) = (Needle::new(kappa).unwrap(), Pose::exp(&at));
        let insertion = Input { v_mm_s: length, omega_rad_s: 0.0 };
        let end = needle.step(&start, insertion, 1.0).unwrap();
        let arc = Arc::to_point(&start, &end.position_mm).unwrap();
        // Short and gentle arcs have curvatures known to rounding over sag: 1e-14 / (kappa s^2 / 2).
        prop_assume!(kappa * length * length > 1e-4);
        let duty = arc.duty_cycle(needle);
        prop_assert!(duty.is_ok_and(|d| (0.0..1e-8).contains(&d.fraction())), "{duty:?}");
    }
}

#[test]
fn targets_almost_straight_ahead_have_finite_arcs() {
    for rho in [5e-324, 1e-320, 1e-300, 1e-200, 1e-20, 1e-9] {
        let goal = Vector3::new(0.0, -rho, 30.0);
        let arc = Arc::to_point(&Pose::identity(), &goal).unwrap();
        assert!((arc.length_mm - 30.0).abs() < 1e-12 && arc.end.is_finite());
    }
    let far = Arc::to_point(&Pose::identity(), &Vector3::new(1e307, 0.0, 1e307)).unwrap();
    assert!(far.length_mm.is_finite() && far.curvature_per_mm >= 0.0);
}

#[test]
fn a_tolerance_that_is_no_number_accepts_no_pose() {
    let mut ahead = Pose::identity();
    ahead.position_mm.z = 10.0;
    assert!(Arc::to_pose(&Pose::identity(), &ahead, 0.0).is_ok());
    assert!(Arc::to_pose(&Pose::identity(), &ahead, f64::NAN).is_err());
}

#[test]
fn an_insertion_needs_a_positive_finite_speed() {
    let arc = Arc::to_point(&Pose::identity(), &Vector3::new(0.0, 0.0, 10.0)).unwrap();
    for v in [0.0, -1.0, f64::NAN, f64::INFINITY, 5e-324] {
        assert_eq!(arc.insertion(v), None, "{v}");
    }
}

#[test]
fn targets_at_or_behind_the_tip_are_refused() {
    for z in [0.0, -3.0] {
        let error = Arc::to_point(&Pose::identity(), &Vector3::new(0.0, 0.0, z));
        assert_eq!(error, Err(ArcError::Unreachable { behind_mm: -z }));
    }
}

#[test]
fn poses_that_no_arc_joins_name_the_angle() {
    let mut target = Pose::identity();
    target.position_mm = Vector3::new(0.0, -10.0, 10.0);
    // The arc arrives at a right angle; the target's tangent is along z.
    let Err(ArcError::TangentMismatch { angle_rad }) =
        Arc::to_pose(&Pose::identity(), &target, 0.1)
    else {
        panic!("no arc exists");
    };
    assert!((angle_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-14);
}

#[test]
fn too_sharp_an_arc_has_no_duty_cycle_and_a_gentle_one_has() {
    let needle = Needle::new(0.01).unwrap();
    let gentle = Arc::to_point(&Pose::identity(), &Vector3::new(0.0, -10.0, 70.0)).unwrap();
    let sharp = Arc::to_point(&Pose::identity(), &Vector3::new(0.0, -30.0, 30.0)).unwrap();
    let duty = gentle.duty_cycle(needle).unwrap();
    assert!((duty.averaged(needle).curvature_per_mm() - gentle.curvature_per_mm).abs() < 1e-16);
    assert!(sharp.duty_cycle(needle).is_err() && !sharp.exceeds_half_turn());
}
