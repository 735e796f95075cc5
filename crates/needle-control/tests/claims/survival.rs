//! Whatever happens, an input inside the limits comes back, rates included, with its origin told.

use crate::deviates::Deviates;
use crate::scene::{CURVATURE_PER_MM, DT_S, Scene};
use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector6};
use needle_control::{
    BaselineSettings, Controller, DutyCycledGains, DutyCycledSteering, FeedForward, InputLimits,
    LawController, LinearConfiguration, LqrWeights, LtvController, Measurement, NmpcConfiguration,
    NmpcController, Origin, PidGains, SlidingMode, SlidingModeGains, SteeringLaw, SteeringPid,
    StopReason, StraightController, Survival, TimeVaryingLqr, Tracking,
};
use needle_model::{Input, Needle, Pose, ReferencePath};
use proptest::prelude::*;
use std::time::Duration;

pub(crate) fn helix(steps: usize) -> ReferencePath {
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 1.0,
    };
    ReferencePath::from_inputs(
        Needle::new(CURVATURE_PER_MM).unwrap(),
        Pose::identity(),
        vec![input; steps],
        DT_S,
    )
    .unwrap()
}

/// The predictive controllers on a path.
pub(crate) fn predictive(path: &ReferencePath) -> Vec<(&'static str, Box<dyn Controller>)> {
    let needle = Needle::new(CURVATURE_PER_MM).unwrap();
    let progress = NmpcConfiguration {
        tracking: Tracking::Progress,
        ..NmpcConfiguration::default()
    };
    vec![
        (
            "nonlinear",
            Box::new(
                NmpcController::new(needle, path.clone(), NmpcConfiguration::default()).unwrap(),
            ),
        ),
        (
            "nonlinear, progress",
            Box::new(NmpcController::new(needle, path.clone(), progress).unwrap()),
        ),
        (
            "time-varying",
            Box::new(
                LtvController::new(needle, path.clone(), LinearConfiguration::default()).unwrap(),
            ),
        ),
        (
            "straight",
            Box::new(
                StraightController::new(
                    Needle::new(0.0).unwrap(),
                    path.clone(),
                    LinearConfiguration::default(),
                )
                .unwrap(),
            ),
        ),
    ]
}

/// The explicit laws on a path; a path without finite gains has no LQR.
pub(crate) fn laws(path: &ReferencePath) -> Vec<(&'static str, Box<dyn Controller>)> {
    fn of(path: &ReferencePath, law: impl SteeringLaw + 'static) -> Box<dyn Controller> {
        let (needle, settings) = (crate::linear::needle(), BaselineSettings::default());
        Box::new(LawController::new(path.clone(), needle, law, settings).unwrap())
    }
    let lqr = TimeVaryingLqr::new(path, crate::linear::needle(), LqrWeights::default());
    [
        (
            "pid",
            of(path, SteeringPid::new(PidGains::default()).unwrap()),
        ),
        (
            "sliding mode",
            of(path, SlidingMode::new(SlidingModeGains::default()).unwrap()),
        ),
        (
            "duty-cycled",
            of(
                path,
                DutyCycledSteering::new(DutyCycledGains::default()).unwrap(),
            ),
        ),
    ]
    .into_iter()
    .chain(lqr.ok().map(|lqr| ("lqr", of(path, lqr))))
    .collect()
}

/// Every controller on a path.
pub(crate) fn all(path: &ReferencePath) -> Vec<(&'static str, Box<dyn Controller>)> {
    let replay = FeedForward::new(path.clone(), BaselineSettings::default()).unwrap();
    let mut all = predictive(path);
    all.extend(laws(path));
    all.push(("feed-forward", Box::new(replay)));
    all
}

/// Checks boxes exactly and rates over the shorter of the elapsed time and the nominal step, up to rounding.
pub(crate) fn inside(input: Input, previous: Input, elapsed_s: f64) -> bool {
    let limits = InputLimits::default();
    let step_s = if elapsed_s > 0.0 {
        elapsed_s.min(DT_S)
    } else {
        DT_S
    };
    (limits.v_min_mm_s..=limits.v_max_mm_s).contains(&input.v_mm_s)
        && input.omega_rad_s.abs() <= limits.omega_max_rad_s
        && (input.v_mm_s - previous.v_mm_s).abs() <= limits.v_rate_max_mm_s2 * step_s + 1e-9
        && (input.omega_rad_s - previous.omega_rad_s).abs()
            <= limits.omega_rate_max_rad_s2 * step_s + 1e-9
}

