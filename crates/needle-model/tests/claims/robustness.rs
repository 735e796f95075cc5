//! Whatever a caller passes, the answer is a value: nothing panics or hangs, and every `Ok` is finite.

use nalgebra::{Vector3, Vector6};
use needle_model::{
    Arc, ControllabilityReport, CurvatureProfile, EulerIntegrator, EulerPlant, EulerState, Input,
    LaggedState, Needle, PATH_CSV_HEADER, PhysicalNeedle, PlannerFile, Pose, PositionCurve,
    PositionPathProblem, PositionPathSettings, ReferencePath, StaticWindUp, Torsion, TorsionalLag,
    printed_linearisation, read_planner_poses,
};
use proptest::prelude::*;

/// Ordinary numbers, numbers of any exponent, and the ones that break arithmetic.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0_f64,
        3 => (-1.0..1.0_f64, -320..309_i32).prop_map(|(m, e)| m * 10f64.powi(e)),
        1 => prop::sample::select(vec![
            0.0, -0.0, 5e-324, 1e120, 1e200, -1e300, f64::MAX, f64::NAN, f64::INFINITY, f64::NEG_INFINITY,
        ]),
    ]
}

fn any_input() -> impl Strategy<Value = Input> {
    (any_number(), any_number()).prop_map(|(v_mm_s, omega_rad_s)| Input {
        v_mm_s,
        omega_rad_s,
    })
}

fn any_position() -> impl Strategy<Value = Vector3<f64>> {
    (any_number(), any_number(), any_number()).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn all_finite<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|x| x.is_finite())
}

fn path_is_finite(path: &ReferencePath) -> bool {
    let inputs = path
        .inputs()
        .iter()
        .all(|u| u.v_mm_s.is_finite() && u.omega_rad_s.is_finite());
    let numbers = all_finite(path.arc_length_mm()) && path.duration_s().is_finite();
    inputs && numbers && path.poses().iter().all(Pose::is_finite)
}

#[test]
fn inputs_too_large_to_compute_with_are_refused() {
    let needle = Needle::new(1.0 / 150.0).unwrap();
    for (v_mm_s, omega_rad_s) in [(1.0, 1e200), (1e300, 0.0), (1e120, 1.0)] {
        let input = Input {
            v_mm_s,
            omega_rad_s,
        };
        assert!(needle.step(&Pose::identity(), input, 0.1).is_err());
        assert!(needle.linearise(input, 0.1).is_err());
    }
}

#[test]
fn a_previous_chart_point_that_is_no_number_is_refused() {
    let lost = EulerState {
        alpha_rad: f64::NAN,
        ..EulerState::default()
    };
    assert!(EulerState::from_pose_near(&Pose::identity(), &lost).is_err());
}

