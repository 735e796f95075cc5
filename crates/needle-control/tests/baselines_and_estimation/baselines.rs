//! What each law achieves, and that it is the law it says it is.

use crate::harness::{
    DT_S, KAPPA_PER_MM, Tracking, bent_path, drive, helix_path, needle, perturbed_start, plant,
};
use faer::Mat;
use lqr::Dare;
use nalgebra::{Vector3, Vector6};
use needle_control::{
    BaselineError, BaselineSettings, Controller, DutyCycledGains, DutyCycledSteering, FeedForward,
    InputLimits, LawController, LimitsError, LqrWeights, Measurement, Origin, PathSample, PidGains,
    SlidingMode, SlidingModeGains, SteeringLaw, SteeringPid, StopReason, TimeVaryingLqr,
};
use needle_model::{Input, Pose, ReferencePath};

fn run(law: impl SteeringLaw, path: &ReferencePath, factor: f64, start: &Pose) -> Tracking {
    let settings = BaselineSettings::default();
    let mut controller = LawController::new(path.clone(), needle(), law, settings).unwrap();
    let exact = |tip: &Pose, _, _| Measurement::of(*tip);
    drive(&mut controller, &plant(factor), start, path, exact)
}

fn laws(path: &ReferencePath) -> [(&'static str, Box<dyn SteeringLaw>); 4] {
    [
        (
            "pid",
            Box::new(SteeringPid::new(PidGains::default()).unwrap()),
        ),
        (
            "sliding",
            Box::new(SlidingMode::new(SlidingModeGains::default()).unwrap()),
        ),
        (
            "duty",
            Box::new(DutyCycledSteering::new(DutyCycledGains::default()).unwrap()),
        ),
        (
            "lqr",
            Box::new(TimeVaryingLqr::new(path, needle(), LqrWeights::default()).unwrap()),
        ),
    ]
}

#[test]
fn geometric_laws_reach_the_figures_of_the_study() {
    let path = bent_path(0.5);
    // The study's figures (docs/baselines.md) and a third: nominal from the path, then 20 % less curvature from off it.
    let pid = || SteeringPid::new(PidGains::default()).unwrap();
    let sliding = || SlidingMode::new(SlidingModeGains::default()).unwrap();
    let duty = || DutyCycledSteering::new(DutyCycledGains::default()).unwrap();
    let still = Pose::identity();
    for (law, nominal, off, bounds) in [
        (
            "pid",
            run(pid(), &path, 1.0, &still),
            run(pid(), &path, 0.8, &perturbed_start()),
            [0.02, 0.072],
        ),
        (
            "sliding",
            run(sliding(), &path, 1.0, &still),
            run(sliding(), &path, 0.8, &perturbed_start()),
            [0.036, 0.055],
        ),
        (
            "duty",
            run(duty(), &path, 1.0, &still),
            run(duty(), &path, 0.8, &perturbed_start()),
            [0.046, 0.076],
        ),
    ] {
        assert!(nominal.rms_mm < bounds[0], "{law} nominal: {nominal:?}");
        assert!(off.rms_mm < bounds[1], "{law} off: {off:?}");
        assert!(nominal.revolutions < 13.0, "{law}: {nominal:?}");
    }
}

#[test]
fn lqr_brings_the_needle_back_to_an_executable_path_and_feed_forward_does_not() {
    let path = helix_path(2.0);
    let law = TimeVaryingLqr::new(&path, needle(), LqrWeights::default()).unwrap();
    let back = run(law, &path, 0.8, &perturbed_start());
    let mut replay = FeedForward::new(path.clone(), BaselineSettings::default()).unwrap();
    let exact = |tip: &Pose, _, _| Measurement::of(*tip);
    let astray = drive(&mut replay, &plant(0.8), &perturbed_start(), &path, exact);
    // The study: 0.16 mm against 1.8 mm.
    assert!(back.rms_mm < 0.22, "{back:?}");
    assert!(astray.rms_mm > 1.0, "{astray:?}");
}

#[test]
fn feed_forward_alone_is_exact_when_the_plant_is_the_model() {
    // Point 12 of the audit: on its own model and start the reference's inputs have no error, but for the first
    // samples, in which the needle gathers speed and lags behind. The path's shape needs v and omega in proportion,
    // so limits that bind would show.
    let path = helix_path(2.0);
    let unlimited = InputLimits {
        v_rate_max_mm_s2: f64::INFINITY,
        omega_rate_max_rad_s2: f64::INFINITY,
        ..InputLimits::default()
    };
    let settings = BaselineSettings {
        limits: unlimited,
        ..BaselineSettings::default()
    };
    let mut replay = FeedForward::new(path.clone(), settings).unwrap();
    let mut pose = Pose::identity();
    for step in 0..path.inputs().len() {
        let input = replay
            .step(&Measurement::default(), step as f64 * DT_S)
            .input;
        pose = needle().step(&pose, input, DT_S).unwrap();
    }
    // Rounding of 200 compositions over 100 mm.
    let end = path.poses()[path.inputs().len()];
    assert!(pose.error_from(&end).norm() < 1e-9);
}

#[test]
fn lqr_far_from_the_end_is_the_stationary_lqr() {
    let inputs = vec![
        Input {
            v_mm_s: 5.0,
            omega_rad_s: 2.0
        };
        1500
    ];
    let path = ReferencePath::from_inputs(needle(), Pose::identity(), inputs, DT_S).unwrap();
    let weights = LqrWeights::default();
    let mut law = TimeVaryingLqr::new(&path, needle(), weights).unwrap();
    let model = needle().linearise(path.inputs()[0], DT_S).unwrap();
    let a = Mat::from_fn(6, 6, |i, j| model.a[(i, j)]);
    let b = Mat::from_fn(6, 2, |i, j| model.b[(i, j)]);
    let q = Mat::from_fn(6, 6, |i, j| if i == j { weights.error[i] } else { 0.0 });
    let r = Mat::from_fn(2, 2, |i, j| if i == j { weights.input[i] } else { 0.0 });
    let stationary = Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref())
        .solve()
        .unwrap();
    for axis in 0..6 {
        let mut error = Vector6::zeros();
        error[axis] = 1e-3;
        let sample = PathSample {
            path: &path,
            step: 0,
            pose: Pose::identity().perturbed(&error),
            needle: needle(),
            held: path.inputs()[0],
            elapsed_s: DT_S,
            omega_max_rad_s: 10.0,
        };
        let input = law.wanted(&sample);
        let expected = [
            5.0 + stationary.k[(0, axis)] * 1e-3,
            2.0 + stationary.k[(1, axis)] * 1e-3,
        ];
        // The chain over 1500 stages has converged to rounding of gains of about 100, times the error.
        assert!((input.v_mm_s - expected[0]).abs() < 1e-8, "{axis}");
        assert!((input.omega_rad_s - expected[1]).abs() < 1e-8, "{axis}");
    }
}

