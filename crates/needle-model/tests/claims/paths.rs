//! Reference paths, windows, progress along them, and their files.

use nalgebra::{Vector3, Vector6};
use needle_model::{
    Input, Needle, PATH_CSV_HEADER, PathFileError, PathProgress, PlannerFile, Pose, ReferencePath,
    ReferencePathError, StepError, read_planner_poses, write_planner_poses,
};
use proptest::prelude::*;

use crate::kinematics::twist_within;

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

fn needle() -> Needle {
    Needle::new(KAPPA_PER_MM).unwrap()
}

fn weaving(steps: usize) -> ReferencePath {
    let inputs = (0..steps)
        .map(|k| Input {
            v_mm_s: 5.0,
            omega_rad_s: (k as f64 * 0.11).sin(),
        })
        .collect();
    ReferencePath::from_inputs(needle(), Pose::identity(), inputs, 0.1).unwrap()
}

#[test]
fn poses_give_back_the_inputs_that_made_them() {
    let path = weaving(80);
    let again = ReferencePath::from_poses(path.poses().to_vec(), 0.1).unwrap();
    for (a, b) in path.inputs().iter().zip(again.inputs()) {
        // Logarithm of a step of 0.5 mm at positions of 40 mm: rounding 1e-14 over dt = 0.1.
        assert!((a.v_mm_s - b.v_mm_s).abs() < 1e-11);
        assert!((a.omega_rad_s - b.omega_rad_s).abs() < 1e-11);
    }
    let (_, defect) = again.largest_defect(needle()).unwrap().unwrap();
    assert!(defect.norm() < 1e-12);
}

#[test]
fn poses_that_no_needle_can_execute_have_a_defect() {
    let mut sideways = Pose::identity();
    sideways.position_mm.x = 1.0;
    let path = ReferencePath::from_poses(vec![Pose::identity(), sideways], 0.1).unwrap();
    let (step, defect) = path.largest_defect(needle()).unwrap().unwrap();
    assert_eq!(step, 0);
    assert!((defect.norm() - 1.0).abs() < 1e-12);
}

#[test]
fn interpolated_poses_lie_on_the_executed_path() {
    let path = weaving(20);
    let half = needle()
        .step(&path.poses()[7], path.inputs()[7], 0.05)
        .unwrap();
    assert!(path.pose_at_time(0.75).error_from(&half).norm() < 1e-13);
    assert_eq!(path.pose_at_time(99.0), path.poses()[20]);
    assert_eq!(path.pose_at_time(f64::NAN), path.poses()[0]);
}

#[test]
fn the_papers_recipe_has_61_poses_and_ends_at_rest() {
    let path = ReferencePath::paper_recipe(needle()).unwrap();
    assert_eq!((path.poses().len(), path.inputs().len()), (61, 60));
    assert_eq!(path.inputs()[59].v_mm_s, 0.0);
    assert!((path.arc_length_mm()[60] - 54.5).abs() < 1e-12);
    // The authors' forward Euler lags by half a step of bending: v dt / 2 times 0.36 rad = 0.18 mm.
    let end = path.poses()[60].position_mm;
    assert!((end - Vector3::new(0.0147752275, -9.61980679, 53.3393393)).norm() < 0.25);
}

#[test]
fn a_window_past_the_end_repeats_the_last_pose_with_zero_input() {
    let path = weaving(10);
    let window = path.window(8, 5);
    assert_eq!((window.poses.len(), window.inputs.len()), (6, 5));
    assert_eq!(window.poses[..3], path.poses()[8..]);
    assert!(window.poses[3..].iter().all(|p| *p == path.poses()[10]));
    assert_eq!(window.inputs[..2], path.inputs()[8..]);
    assert!(window.inputs[2..].iter().all(|u| *u == Input::ZERO));
    assert_eq!(path.window_at_time(0.84, 5), window);
}

