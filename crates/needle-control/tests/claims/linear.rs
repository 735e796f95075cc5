//! The linear controllers: terminal choices, stability, invariance, agreement of the solvers.

use crate::scene::{CURVATURE_PER_MM, DT_S, Scene, apart};
use crate::stability::LinearPlant;
use faer::Mat;
use mpc_qp::{ClarabelSolver, SolverSettings};
use nalgebra::Vector6;
use needle_control::{
    ConfigurationError, Controller, InputLimits, LinearConfiguration, LtvController, Measurement,
    Origin, StraightController, TerminalChoice, TerminalError,
};
use needle_model::{Input, Needle, Pose, ReferencePath};

pub(crate) const HELIX: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 1.0,
};

pub(crate) fn needle() -> Needle {
    Needle::new(CURVATURE_PER_MM).unwrap()
}

pub(crate) fn path(needle: Needle, input: Input, steps: usize) -> ReferencePath {
    ReferencePath::from_inputs(needle, Pose::identity(), vec![input; steps], DT_S).unwrap()
}

fn wide() -> InputLimits {
    InputLimits {
        v_min_mm_s: -1e6,
        v_max_mm_s: 1e6,
        omega_max_rad_s: 1e6,
        v_rate_max_mm_s2: f64::INFINITY,
        omega_rate_max_rad_s2: f64::INFINITY,
    }
}

fn configuration(terminal: TerminalChoice) -> LinearConfiguration {
    LinearConfiguration {
        terminal,
        ..LinearConfiguration::default()
    }
}

fn ltv(terminal: TerminalChoice, limits: InputLimits) -> LtvController {
    let configuration = LinearConfiguration {
        limits,
        ..configuration(terminal)
    };
    LtvController::new(needle(), path(needle(), HELIX, 2_000), configuration).unwrap()
}

#[test]
fn zero_error_settles_to_the_reference_input() {
    let mut controller = ltv(TerminalChoice::HelixDare, wide());
    let step = controller.step(&Measurement::of(Pose::identity()), 0.0);
    assert!(matches!(step.origin, Origin::Optimal), "{:?}", step.origin);
    // From rest the change of the deviation costs at once; without rate limits the optimum still starts near the reference.
    let first = step.input;
    let reference = path(needle(), HELIX, 2_000);
    let mut plant = LinearPlant::new(&reference, needle(), Vector6::zeros());
    plant.advance(first);
    for _ in 0..200 {
        let input = controller.step(&plant.measurement(), plant.time_s()).input;
        plant.advance(input);
    }
    let input = controller.step(&plant.measurement(), plant.time_s()).input;
    // The error decays to zero, and the input to the reference's, at the rate of the closed loop.
    assert!(
        (input.v_mm_s - HELIX.v_mm_s).abs() < 1e-6
            && (input.omega_rad_s - HELIX.omega_rad_s).abs() < 1e-6,
        "{input:?}"
    );
}

/// Input of the LQR of the error system `a, b` with the default weights of the `coordinates`, from an error at rest.
fn lqr_input(a: Mat<f64>, b: Mat<f64>, coordinates: &[usize], xi: &Vector6<f64>) -> Input {
    let weights = LinearConfiguration::default().weights;
    let diagonal = |values: &[f64]| {
        Mat::from_fn(values.len(), values.len(), |i, j| {
            if i == j { values[i] } else { 0.0 }
        })
    };
    let error: Vec<f64> = coordinates.iter().map(|&i| weights.error[i]).collect();
    let (q, r, r_rate) = (
        diagonal(&error),
        diagonal(&[weights.v, weights.omega]),
        diagonal(&[weights.v_change, weights.omega_change]),
    );
    let augmented = lqr::RateAugmented::new(
        a.as_ref(),
        b.as_ref(),
        q.as_ref(),
        r.as_ref(),
        r_rate.as_ref(),
    )
    .unwrap();
    let dare = lqr::Dare::new(
        augmented.a.as_ref(),
        augmented.b.as_ref(),
        augmented.q.as_ref(),
        augmented.r.as_ref(),
    )
    .with_cross(augmented.s.as_ref());
    let gain = dare.solve().unwrap().k;
    // The deviation applied last is minus the reference's input.
    let last = [-HELIX.v_mm_s, -HELIX.omega_rad_s];
    let state: Vec<f64> = coordinates.iter().map(|&i| xi[i]).chain(last).collect();
    // The gain's change of the deviation from minus the reference's input is the input itself.
    let [v_mm_s, omega_rad_s] =
        [0, 1].map(|i| (0..state.len()).map(|j| gain[(i, j)] * state[j]).sum());
    Input {
        v_mm_s,
        omega_rad_s,
    }
}