/// Runs every controller on a path with measurements and times of the caller's making, and checks each input.
fn run_all(
    path: &ReferencePath,
    steps: usize,
    mut disturb: impl FnMut(usize, Pose) -> (Measurement, f64),
) {
    let plant = Needle::new(CURVATURE_PER_MM).unwrap();
    for (name, mut controller) in all(path) {
        let (mut pose, mut previous, mut last_s) = (Pose::identity(), Input::ZERO, None);
        for step in 0..steps {
            let (measurement, time_s) = disturb(step, pose);
            let decided = controller.step(&measurement, time_s);
            let (input, origin) = (decided.input, decided.origin);
            let elapsed_s = last_s.map_or(DT_S, |last: f64| time_s - last);
            assert!(
                inside(input, previous, elapsed_s),
                "{name}, step {step}: {input:?} after {previous:?}, {origin:?}"
            );
            if time_s.is_finite() {
                last_s = Some(time_s);
            } else {
                last_s = last_s.map(|last| last + DT_S);
            }
            previous = input;
            pose = plant.step(&pose, input, DT_S).unwrap();
        }
    }
}

pub(crate) fn on_time(step: usize) -> f64 {
    step as f64 * DT_S
}

#[test]
fn measurements_that_are_no_numbers_are_survived() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        run_all(&helix(100), 60, |step, mut pose| {
            if (10..30).contains(&step) {
                pose.position_mm[step % 3] = bad;
            }
            if step == 35 {
                pose.rotation = UnitQuaternion::new_unchecked(Quaternion::new(bad, 0.0, 0.0, 0.0));
            }
            if step == 36 {
                pose.rotation = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 0.0, 0.0));
            }
            let curvature_per_mm = (step > 20).then_some(bad);
            (
                Measurement {
                    pose: Some(pose),
                    curvature_per_mm,
                },
                on_time(step),
            )
        });
    }
}

#[test]
fn outliers_gaps_and_poses_beyond_the_chart_are_survived() {
    let beyond = Pose::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 2.0, 0.0));
    run_all(&helix(100), 100, |step, pose| {
        let measurement = match step {
            10 | 12 | 14..=40 => Measurement::of(Pose {
                position_mm: pose.position_mm + Vector3::x() * 100.0,
                ..pose
            }),
            50..=70 => Measurement::default(),
            75..=85 => Measurement::of(beyond),
            _ => Measurement::of(pose),
        };
        (measurement, on_time(step))
    });
}

#[test]
fn clocks_that_jump_stand_still_or_jitter_are_survived() {
    let mut noise = Deviates::seeded(5);
    run_all(&helix(100), 80, |step, pose| {
        let jitter = DT_S * (noise.uniform() - 0.5);
        let time_s = match step {
            20 => -3.0,
            30 => f64::NAN,
            40 => f64::INFINITY,
            45..=50 => 4.5,
            60.. => on_time(step) + 1e6,
            _ => on_time(step) + jitter,
        };
        (Measurement::of(pose), time_s)
    });
}

#[test]
fn paths_of_one_point_with_a_kink_too_bent_or_very_long_are_survived() {
    let point = ReferencePath::from_samples(vec![Pose::identity()], vec![], DT_S).unwrap();
    let along =
        |twist: Vector6<f64>, n: usize| (0..=n).map(move |k| Pose::exp(&(twist * k as f64)));
    let straight = Vector6::new(0.0, 0.0, 0.5, 0.0, 0.0, 0.0);
    let corner =
        Pose::exp(&(straight * 20.0)).perturbed(&Vector6::new(0.0, 0.0, 0.0, 0.0, 1.5, 0.0));
    let kink = along(straight, 20).chain(
        along(straight, 30)
            .skip(1)
            .map(|pose| corner.compose(&pose)),
    );
    let bent = along(Vector6::new(0.0, 0.0, 0.5, 0.5 / 20.0, 0.0, 0.0), 60);
    let paths = [
        point,
        ReferencePath::from_poses(kink.collect(), DT_S).unwrap(),
        ReferencePath::from_poses(bent.collect(), DT_S).unwrap(),
        helix(100_000),
    ];
    for path in paths {
        run_all(&path, 60, |step, pose| {
            (Measurement::of(pose), on_time(step))
        });
    }
}