#[test]
fn progress_does_not_jump_where_a_path_crosses_itself() {
    // A full circle and a bit more: the end passes the start.
    let steps = 1000;
    let turn = Input {
        v_mm_s: std::f64::consts::TAU * 1.02 / KAPPA_PER_MM / 100.0,
        omega_rad_s: 0.0,
    };
    let path =
        ReferencePath::from_inputs(needle(), Pose::identity(), vec![turn; steps], 0.1).unwrap();
    let mut progress = PathProgress::from_start(20);
    for pose in path.poses() {
        let before = progress.step();
        let step = progress.advance(&path, &pose.position_mm);
        assert!(step >= before && step <= before + 1);
    }
    assert_eq!(progress.step(), steps);
    let again = progress.advance(&path, &path.poses()[0].position_mm);
    assert_eq!(again, steps);
}

proptest! {
    #[test]
    fn tracked_progress_is_the_global_nearest_for_a_tip_near_the_path(
        offsets in prop::collection::vec(twist_within(0.2, 0.1), 50),
    ) {
        let path = weaving(150);
        let mut progress = PathProgress::from_start(30);
        let mut expected = 0;
        for (i, xi) in offsets.iter().enumerate() {
            let tip = path.poses()[3 * i].perturbed(xi).position_mm;
            let global = PathProgress::acquired(&path, &tip, 1).step();
            expected = expected.max(global);
            prop_assert_eq!(progress.advance(&path, &tip), expected);
        }
    }

    #[test]
    fn csv_round_trips_to_the_same_bits(
        start in twist_within(100.0, 3.0), v in prop::collection::vec(-20.0..20.0_f64, 1..20), dt in 1e-3..1.0_f64,
    ) {
        let inputs = v.iter().map(|&v| Input { v_mm_s: v, omega_rad_s: -v * 0.3 }).collect();
        let path = ReferencePath::from_inputs(needle(), Pose::exp(&start), inputs, dt).unwrap();
        prop_assert_eq!(ReferencePath::from_csv(&path.to_csv()).unwrap(), path);
    }

    #[test]
    fn planner_files_round_trip_in_both_orders(xi in twist_within(300.0, 3.0)) {
        let poses = vec![Pose::exp(&xi), Pose::identity()];
        for file in [PlannerFile::StartAndGoal, PlannerFile::InterpolatedPlan] {
            let back = read_planner_poses(&write_planner_poses(&poses, file), file).unwrap();
            for (a, b) in poses.iter().zip(&back) {
                prop_assert!(a.position_mm == b.position_mm && a.rotation.angle_to(&b.rotation) < 1e-7);
                // angle_to goes through acos, which loses half the digits near zero.
                prop_assert!(a.error_from(b).norm() < 1e-14);
            }
        }
    }
}

#[test]
fn the_planners_needle_bends_toward_its_plus_x_after_conversion() {
    // An untwisted needle at the planner's identity, in its two orders.
    for (text, file) in [
        ("0 0 0 1 0 0 0", PlannerFile::StartAndGoal),
        ("0 0 0 0 0 0 1\n", PlannerFile::InterpolatedPlan),
    ] {
        let start = read_planner_poses(text, file).unwrap()[0];
        let input = Input {
            v_mm_s: 10.0,
            omega_rad_s: 0.0,
        };
        let end = needle().step(&start, input, 1.0).unwrap();
        let angle = 10.0 * KAPPA_PER_MM;
        // The planner's arc: center at +x, turn about +y.
        let x = (1.0 - angle.cos()) / KAPPA_PER_MM;
        let z = angle.sin() / KAPPA_PER_MM;
        assert!((end.position_mm - Vector3::new(x, 0.0, z)).norm() < 1e-13);
    }
}

#[test]
fn the_two_orders_of_a_published_start_pose_differ() {
    let text = "-64.8324 139.4900 -654.0964 0.920491 -0.0655092 -0.385233 0";
    let right = read_planner_poses(text, PlannerFile::StartAndGoal).unwrap()[0];
    let wrong = read_planner_poses(text, PlannerFile::InterpolatedPlan).unwrap()[0];
    assert!(right.tangent().dot(&wrong.tangent()) < 0.5);
}