/// The solver's tolerance is 1e-8 of entries near 5.
fn assert_equal(input: Input, law: Input, what: &str) {
    assert!(
        (input.v_mm_s - law.v_mm_s).abs() < 1e-6
            && (input.omega_rad_s - law.omega_rad_s).abs() < 1e-6,
        "{what}: {input:?} {law:?}"
    );
}

#[test]
fn unconstrained_mpc_equals_lqr() {
    let jacobians = needle().linearise(HELIX, DT_S).unwrap();
    let a = Mat::from_fn(6, 6, |i, j| jacobians.a[(i, j)]);
    let b = Mat::from_fn(6, 2, |i, j| jacobians.b[(i, j)]);
    let xi = Vector6::new(0.02, -0.01, 0.03, 0.001, -0.002, 0.004);
    let law = lqr_input(a, b, &[0, 1, 2, 3, 4, 5], &xi);
    let measured = Measurement::of(Pose::identity().perturbed(&xi));
    for horizon in [5, 20] {
        let mut controller = LtvController::new(
            needle(),
            path(needle(), HELIX, 2_000),
            LinearConfiguration {
                horizon,
                limits: wide(),
                ..configuration(TerminalChoice::HelixDare)
            },
        )
        .unwrap();
        let input = controller.step(&measured, 0.0).input;
        assert_equal(input, law, &format!("N = {horizon}"));
    }
}

#[test]
fn unconstrained_mpc_of_a_straight_needle_equals_lqr() {
    // x+ = x + dt u.
    let (a, b) = (Mat::identity(2, 2), DT_S * Mat::<f64>::identity(2, 2));
    let xi = Vector6::new(0.0, 0.0, -0.7, 0.0, 0.0, 0.4);
    let law = lqr_input(a, b, &[2, 5], &xi);
    let straight = Needle::new(0.0).unwrap();
    let measured = Measurement::of(Pose::identity().perturbed(&xi));
    for horizon in [5, 20] {
        let mut controller = StraightController::new(
            straight,
            path(straight, HELIX, 200),
            LinearConfiguration {
                horizon,
                limits: wide(),
                ..configuration(TerminalChoice::HelixDare)
            },
        )
        .unwrap();
        let input = controller.step(&measured, 0.0).input;
        assert_equal(input, law, &format!("N = {horizon}"));
    }
}

/// The path and a controller's measurements seen from another world frame.
pub(crate) fn world() -> Pose {
    Pose::exp(&Vector6::new(30.0, -20.0, 10.0, 1.0, -2.0, 0.5))
}

/// The path in [`world`].
pub(crate) fn moved(original: &ReferencePath) -> ReferencePath {
    let poses = original.poses().iter().map(|pose| world().compose(pose));
    ReferencePath::from_samples(poses.collect(), original.inputs().to_vec(), DT_S).unwrap()
}

/// Drives the first controller and asks the second for the same; returns the largest difference of inputs, mm/s and rad/s alike.
pub(crate) fn largest_difference(
    controllers: [&mut dyn Controller; 2],
    needle: Needle,
    start: Pose,
    steps: usize,
) -> f64 {
    largest_difference_seen_from(&Pose::identity(), controllers, needle, start, steps)
}

/// As [`largest_difference`], where the second controller lives in the moved [`world`].
pub(crate) fn largest_difference_under_a_move(
    controllers: [&mut dyn Controller; 2],
    needle: Needle,
    start: Pose,
    steps: usize,
) -> f64 {
    largest_difference_seen_from(&world(), controllers, needle, start, steps)
}

