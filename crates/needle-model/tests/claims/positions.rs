//! The problem "which states and inputs reach these positions" is posed so that it can be solved: a
//! dense Levenberg-Marquardt, here only, solves it on short paths.

use nalgebra::{DMatrix, DVector, Dyn, Matrix6, OMatrix, U6, Vector3, Vector6};
use needle_model::{
    Input, Needle, Pose, PositionCurve, PositionCurveError, PositionPathError, PositionPathProblem,
    PositionPathSettings, ReferencePath,
};
use proptest::prelude::*;

use crate::finite_difference::derivative;

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

fn needle() -> Needle {
    Needle::new(KAPPA_PER_MM).unwrap()
}

fn problem(positions_mm: &[Vector3<f64>]) -> PositionPathProblem {
    let curve = PositionCurve::through(positions_mm, 0.0).unwrap();
    PositionPathProblem::new(needle(), curve, PositionPathSettings::default()).unwrap()
}

/// Normal equations in (first pose, inputs) at an executed path, later poses eliminated.
fn normal_equations(
    problem: &PositionPathProblem,
    path: &ReferencePath,
) -> (DMatrix<f64>, DVector<f64>, f64) {
    let (poses, inputs) = (path.poses(), path.inputs());
    let n = inputs.len();
    let columns = 6 + 2 * n;
    let mut jacobian = DMatrix::zeros(5 * n + 3, columns);
    let mut residual = DVector::zeros(5 * n + 3);
    let mut by_z = OMatrix::<f64, U6, Dyn>::zeros(columns);
    by_z.fixed_view_mut::<6, 6>(0, 0)
        .copy_from(&Matrix6::identity());
    for k in 0..n {
        let stage = problem
            .stage(k, &poses[k], inputs[k], &poses[k + 1])
            .unwrap()
            .unwrap();
        residual.rows_mut(5 * k, 5).copy_from(&stage.residual);
        jacobian
            .rows_mut(5 * k, 5)
            .copy_from(&(stage.by_pose * &by_z));
        let mut inputs_block = jacobian.fixed_view_mut::<5, 2>(5 * k, 6 + 2 * k);
        inputs_block += stage.by_input;
        let step = stage.step.solved_for_target();
        by_z = step.a * &by_z;
        let mut block = by_z.fixed_view_mut::<6, 2>(0, 6 + 2 * k);
        block += step.b;
    }
    let last = problem.terminal(&poses[n]);
    residual.rows_mut(5 * n, 3).copy_from(&last.value);
    jacobian
        .rows_mut(5 * n, 3)
        .copy_from(&(last.by_pose * &by_z));
    let cost = residual.norm_squared();
    (jacobian.tr_mul(&jacobian), jacobian.tr_mul(&residual), cost)
}

/// The path executed from the first pose and inputs of `at`, both moved by `z`, inputs clipped.
fn executed(problem: &PositionPathProblem, at: &ReferencePath, z: &DVector<f64>) -> ReferencePath {
    let inputs = at.inputs().iter().enumerate().map(|(k, u)| {
        problem.settings().within_limits(Input {
            v_mm_s: u.v_mm_s + z[6 + 2 * k],
            omega_rad_s: u.omega_rad_s + z[7 + 2 * k],
        })
    });
    let start = at.poses()[0].perturbed(&z.fixed_rows::<6>(0).into_owned());
    ReferencePath::from_inputs(problem.needle(), start, inputs.collect(), at.dt_s()).unwrap()
}

/// Levenberg-Marquardt from the initial guess: largest distance to the targets, mm, and the path.
fn solved(problem: &PositionPathProblem, iterations: usize) -> (f64, ReferencePath) {
    let columns = 6 + 2 * problem.initial_guess().inputs().len();
    let mut path = executed(problem, problem.initial_guess(), &DVector::zeros(columns));
    let (mut hessian, mut gradient, mut cost) = normal_equations(problem, &path);
    let mut damping = 1e-6;
    for _ in 0..iterations {
        let mut damped = hessian.clone();
        for i in 0..columns {
            damped[(i, i)] *= 1.0 + damping;
        }
        let z = -damped.cholesky().unwrap().solve(&gradient);
        let candidate = executed(problem, &path, &z);
        let (h, g, c) = normal_equations(problem, &candidate);
        if c < cost {
            (path, hessian, gradient, cost) = (candidate, h, g, c);
            damping *= 0.1;
        } else {
            damping *= 10.0;
        }
    }
    let pairs = path.poses().iter().zip(problem.targets_mm());
    let deviation_mm = pairs
        .map(|(p, y)| (p.position_mm - y).norm())
        .fold(0.0, f64::max);
    (deviation_mm, path)
}