#[test]
fn bad_files_name_line_and_reason() {
    let plan = |text: &str| read_planner_poses(text, PlannerFile::StartAndGoal);
    assert_eq!(plan("\n\n"), Err(PathFileError::Empty));
    assert_eq!(
        plan("0 0 0 1 0 0 0\n1 2 3"),
        Err(PathFileError::Columns {
            line: 2,
            expected: 7,
            found: 3
        })
    );
    assert_eq!(
        plan("0 0 0 1 0 0 0\n\n0 0 nan 1 0 0 0"),
        Err(PathFileError::Number {
            line: 3,
            column: 3,
            text: "nan".to_owned()
        })
    );
    assert!(matches!(
        plan("0 0 0 2 0 0 0"),
        Err(PathFileError::Quaternion { line: 1, .. })
    ));
    assert!(matches!(
        ReferencePath::from_csv("a,b"),
        Err(PathFileError::Header { .. })
    ));
    let csv = |rows: &str| ReferencePath::from_csv(&format!("{PATH_CSV_HEADER}\n{rows}"));
    assert_eq!(csv("\n"), Err(PathFileError::Empty));
    assert!(matches!(
        csv("0,0,0,0,1,0,0,0,0,0"),
        Err(PathFileError::TimeStep { line: 2, .. })
    ));
    assert!(matches!(
        csv("0,0,0,0,1,0,0,0,1,0\n0.1,0,0,0.1,1,0,0,0,1,0\n0.3,0,0,0.2,1,0,0,0,0,0"),
        Err(PathFileError::Time { line: 4, .. })
    ));
    for second in ["0", "-0.1"] {
        assert!(matches!(
            csv(&format!(
                "0,0,0,0,1,0,0,0,1,0\n{second},0,0,0.1,1,0,0,0,0,0"
            )),
            Err(PathFileError::TimeOrder { line: 3, .. })
        ));
    }
    assert!(matches!(
        csv("0,0,0,0,1,0,0,0,1,0\n0.1,0,0,0.1,1,0,0,0,1,0.2"),
        Err(PathFileError::LastInput { line: 3, omega_rad_s, .. }) if omega_rad_s == 0.2
    ));
    assert!(matches!(
        csv("0,0,0,0,1,0,0,0,1,0\n0.1,1e308,1e308,0.1,1,0,0,0,0,0"),
        Err(PathFileError::Sample { line: 3, .. })
    ));
    assert!(matches!(
        csv("0,0,0,0,1,0,0,0,1,0\n\n0.1,0,0,0.1,1,0,0,0,1e308,1e308\n1e10,0,0,0,1,0,0,0,0,0"),
        Err(PathFileError::Time { .. } | PathFileError::Sample { .. })
    ));
    assert!(matches!(
        plan("0 0 0 1 0 0 0\n1e308 1e308 0 1 0 0 0"),
        Err(PathFileError::Sample { line: 2, .. })
    ));
    assert!(matches!(
        csv("0,0,0,0,1,0,0,0,1,0,7\n"),
        Err(PathFileError::Columns {
            line: 2,
            expected: 10,
            found: 11
        })
    ));
}

#[test]
fn samples_that_make_no_path_are_refused() {
    let pose = Pose::exp(&Vector6::zeros());
    assert!(ReferencePath::from_samples(vec![], vec![], 0.1).is_err());
    assert!(ReferencePath::from_samples(vec![pose; 3], vec![Input::ZERO], 0.1).is_err());
    assert!(ReferencePath::from_samples(vec![pose; 2], vec![Input::ZERO], -0.1).is_err());
    assert!(ReferencePath::from_poses(vec![pose; 2], 0.0).is_err());
}

#[test]
fn a_window_has_one_pose_more_than_inputs_from_any_step() {
    let path = weaving(10);
    for step in [0, 5, 10, 11, usize::MAX - 1, usize::MAX] {
        for horizon in [0, 1, 2, 30] {
            let window = path.window(step, horizon);
            assert_eq!(
                (window.poses.len(), window.inputs.len()),
                (horizon + 1, horizon),
                "{step}"
            );
            assert_eq!(
                window.poses[horizon],
                path.poses()[step.saturating_add(horizon).min(10)]
            );
        }
    }
}