fn largest_difference_seen_from(
    view: &Pose,
    [here, there]: [&mut dyn Controller; 2],
    needle: Needle,
    mut pose: Pose,
    steps: usize,
) -> f64 {
    let mut largest = 0.0_f64;
    for step in 0..steps {
        let time_s = step as f64 * DT_S;
        let input = here.step(&Measurement::of(pose), time_s).input;
        let seen = Measurement::of(view.compose(&pose));
        let same = there.step(&seen, time_s).input;
        largest = largest.max(apart(input, same));
        pose = needle.step(&pose, input, DT_S).unwrap();
    }
    largest
}

#[test]
fn moving_the_world_changes_no_input() {
    let start = Pose::exp(&Vector6::new(0.3, -0.2, 0.1, 0.02, -0.01, 0.3));
    let certified = configuration(TerminalChoice::HelixDare);
    let original = path(needle(), HELIX, 300);
    let ltv = |path| LtvController::new(needle(), path, certified.clone()).unwrap();
    let (mut here, mut there) = (ltv(original.clone()), ltv(moved(&original)));
    let bent = largest_difference_under_a_move([&mut here, &mut there], needle(), start, 50);
    let straight = Needle::new(0.0).unwrap();
    let original = path(straight, HELIX, 300);
    let line = |path| StraightController::new(straight, path, certified.clone()).unwrap();
    let (mut here, mut there) = (line(original.clone()), line(moved(&original)));
    let unbent = largest_difference_under_a_move([&mut here, &mut there], straight, start, 50);
    // Rounding of 40 mm coordinates, 1e-14, through the solver's tolerance of 1e-8.
    assert!(bent < 1e-6 && unbent < 1e-6, "{bent} {unbent}");
}

#[test]
fn both_solvers_give_the_same_input() {
    let settings = SolverSettings::default();
    let default = LinearConfiguration::default();
    let helix = path(needle(), HELIX, 500);
    let mut structured = LtvController::new(needle(), helix.clone(), default.clone()).unwrap();
    let mut clarabel = LtvController::with_solver(needle(), helix, default.clone(), |problem| {
        ClarabelSolver::new(problem, settings)
    })
    .unwrap();
    let start = Pose::exp(&Vector6::new(0.4, -0.3, 0.2, 0.02, -0.01, 0.3));
    let bent = largest_difference([&mut structured, &mut clarabel], needle(), start, 40);
    let straight = Needle::new(0.0).unwrap();
    let line = path(straight, HELIX, 500);
    let mut structured = StraightController::new(straight, line.clone(), default.clone()).unwrap();
    let mut clarabel = StraightController::with_solver(straight, line, default, |problem| {
        ClarabelSolver::new(problem, settings)
    })
    .unwrap();
    let start = Pose::exp(&Vector6::new(0.0, 0.0, 1.0, 0.0, 0.0, 0.5));
    let unbent = largest_difference([&mut structured, &mut clarabel], straight, start, 40);
    // Measured: 7e-10 and 5e-10.
    assert!(bent < 1e-5 && unbent < 1e-5, "{bent} {unbent}");
}

#[test]
fn auto_takes_the_strongest_terminal_that_the_reference_admits() {
    let chosen = |path| {
        let controller =
            LtvController::new(needle(), path, configuration(TerminalChoice::Auto)).unwrap();
        controller.terminal()
    };
    assert_eq!(
        chosen(path(needle(), HELIX, 100)),
        TerminalChoice::HelixDare
    );
    // Along a planar arc two errors cannot be corrected: no stationary solution, but a chain.
    let arc = path(
        needle(),
        Input {
            omega_rad_s: 0.0,
            ..HELIX
        },
        100,
    );
    assert_eq!(chosen(arc), TerminalChoice::RiccatiChain);
    let point = ReferencePath::from_samples(vec![Pose::identity()], vec![], DT_S).unwrap();
    assert_eq!(chosen(point), TerminalChoice::None);
}