proptest! {
    #[test]
    fn every_step_and_derivative_on_se3_is_finite_or_an_error(
        input in any_input(), kappa in any_number(), dt in any_number(), at in any_position(), to in any_position(),
    ) {
        let (mut pose, mut target) = (Pose::identity(), Pose::exp(&Vector6::new(0.0, 0.0, 1.0, 0.3, 0.2, 0.1)));
        (pose.position_mm, target.position_mm) = (at, to);
        let Ok(needle) = Needle::new(kappa) else { return Ok(()) };
        if let Ok(next) = needle.step(&pose, input, dt) {
            prop_assert!(next.is_finite());
            prop_assert!((next.rotation.norm() - 1.0).abs() < 1e-12);
        }
        if let Ok(j) = needle.linearise(input, dt) {
            prop_assert!(all_finite(&j.a) && all_finite(&j.b) && all_finite(&j.curvature));
        }
        if let Ok(r) = needle.step_residual(&pose, input, &target, dt) {
            prop_assert!(all_finite(&r.value) && all_finite(&r.by_pose) && all_finite(&r.by_input));
            prop_assert!(all_finite(&r.by_target) && all_finite(&r.by_curvature));
        }
        if let Ok(path) = ReferencePath::from_inputs(needle, pose, vec![input; 3], dt) {
            prop_assert!(path_is_finite(&path));
        }
        if let Ok(path) = ReferencePath::from_poses(vec![pose, target], dt) {
            prop_assert!(path_is_finite(&path));
        }
    }

    #[test]
    fn reports_on_any_inputs_are_finite_or_errors(
        inputs in prop::collection::vec(any_input(), 0..8), kappa in any_number(), dt in any_number(),
    ) {
        let Ok(needle) = Needle::new(kappa) else { return Ok(()) };
        let window = ControllabilityReport::over_window(needle, &inputs, dt);
        let single = inputs.first().map(|&u| ControllabilityReport::of_reference_input(needle, u));
        for report in single.into_iter().chain([window]).flatten() {
            prop_assert!(report.dimension <= 6 && report.uncontrollable.len() == 6 - report.dimension);
            prop_assert!(report.singular_values.iter().all(|s| s.is_finite()));
        }
    }

    #[test]
    fn every_chart_step_and_derivative_is_finite_or_an_error(
        state in (any_position(), any_position()), input in any_input(), dt in any_number(), kappa in any_number(),
    ) {
        let (p, a) = state;
        let state = EulerState::from_vector(&Vector6::new(p.x, p.y, p.z, a.x, a.y, a.z));
        let Ok(needle) = Needle::new(kappa) else { return Ok(()) };
        if let Ok(near) = EulerState::from_pose_near(&Pose::identity(), &state) {
            prop_assert!(all_finite(&near.to_vector()));
        }
        for integrator in [EulerIntegrator::ForwardEuler, EulerIntegrator::PaperOrder, EulerIntegrator::Rk4] {
            let plant = EulerPlant { needle, integrator };
            if let Ok(next) = plant.step(&state, input, dt) {
                prop_assert!(all_finite(&next.to_vector()), "{integrator:?} {next:?}");
            }
            let exact = plant.linearise(&state, input, dt);
            for j in [exact, printed_linearisation(&plant, &state, input, dt)].into_iter().flatten() {
                prop_assert!(all_finite(&j.a) && all_finite(&j.b));
            }
        }
    }

    #[test]
    fn every_curve_and_its_guess_are_finite_or_errors(
        positions in prop::collection::vec(any_position(), 0..12), smoothing in any_number(), s in any_number(),
    ) {
        let Ok(curve) = PositionCurve::through(&positions, smoothing) else { return Ok(()) };
        let point = curve.at(s);
        prop_assert!(all_finite(&point.position_mm) && all_finite(&point.curvature_per_mm));
        prop_assert!((point.tangent.norm() - 1.0).abs() < 1e-12);
        prop_assert!(curve.torsion_per_mm(s).is_none_or(f64::is_finite));
        let needle = Needle::new(1.0 / 150.0).unwrap();
        if let Ok(p) = PositionPathProblem::new(needle, curve, PositionPathSettings::default()) {
            prop_assert!(path_is_finite(p.initial_guess()));
        }
    }

    #[test]
    fn what_readers_accept_is_finite(text in "[-0-9.eEnaif, \n]{0,120}", numbers in prop::collection::vec(any_number(), 14)) {
        let row = |n: &[f64], t: f64| format!("{t},{},{},{},1,0,0,0,{},{}\n", n[0], n[1], n[2], n[3], n[4]);
        let huge = format!("{PATH_CSV_HEADER}\n{}{}{}", row(&numbers, 0.0), row(&numbers[5..], numbers[13]),
            row(&[0.0; 5], 2.0 * numbers[13]));
        let ours = format!("{PATH_CSV_HEADER}\n{text}");
        for path in [&text, &ours, &huge].into_iter().flat_map(|t| ReferencePath::from_csv(t)) {
            prop_assert!(path_is_finite(&path));
        }
        let plan = format!("{} {} {} 1 0 0 0", numbers[0], numbers[1], numbers[2]);
        for poses in [&text, &plan].into_iter().flat_map(|t| read_planner_poses(t, PlannerFile::StartAndGoal)) {
            prop_assert!(poses.iter().all(Pose::is_finite));
        }
    }

    #[test]
    fn every_arc_is_finite_or_an_error(
        at in any_position(), target in any_position(), v in any_number(), tolerance in any_number(),
    ) {
        let mut start = Pose::exp(&Vector6::new(0.0, 0.0, 0.0, 0.4, -0.8, 0.3));
        start.position_mm = at;
        if let Ok(arc) = Arc::to_point(&start, &target) {
            prop_assert!(all_finite(&[arc.bevel_roll_rad, arc.curvature_per_mm, arc.length_mm]));
            prop_assert!(arc.end.is_finite());
            prop_assert!(arc.insertion(v).is_none_or(|(u, s)| u.v_mm_s.is_finite() && s.is_finite()));
        }
        let mut goal = start;
        goal.position_mm = target;
        if let Ok((arc, roll)) = Arc::to_pose(&start, &goal, tolerance) {
            prop_assert!(arc.end.is_finite() && roll.is_finite() && tolerance >= 0.0);
        }
    }

    #[test]
    fn every_effect_is_finite_or_an_error(
        a in any_number(), b in any_number(), c in any_number(), input in any_input(), dt in any_number(),
    ) {
        if let Ok(profile) = CurvatureProfile::new(&[(a, b.abs()), (c, b.abs())]) {
            prop_assert!(profile.at(b).curvature_per_mm().is_finite());
        }
        let needle = Needle::new(0.01).unwrap();
        let shafts = [
            StaticWindUp::at_depth(a, b).ok().map(Torsion::WindUp),
            TorsionalLag::new(a).ok().map(Torsion::FirstOrder),
        ];
        for torsion in shafts.into_iter().flatten() {
            let plant = PhysicalNeedle { torsion, ..PhysicalNeedle::from(needle) };
            let mut state = plant.at_entry(&Pose::identity());
            (state.lag_rad, state.inserted_mm) = (c, b);
            if let Ok(next) = plant.step(&state, input, dt) {
                prop_assert!(next.frame.is_finite() && next.lag_rad.is_finite() && next.inserted_mm.is_finite());
            }
        }
        if let Ok(torsion) = TorsionalLag::new(a) {
            let state = LaggedState { pose: Pose::identity(), needle, lag_rad: c };
            if let Ok(next) = state.step(torsion, input, dt) {
                prop_assert!(next.pose.is_finite() && next.lag_rad.is_finite());
            }
            if let Ok(j) = state.linearise(torsion, input, dt) {
                prop_assert!(all_finite(&j.a) && all_finite(&j.b));
            }
        }
    }
}