#[test]
fn moving_the_world_frame_changes_no_input() {
    let world = Pose::exp(&Vector6::new(30.0, -80.0, 12.0, 1.1, -0.7, 2.0));
    let path = bent_path(0.5);
    let moved_poses = path.poses().iter().map(|g| world.compose(g)).collect();
    let moved = ReferencePath::from_samples(moved_poses, path.inputs().to_vec(), DT_S).unwrap();
    let tip = path.poses()[20].perturbed(&Vector6::new(0.4, -0.3, 0.1, 0.03, -0.02, 0.6));
    for ((name, mut here), (_, mut there)) in laws(&path).into_iter().zip(laws(&moved)) {
        let sample = |path, pose| PathSample {
            path,
            step: 20,
            pose,
            needle: needle(),
            held: path.inputs()[0],
            elapsed_s: DT_S,
            omega_max_rad_s: 6.0,
        };
        let (a, b) = (
            here.wanted(&sample(&path, tip)),
            there.wanted(&sample(&moved, world.compose(&tip))),
        );
        // Rounding of positions of 100 mm, times gains of about 100.
        assert!((a.omega_rad_s - b.omega_rad_s).abs() < 1e-8, "{name}");
        assert!((a.v_mm_s - b.v_mm_s).abs() < 1e-8, "{name}");
    }
}

#[test]
fn sliding_mode_turns_the_bevel_toward_the_target() {
    // Targets around an unturned tip: it bends toward -y, so a target in +x needs a quarter turn forward.
    let mut law = SlidingMode::new(SlidingModeGains {
        lookahead_mm: 10.0,
        spin_fraction: 1.0,
        boundary_rad: 4.0,
    })
    .unwrap();
    let ahead = ReferencePath::from_inputs(
        needle(),
        Pose::identity(),
        vec![
            Input {
                v_mm_s: 5.0,
                omega_rad_s: 50.0
            };
            100
        ],
        DT_S,
    )
    .unwrap();
    let quarter = std::f64::consts::FRAC_PI_2;
    for (offset, turn) in [
        (Vector3::new(-5.0, 0.0, 0.0), quarter),
        (Vector3::new(5.0, 0.0, 0.0), -quarter),
        (Vector3::new(0.0, 5.0, 0.0), 0.0),
    ] {
        let mut tip = Pose::identity();
        tip.position_mm = offset;
        let sample = PathSample {
            path: &ahead,
            step: 0,
            pose: tip,
            needle: needle(),
            held: Input::ZERO,
            elapsed_s: DT_S,
            omega_max_rad_s: 4.0,
        };
        // The path itself spins tightly about z: its point 10 mm ahead is off the axis by less than 0.1 mm of 5.
        assert!(
            (law.wanted(&sample).omega_rad_s - turn).abs() < 0.05,
            "{offset:?}"
        );
    }
}