fn input(v_mm_s: f64, omega_rad_s: f64) -> Input {
    Input {
        v_mm_s,
        omega_rad_s,
    }
}

/// Forward, a turn in place, forward.
fn turning_between(before: usize, turns: usize, after: usize) -> ReferencePath {
    let mut inputs = vec![input(5.0, 0.0); before];
    inputs.extend(vec![input(0.0, 1.0); turns]);
    inputs.extend(vec![input(5.0, 0.0); after]);
    ReferencePath::from_inputs(needle(), Pose::identity(), inputs, 0.1).unwrap()
}

#[test]
fn a_turn_in_place_longer_than_the_lookahead_is_passed_sample_by_sample() {
    let path = turning_between(10, 30, 20);
    let mut progress = PathProgress::from_start(20);
    for (k, pose) in path.poses().iter().enumerate() {
        assert_eq!(progress.advance(&path, &pose.position_mm), k);
    }
}

#[test]
fn a_needle_that_executes_its_window_orients_and_then_inserts_to_the_end() {
    let path = turning_between(0, 35, 20);
    let mut progress = PathProgress::from_start(20);
    let mut tip = Pose::identity();
    for _ in 0..55 {
        let window = progress.window(&path, &tip.position_mm, 1);
        tip = needle().step(&tip, window.inputs[0], 0.1).unwrap();
    }
    assert_eq!(progress.advance(&path, &tip.position_mm), 55);
    assert!(tip.error_from(&path.poses()[55]).norm() < 1e-12);
}

#[test]
fn noise_does_not_skip_a_turn_in_place() {
    // Noise of two samples: the nearest position alone would lie beyond the turn.
    let path = turning_between(10, 5, 20);
    let mut progress = PathProgress::from_start(20);
    let beyond = path.poses()[17].position_mm;
    let steps: Vec<usize> = (0..7).map(|_| progress.advance(&path, &beyond)).collect();
    assert_eq!(steps, [10, 11, 12, 13, 14, 15, 17]);
}

#[test]
fn with_a_pose_a_turn_in_place_advances_by_orientation() {
    let path = turning_between(10, 70, 20);
    let mut progress = PathProgress::from_start(20);
    progress.advance_to_pose(&path, &path.poses()[10]);
    // 70 steps of 0.1 rad are more than a whole turn: the nearest roll ahead, not the last alike.
    assert_eq!(progress.advance_to_pose(&path, &path.poses()[15]), 15);
    assert_eq!(progress.advance_to_pose(&path, &path.poses()[15]), 15);
    assert_eq!(progress.advance_to_pose(&path, &path.poses()[12]), 15);
    for k in 16..=100 {
        assert_eq!(progress.advance_to_pose(&path, &path.poses()[k]), k);
    }
}

#[test]
fn the_papers_path_is_followed_to_its_last_sample() {
    let path = ReferencePath::paper_recipe(needle()).unwrap();
    let mut progress = PathProgress::from_start(20);
    for pose in path.poses() {
        progress.advance(&path, &pose.position_mm);
    }
    assert_eq!(progress.step(), 60);
}

#[test]
fn a_small_lookahead_does_not_lag_behind_a_fast_tip() {
    let path = weaving(300);
    let mut progress = PathProgress::from_start(1);
    for k in (0..=300).step_by(25) {
        assert_eq!(progress.advance(&path, &path.poses()[k].position_mm), k);
    }
}

#[test]
fn a_position_that_is_not_a_number_changes_nothing() {
    let path = turning_between(3, 5, 3);
    let mut progress = PathProgress::from_start(4);
    let here = path.poses()[3].position_mm;
    progress.advance(&path, &here);
    assert_eq!(progress.advance(&path, &here), 4);
    assert_eq!(progress.advance(&path, &(here * f64::NAN)), 4);
}

#[test]
fn the_first_of_the_bad_poses_is_named() {
    let mut poses = weaving(5).poses().to_vec();
    poses[3].position_mm.x = f64::NAN;
    assert_eq!(
        ReferencePath::from_poses(poses, 0.1),
        Err(ReferencePathError::Sample {
            sample: 3,
            source: StepError::NonFiniteState
        })
    );
}