#[test]
fn planar_arc_refuses_the_helix_choice_with_its_controllability() {
    let arc = path(
        needle(),
        Input {
            omega_rad_s: 0.0,
            ..HELIX
        },
        100,
    );
    let refused = LtvController::new(needle(), arc, configuration(TerminalChoice::HelixDare));
    match refused {
        Err(ConfigurationError::Terminal(TerminalError::Dare { report, .. })) => {
            assert_eq!(report.dimension, 4);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn path_that_the_needle_cannot_execute_has_no_terminal_ingredients() {
    let curve = Scene::default().path();
    let made = |choice| LtvController::new(needle(), curve.clone(), configuration(choice));
    for choice in [TerminalChoice::HelixDare, TerminalChoice::RiccatiChain] {
        assert!(matches!(
            made(choice),
            Err(ConfigurationError::Terminal(TerminalError::NotExecutable {
                step: 0,
                ..
            }))
        ));
    }
    assert_eq!(
        made(TerminalChoice::Auto).unwrap().terminal(),
        TerminalChoice::None
    );
}

#[test]
fn chain_and_period_of_a_helix_carry_certificates_that_hold() {
    for choice in [
        TerminalChoice::RiccatiChain,
        TerminalChoice::Periodic { period: 4 },
    ] {
        let controller =
            LtvController::new(needle(), path(needle(), HELIX, 60), configuration(choice)).unwrap();
        let certificate = controller.certificate().unwrap();
        assert!(certificate.holds(), "{choice:?}\n{certificate}");
    }
}

#[test]
fn papers_paths_leave_no_terminal_set_and_nothing_is_claimed_of_one() {
    let straight = Needle::new(0.0).unwrap();
    let made = |needle, inputs| {
        ReferencePath::from_inputs(needle, Pose::identity(), inputs, DT_S).unwrap()
    };
    let bent = made(needle(), needle_model::paper_bevel_inputs());
    let along = made(straight, needle_model::paper_straight_inputs());
    // Both paths use the whole box of speeds, up to the largest and down to rest; with room on both sides there is a set.
    for (room_mm_s, has_set) in [(0.0, false), (2.0, true)] {
        let limits = |speed_mm_s: f64| InputLimits {
            v_min_mm_s: -room_mm_s,
            v_max_mm_s: speed_mm_s + room_mm_s,
            v_rate_max_mm_s2: 1_500.0,
            ..InputLimits::default()
        };
        let of = |terminal, speed_mm_s| LinearConfiguration {
            limits: limits(speed_mm_s),
            ..configuration(terminal)
        };
        let auto = TerminalChoice::Auto;
        let ltv = LtvController::new(needle(), bent.clone(), of(auto, 10.0)).unwrap();
        let line = StraightController::new(straight, along.clone(), of(auto, 100.0)).unwrap();
        for (name, set, claimed) in [
            ("bevel", ltv.terminal_region(), ltv.certificate()),
            ("straight", line.terminal_region(), line.certificate()),
        ] {
            assert_eq!(set.is_some(), claimed.is_some(), "{name}, {room_mm_s}");
            assert_eq!(set.is_some(), has_set, "{name}, {room_mm_s}");
        }
        let chain = LtvController::new(
            needle(),
            bent.clone(),
            of(TerminalChoice::RiccatiChain, 10.0),
        );
        let refused = matches!(
            chain,
            Err(ConfigurationError::Terminal(
                TerminalError::NoInterior { .. }
            ))
        );
        assert_eq!(refused, !has_set, "{room_mm_s}");
    }
}

#[test]
fn straight_needle_reaches_the_end_of_the_papers_path() {
    let inputs = needle_model::paper_straight_inputs();
    let straight = Needle::new(0.0).unwrap();
    let path = ReferencePath::from_inputs(straight, Pose::identity(), inputs, DT_S).unwrap();
    let end = *path.poses().last().unwrap();
    let limits = InputLimits {
        v_max_mm_s: 200.0,
        v_rate_max_mm_s2: 1_000.0,
        ..InputLimits::default()
    };
    let configuration = LinearConfiguration {
        limits,
        ..configuration(TerminalChoice::Auto)
    };
    let mut controller = StraightController::new(straight, path, configuration).unwrap();
    let mut pose = Pose::exp(&Vector6::new(0.0, 0.0, -1.0, 0.0, 0.0, 0.1));
    for step in 0..140 {
        let input = controller
            .step(&Measurement::of(pose), step as f64 * DT_S)
            .input;
        assert!(input.v_mm_s >= 0.0, "step {step}");
        pose = straight.step(&pose, input, DT_S).unwrap();
    }
    // The path counts as reached within 0.02 mm; the last braking step may pass it, and v >= 0 cannot take that back.
    assert!(
        (pose.position_mm - end.position_mm).norm() < 0.1,
        "{pose:?}"
    );
}