#[test]
fn every_law_stops_at_the_end_of_the_path() {
    let path = helix_path(2.0);
    for (name, law) in laws(&path) {
        let end = run(Boxed(law), &path, 1.0, &Pose::identity());
        // Half a sample of the path is 0.25 mm; the laws brake to the end itself.
        assert!(end.final_mm < 0.1, "{name}: {end:?}");
    }
    let mut controller = LawController::new(
        path.clone(),
        needle(),
        SlidingMode::new(SlidingModeGains::default()).unwrap(),
        BaselineSettings::default(),
    )
    .unwrap();
    let at_end = Measurement::of(path.poses()[path.inputs().len()]);
    let mut origins = (0..400).map(|k| controller.step(&at_end, f64::from(k)).origin);
    let reason = StopReason::PathEnd;
    // Progress never jumps, so a tip that starts at the end is not taken to be there at once.
    assert!(origins.any(|origin| origin == Origin::Stop { reason }));
}

struct Boxed(Box<dyn SteeringLaw>);

impl SteeringLaw for Boxed {
    fn wanted(&mut self, sample: &PathSample<'_>) -> Input {
        self.0.wanted(sample)
    }

    fn reset(&mut self) {
        self.0.reset();
    }
}

#[test]
fn a_reset_controller_repeats_itself() {
    let path = bent_path(0.5);
    // A small lasting error: integrals and cycles build up, and nothing saturates.
    let off = Vector6::new(0.02, 0.02, 0.0, 0.0, 0.0, 0.1);
    for (name, law) in laws(&path) {
        let settings = BaselineSettings::default();
        let mut controller =
            LawController::new(path.clone(), needle(), Boxed(law), settings).unwrap();
        let mut runs = Vec::new();
        for _ in 0..2 {
            let run: Vec<Input> = (0..47)
                .map(|k| {
                    let tip = path.poses()[k].perturbed(&off);
                    let time_s = k as f64 * DT_S;
                    controller.step(&Measurement::of(tip), time_s).input
                })
                .collect();
            runs.push(run);
            controller.reset();
        }
        assert_eq!(runs[0], runs[1], "{name}");
    }
}

#[test]
fn settings_that_make_no_sense_are_named() {
    let broken =
        |settings: BaselineSettings| FeedForward::new(helix_path(1.0), settings).err().unwrap();
    let settings = BaselineSettings::default();
    assert!(matches!(
        broken(BaselineSettings {
            dt_s: 0.0,
            ..settings
        }),
        BaselineError::NotPositive { field: "dt_s", .. }
    ));
    assert!(matches!(
        broken(BaselineSettings {
            jump_mm: f64::NAN,
            ..settings
        }),
        BaselineError::NotPositive {
            field: "jump_mm",
            ..
        }
    ));
    let limits = InputLimits {
        v_min_mm_s: 1.0,
        ..InputLimits::default()
    };
    assert!(matches!(
        broken(BaselineSettings { limits, ..settings }),
        BaselineError::Limits(LimitsError::SpeedBox { .. })
    ));
    let gains = SlidingModeGains {
        boundary_rad: -1.0,
        ..SlidingModeGains::default()
    };
    assert!(SlidingMode::new(gains).is_err());
    let weights = LqrWeights {
        terminal: f64::INFINITY,
        ..LqrWeights::default()
    };
    assert!(TimeVaryingLqr::new(&helix_path(KAPPA_PER_MM), needle(), weights).is_err());
}

#[test]
fn a_law_is_refused_for_another_path_than_its_own() {
    let of_path = |path: &ReferencePath| TimeVaryingLqr::new(path, needle(), LqrWeights::default());
    let path = helix_path(1.0);
    let point = ReferencePath::from_samples(vec![Pose::identity()], Vec::new(), DT_S).unwrap();
    let refused = |law: TimeVaryingLqr, path: &ReferencePath, dt_s: f64| {
        let settings = BaselineSettings {
            dt_s,
            ..BaselineSettings::default()
        };
        LawController::new(path.clone(), needle(), law, settings).err()
    };
    let law = of_path(&path).unwrap();
    assert_eq!(refused(law.clone(), &path, DT_S), None);
    let steps = path.inputs().len();
    let (expected, found) = (0, steps);
    let nothing = of_path(&point).unwrap();
    let other = Some(BaselineError::OtherPath { expected, found });
    assert_eq!(refused(nothing, &path, DT_S), other);
    // The same steps in half the time.
    let twice =
        ReferencePath::from_samples(path.poses().to_vec(), path.inputs().to_vec(), 0.5 * DT_S);
    for (path, dt_s) in [(&path, 0.5 * DT_S), (&twice.unwrap(), DT_S)] {
        let (expected, found) = (DT_S, 0.5 * DT_S);
        let other = Some(BaselineError::OtherSampleTime { expected, found });
        assert_eq!(refused(law.clone(), path, dt_s), other);
    }
}