fn twisting(omega_rad_s: impl Fn(f64) -> f64, steps: u32) -> ReferencePath {
    let inputs = (0..steps)
        .map(|k| Input {
            v_mm_s: 5.0,
            omega_rad_s: omega_rad_s(f64::from(k)),
        })
        .collect();
    let start = Pose::exp(&Vector6::new(3.0, 1.0, -2.0, 0.4, 0.2, 0.9));
    ReferencePath::from_inputs(needle(), start, inputs, 0.1).unwrap()
}

fn positions(path: &ReferencePath) -> Vec<Vector3<f64>> {
    path.poses().iter().map(|p| p.position_mm).collect()
}

fn worst_distance(a: &ReferencePath, b: &ReferencePath) -> f64 {
    let pairs = a.poses().iter().zip(b.poses());
    pairs
        .map(|(p, q)| (p.position_mm - q.position_mm).norm())
        .fold(0.0, f64::max)
}

#[test]
fn positions_of_a_feasible_path_give_back_its_poses() {
    let truth = twisting(|k| 0.1 + 0.3 * (k * 0.08).sin(), 50);
    let (_, path) = solved(&problem(&positions(&truth)), 4);
    assert!(worst_distance(&path, &truth) < 1e-3);
    for (found, wanted) in path.poses().iter().zip(truth.poses()) {
        // Roll shows only through the direction of bending, the second derivative of position; the
        // ends of the spline know it least.
        assert!(found.error_from(wanted).fixed_rows::<3>(3).norm() < 1e-2);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn positions_of_a_feasible_path_give_back_the_path(
        mean in -1.5..1.5_f64, swing in 0.0..1.5_f64, rate in 0.02..0.3_f64, steps in 12..50_u32,
    ) {
        let truth = twisting(|k| mean + swing * (k * rate).sin(), steps);
        let (_, path) = solved(&problem(&positions(&truth)), 4);
        // The bound that a reference should meet everywhere; curves are sampled every 0.5 mm.
        let worst_mm = worst_distance(&path, &truth);
        prop_assert!(worst_mm < 1e-3, "{worst_mm:e}");
    }
}

#[test]
fn a_gentler_curve_is_followed_by_an_uneven_spin() {
    // Half the needle's curvature, torsion 0.01 rad/mm; one turn a second at most.
    let gentle = Needle::new(0.5 * KAPPA_PER_MM).unwrap();
    let inputs = vec![
        Input {
            v_mm_s: 5.0,
            omega_rad_s: 0.05
        };
        60
    ];
    let truth = ReferencePath::from_inputs(gentle, Pose::identity(), inputs, 0.1).unwrap();
    let problem = problem(&positions(&truth));
    // The closed-form spin, executed open loop from its own first pose: 30 mm of half the curvature
    // sag 1.5 mm, of full curvature 3 mm, so 0.5 mm means that the averaging works.
    let guess = problem.initial_guess();
    let rolled =
        ReferencePath::from_inputs(needle(), guess.poses()[0], guess.inputs().to_vec(), 0.1)
            .unwrap();
    let open_loop_mm = worst_distance(&rolled, guess);
    assert!(open_loop_mm < 0.5, "{open_loop_mm}");
    let (deviation_mm, path) = solved(&problem, 6);
    // The ripple of a spin of 10 steps a turn, kappa (v / omega)^2 = 0.005 mm, and more at the ends.
    assert!(deviation_mm < 0.05, "{deviation_mm}");
    let settings = problem.settings();
    assert!(
        path.inputs()
            .iter()
            .all(|u| settings.within_limits(*u) == *u)
    );
}

#[test]
fn a_straight_path_is_followed_by_a_bevelled_needle() {
    let line: Vec<_> = (0..60)
        .map(|i| Vector3::new(0.0, 0.0, 0.5 * f64::from(i)))
        .collect();
    let (deviation_mm, _) = solved(&problem(&line), 6);
    assert!(deviation_mm < 0.05, "{deviation_mm}");
}

#[test]
fn a_straight_needle_gets_a_straight_path() {
    let line: Vec<_> = (0..20)
        .map(|i| Vector3::new(0.3 * f64::from(i), 0.0, 0.5 * f64::from(i)))
        .collect();
    let curve = PositionCurve::through(&line, 0.0).unwrap();
    let straight = Needle::new(0.0).unwrap();
    let p = PositionPathProblem::new(straight, curve, PositionPathSettings::default()).unwrap();
    let (k, defect) = p.initial_guess().largest_defect(straight).unwrap().unwrap();
    assert!(defect.norm() < 1e-10, "{k} {defect}");
    // Turning gains a straight needle nothing; rounding of the frames over dt = 0.1.
    let turning = p
        .initial_guess()
        .inputs()
        .iter()
        .map(|u| u.omega_rad_s.abs());
    assert!(turning.fold(0.0, f64::max) < 1e-12);
}

#[test]
fn a_path_too_sharp_for_the_needle_says_where_and_gets_a_closest_path() {
    // Straight, then an arc of twice the needle's curvature, then straight.
    let sharp = Needle::new(2.0 * KAPPA_PER_MM).unwrap();
    let straight = Needle::new(0.0).unwrap();
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 0.0,
    };
    let mut pose = Pose::identity();
    let mut points = vec![pose.position_mm];
    for k in 0..60 {
        let n = if (20..40).contains(&k) {
            sharp
        } else {
            straight
        };
        pose = n.step(&pose, input, 0.1).unwrap();
        points.push(pose.position_mm);
    }
    let problem = problem(&points);
    let excesses = problem.curve().curvature_excesses(needle(), 0.05);
    assert_eq!(excesses.len(), 1, "{excesses:?}");
    let e = excesses[0];
    // The spline blurs the jumps of curvature at 10 and 20 mm over two knots, and overshoots there.
    assert!(
        (e.start_mm - 10.0).abs() < 1.0 && (e.end_mm - 20.0).abs() < 1.0,
        "{e:?}"
    );
    assert!(
        (e.curvature_per_mm / KAPPA_PER_MM - 2.0).abs() < 0.5,
        "{e:?}"
    );
    assert!((e.excess_per_mm - (e.curvature_per_mm - KAPPA_PER_MM)).abs() < 1e-15);
    let (deviation_mm, path) = solved(&problem, 40);
    // Turning 0.133 rad at curvature kappa in place of 2 kappa cuts the corner by
    // (150 - 75) 0.133^2 / 8 = 0.17 mm; the best path shares that between both sides of the curve.
    assert!(deviation_mm > 0.08 && deviation_mm < 0.25, "{deviation_mm}");
    assert!(
        path.inputs()
            .iter()
            .all(|u| problem.settings().within_limits(*u) == *u)
    );
}