#[test]
fn gap_is_bridged_by_the_shifted_plan_and_then_stopped() {
    for (name, mut controller) in predictive(&helix(100)) {
        controller.step(&Measurement::of(Pose::identity()), 0.0);
        for age in 1..=10 {
            let origin = controller
                .step(&Measurement::default(), on_time(age))
                .origin;
            assert_eq!(origin, Origin::ShiftedPlan { age }, "{name}");
        }
        let mut last = Input {
            v_mm_s: 1.0,
            omega_rad_s: 0.0,
        };
        for step in 11..16 {
            let decided = controller.step(&Measurement::default(), on_time(step));
            assert_eq!(
                decided.origin,
                Origin::Stop {
                    reason: StopReason::NoMeasurement
                },
                "{name}"
            );
            last = decided.input;
        }
        assert_eq!(last, Input::ZERO, "{name}");
    }
}

#[test]
fn step_that_misses_its_deadline_is_never_applied() {
    let scene = Scene::default();
    let survival = Survival {
        deadline: Some(Duration::from_nanos(1)),
        ..Survival::default()
    };
    let configuration = NmpcConfiguration {
        survival,
        ..NmpcConfiguration::default()
    };
    let mut controller = NmpcController::new(scene.model, scene.path(), configuration).unwrap();
    let decided = controller.step(&Measurement::of(Pose::identity()), 0.0);
    assert_eq!(
        decided.origin,
        Origin::Stop {
            reason: StopReason::NoPlan
        }
    );
    assert_eq!(decided.input, Input::ZERO);
}

#[test]
fn end_of_the_path_is_a_stop_that_says_so() {
    for (name, mut controller) in all(&helix(30)) {
        let needle = Needle::new(if name == "straight" {
            0.0
        } else {
            CURVATURE_PER_MM
        })
        .unwrap();
        let mut pose = Pose::identity();
        let mut origin = Origin::Optimal;
        for step in 0..80 {
            let decided = controller.step(&Measurement::of(pose), on_time(step));
            (pose, origin) = (
                needle.step(&pose, decided.input, DT_S).unwrap(),
                decided.origin,
            );
        }
        assert_eq!(
            origin,
            Origin::Stop {
                reason: StopReason::PathEnd
            },
            "{name}"
        );
    }
}

#[test]
fn absurd_estimate_of_curvature_is_ignored() {
    for absurd in [f64::NAN, -0.1, f64::INFINITY, 1e3] {
        let (mut with, mut without) = (all(&helix(50)), all(&helix(50)));
        for ((name, with), (_, without)) in with.iter_mut().zip(&mut without) {
            let plain = Measurement::of(Pose::identity());
            let estimated = Measurement {
                curvature_per_mm: Some(absurd),
                ..plain
            };
            let (told, untold) = (
                with.step(&estimated, 0.0).input,
                without.step(&plain, 0.0).input,
            );
            assert_eq!(told, untold, "{name}, {absurd}");
        }
    }
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -3.0..3.0_f64,
        2 => -300.0..300.0_f64,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
        1 => Just(0.0),
    ]
}

/// References of any inputs: too fast, backwards, spinning, at rest.
fn any_reference() -> impl Strategy<Value = ReferencePath> {
    prop::collection::vec((-15.0..15.0_f64, -10.0..10.0_f64), 0..40).prop_map(|inputs| {
        let inputs = inputs.into_iter().map(|(v_mm_s, omega_rad_s)| Input {
            v_mm_s,
            omega_rad_s,
        });
        let needle = Needle::new(CURVATURE_PER_MM).unwrap();
        ReferencePath::from_inputs(needle, Pose::identity(), inputs.collect(), DT_S).unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_measurement_along_any_reference_gives_an_input_inside_the_limits(
        reference in any_reference(),
        samples in prop::collection::vec(
            (prop::array::uniform6(anything()), prop::option::of(anything()), 0.05..0.15_f64, 0..4_u8),
            1..20,
        ),
    ) {
        for (name, mut controller) in all(&reference) {
            let (mut previous, mut time_s) = (Input::ZERO, 0.0);
            for (step, &(xi, curvature_per_mm, increment_s, kind)) in samples.iter().enumerate() {
                let pose = match kind {
                    0 => None,
                    1 => Some(Pose {
                        position_mm: Vector3::new(xi[0], xi[1], xi[2]),
                        rotation: UnitQuaternion::new_unchecked(Quaternion::new(xi[3], xi[4], xi[5], xi[0])),
                    }),
                    _ => Some(Pose::exp(&Vector6::from(xi))),
                };
                let elapsed_s = if step == 0 { DT_S } else { increment_s };
                time_s += if step == 0 { 0.0 } else { increment_s };
                let decided = controller.step(&Measurement { pose, curvature_per_mm }, time_s);
                prop_assert!(
                    inside(decided.input, previous, elapsed_s),
                    "{name}, step {step}: {:?} after {previous:?}, {:?}", decided.input, decided.origin
                );
                previous = decided.input;
            }
        }
    }
}