#[test]
fn the_input_at_a_time_is_the_one_held_then() {
    let path = weaving(10);
    for k in 0..10 {
        // 0.3 / 0.1 is 2.9999999999999996.
        let time_s = k as f64 / 10.0;
        assert_eq!(path.input_at_time(time_s), path.inputs()[k]);
        assert_eq!(path.input_at_time(time_s + 0.09), path.inputs()[k]);
    }
    for t in [-0.01, 1.0, 99.0, f64::NAN, f64::INFINITY] {
        assert_eq!(path.input_at_time(t), Input::ZERO);
    }
}

#[test]
fn the_authors_own_path_ends_where_they_recorded_it() {
    let path = ReferencePath::paper_euler_path().unwrap();
    assert_eq!((path.poses().len(), path.inputs().len()), (61, 60));
    // Recorded in 9 digits.
    let end = path.poses()[60].position_mm - Vector3::new(0.0147752275, -9.61980679, 53.3393393);
    assert!(end.amax() < 1e-7, "{end}");
}

#[test]
fn the_papers_straight_path_is_a_line_of_945_mm() {
    let path = ReferencePath::paper_straight_path().unwrap();
    assert_eq!(path.poses().len(), 101);
    // 90 steps of 10 mm and 10 (0.9 + 0.8 + ... + 0) mm.
    let end = path.poses()[100].position_mm - Vector3::new(0.0, 0.0, 945.0);
    assert!(end.norm() < 1e-10, "{end}");
}

/// CSV of a straight path at the given times, as text.
fn csv_at(times: impl Iterator<Item = String>) -> String {
    let mut text = format!("{PATH_CSV_HEADER}\n");
    for time in times {
        text += &format!("{time},0,0,0,1,0,0,0,0,0\n");
    }
    text
}

#[test]
fn rounded_times_give_the_mean_time_step() {
    let thirtieths = |digits: usize| {
        let text = csv_at((0..600).map(|k| format!("{:.digits$}", f64::from(k) / 30.0)));
        ReferencePath::from_csv(&text).unwrap().dt_s()
    };
    for digits in [3, 6, 9] {
        // The ends are off by half a unit of the last digit, spread over 599 steps.
        let off = (thirtieths(digits) - 1.0 / 30.0).abs();
        assert!(
            off < 10f64.powi(-(digits as i32)) / 599.0,
            "{digits} {off:e}"
        );
    }
    let unix = csv_at((0..500).map(|k| format!("{:.2}", 1.7e9 + 0.01 * f64::from(k))));
    // Doubles near 1.7e9 are 2.4e-7 apart.
    assert!((ReferencePath::from_csv(&unix).unwrap().dt_s() - 0.01).abs() < 1e-9);
}

#[test]
fn a_missing_row_among_many_is_named() {
    let rows = (0..400).filter(|&k| k != 250);
    let text = csv_at(rows.map(|k| format!("{:.3}", f64::from(k) / 30.0)));
    // Rows 0..249 are in lines 2..251.
    assert!(matches!(
        ReferencePath::from_csv(&text),
        Err(PathFileError::Time { line: 252, .. })
    ));
}

#[test]
fn a_byte_order_mark_is_no_part_of_a_file() {
    let path = weaving(3);
    let text = format!("\u{feff}{}", path.to_csv());
    assert_eq!(ReferencePath::from_csv(&text), Ok(path));
    let plan = "\u{feff}0 0 0 1 0 0 0";
    assert!(read_planner_poses(plan, PlannerFile::StartAndGoal).is_ok());
}

#[test]
fn a_path_of_one_pose_round_trips() {
    let pose = Pose::exp(&Vector6::new(1.0, 2.0, 3.0, 0.1, 0.2, 0.3));
    let path = ReferencePath::from_samples(vec![pose], vec![], 0.04).unwrap();
    assert_eq!(ReferencePath::from_csv(&path.to_csv()), Ok(path));
}