#[test]
fn unusable_positions_and_settings_are_refused_by_name() {
    let p = |x: f64| Vector3::new(x, 0.0, 0.0);
    let through = |points: &[Vector3<f64>]| PositionCurve::through(points, 0.0);
    assert_eq!(
        through(&[p(0.0)]),
        Err(PositionCurveError::TooFew { found: 1 })
    );
    assert_eq!(
        through(&[p(0.0), p(1.0), p(1.0), p(2.0)]),
        Err(PositionCurveError::Coincident { index: 2 })
    );
    assert_eq!(
        through(&[p(0.0), p(1.0), p(f64::NAN), p(2.0)]),
        Err(PositionCurveError::NonFinite { index: 2 })
    );
    let line = [p(0.0), p(1.0), p(2.0), p(3.0)];
    assert!(PositionCurve::through(&line, -1.0).is_err());
    let curve = through(&line).unwrap();
    let refused = |settings: PositionPathSettings| match PositionPathProblem::new(
        needle(),
        curve.clone(),
        settings,
    ) {
        Err(PositionPathError::Setting { setting, .. }) => setting,
        _ => "",
    };
    let good = PositionPathSettings::default();
    assert_eq!(refused(good), "");
    assert_eq!(refused(PositionPathSettings { dt_s: 0.0, ..good }), "dt_s");
    let backwards = PositionPathSettings {
        omega_rate_max_rad_s2: -1.0,
        ..good
    };
    assert_eq!(refused(backwards), "omega_rate_max_rad_s2");
    let crawling = PositionPathSettings {
        speed_mm_s: 1e-12,
        v_min_mm_s: 0.0,
        ..good
    };
    assert_eq!(refused(crawling), "speed_mm_s");
    let unlimited = PositionPathSettings {
        v_max_mm_s: f64::NAN,
        ..good
    };
    assert_eq!(refused(unlimited), "v_max_mm_s");
    let unbounded = PositionPathSettings {
        v_min_mm_s: f64::NAN,
        ..good
    };
    assert_eq!(refused(unbounded), "v_min_mm_s");
    let hasty = PositionPathSettings {
        v_min_mm_s: 6.0,
        ..good
    };
    assert_eq!(refused(hasty), "speed_mm_s");
    // 3 mm of curve, 50 mm/s at least: not one step.
    let overshooting = PositionPathSettings {
        speed_mm_s: 50.0,
        v_min_mm_s: 50.0,
        v_max_mm_s: 60.0,
        ..good
    };
    assert_eq!(refused(overshooting), "v_min_mm_s");
}

#[test]
fn at_a_fixed_speed_every_target_can_be_reached() {
    // 30.2 mm at exactly 0.5 mm a step.
    let line: Vec<_> = (0..152)
        .map(|i| Vector3::new(0.0, 0.0, 0.2 * f64::from(i)))
        .collect();
    let curve = PositionCurve::through(&line, 0.0).unwrap();
    let settings = PositionPathSettings {
        v_min_mm_s: 5.0,
        v_max_mm_s: 5.0,
        ..PositionPathSettings::default()
    };
    let p = PositionPathProblem::new(needle(), curve, settings).unwrap();
    let targets = p.targets_mm();
    assert_eq!(targets.len(), 61);
    for (pair, input) in targets.windows(2).zip(p.initial_guess().inputs()) {
        assert!(((pair[1] - pair[0]).norm() - input.v_mm_s * 0.1).abs() < 1e-9);
    }
    // Short of the end by less than a step.
    assert!((targets[60].z - 30.0).abs() < 1e-9);
}

#[test]
fn the_guess_for_a_circle_too_sharp_stays_near_it() {
    // Radii below the needle's 150 mm: the closest path leaves the circle by some mm.
    for (radius_mm, turn_rad) in [(100.0, 3.1), (100.0, 1.5), (140.0, 1.0), (60.0, 1.0)] {
        for spacing_mm in [0.1, 0.5, 1.0] {
            let length_mm = radius_mm * turn_rad;
            let count = (length_mm / spacing_mm) as u32;
            let arc: Vec<_> = (0..=count)
                .map(|i| f64::from(i) * spacing_mm / radius_mm)
                .map(|a| Vector3::new(0.0, a.cos() - 1.0, a.sin()) * radius_mm)
                .collect();
            let p = problem(&arc);
            let guess = p.initial_guess().poses().iter();
            let off = guess
                .zip(p.targets_mm())
                .map(|(g, y)| (g.position_mm - y).norm());
            let worst = off.fold(0.0, f64::max);
            assert!(
                worst < 0.05 * length_mm,
                "{radius_mm} {spacing_mm}: {worst}"
            );
        }
    }
}

#[test]
fn stage_terms_are_derivatives_of_the_stage_residuals() {
    let problem = problem(&positions(&twisting(|k| 0.05 * k, 12)));
    let guess = problem.initial_guess();
    let pose = guess.poses()[3].perturbed(&Vector6::new(0.1, -0.2, 0.3, 0.02, 0.01, -0.3));
    let input = Input {
        v_mm_s: 4.0,
        omega_rad_s: 0.7,
    };
    let stage = |p: &Pose, u: Input| problem.stage(3, p, u, &guess.poses()[4]).unwrap().unwrap();
    let at = stage(&pose, input);
    for i in 0..6 {
        let column = derivative(1e-3, |t| {
            stage(&pose.perturbed(&Vector6::ith(i, t)), input).residual
        });
        // Weights are 20: rounding of 1e-14 over 1e-3, twenty times.
        assert!((column - at.by_pose.column(i)).norm() < 1e-8);
    }
    let by_v = derivative(1e-3, |t| {
        stage(
            &pose,
            Input {
                v_mm_s: 4.0 + t,
                ..input
            },
        )
        .residual
    });
    let by_omega = derivative(1e-3, |t| {
        stage(
            &pose,
            Input {
                omega_rad_s: 0.7 + t,
                ..input
            },
        )
        .residual
    });
    assert!((by_v - at.by_input.column(0)).norm() < 1e-8);
    assert!((by_omega - at.by_input.column(1)).norm() < 1e-8);
    assert!(problem.stage(99, &pose, input, &pose).unwrap().is_none());
    let last = problem.terminal(&pose);
    assert!((last.value - (pose.position_mm - problem.targets_mm()[12]) * 20.0).norm() < 1e-12);
}
