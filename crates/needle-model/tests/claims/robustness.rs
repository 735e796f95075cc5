//! Whatever a caller passes, the answer is a value: nothing panics, hangs or returns a silent NaN.

use nalgebra::{Vector3, Vector6};
use needle_model::{
    Arc, ControllabilityReport, CurvatureProfile, EulerIntegrator, EulerPlant, EulerState, Input,
    Needle, PATH_CSV_HEADER, PlannerFile, Pose, PositionCurve, PositionPathProblem,
    PositionPathSettings, ReferencePath, StaticWindUp, Torsion, read_planner_poses,
};
use proptest::prelude::*;

/// Ordinary numbers, and the ones that break arithmetic.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0_f64,
        1 => prop::sample::select(vec![
            0.0, -0.0, 1e-300, 5e-324, -1e300, f64::MAX, f64::NAN, f64::INFINITY, f64::NEG_INFINITY,
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

proptest! {
    #[test]
    fn ordinary_steps_give_a_finite_pose_and_others_return(
        input in any_input(), kappa in any_number(), dt in any_number(), at in any_position(),
    ) {
        let mut pose = Pose::identity();
        pose.position_mm = at;
        let Ok(needle) = Needle::new(kappa) else { return Ok(()) };
        if let Ok(next) = needle.step(&pose, input, dt) {
            let ordinary = [kappa, dt, input.v_mm_s, input.omega_rad_s].iter().all(|x| x.abs() <= 10.0);
            prop_assert!(next.is_finite() || !ordinary || at.amax() > 10.0);
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
    fn chart_steps_on_anything_return(
        state in (any_position(), any_position()), input in any_input(), dt in any_number(),
    ) {
        let (p, a) = state;
        let state = EulerState::from_vector(&Vector6::new(p.x, p.y, p.z, a.x, a.y, a.z));
        let needle = Needle::new(0.01).unwrap();
        for integrator in [EulerIntegrator::ForwardEuler, EulerIntegrator::PaperOrder, EulerIntegrator::Rk4] {
            let plant = EulerPlant { needle, integrator };
            let _ = plant.linearise(&state, input, dt);
            if plant.step(&state, input, dt).is_ok() {
                prop_assert!(state.to_vector().iter().all(|x| x.is_finite()));
            }
        }
    }

    #[test]
    fn curves_through_any_positions_return(
        positions in prop::collection::vec(any_position(), 0..12), smoothing in any_number(), s in any_number(),
    ) {
        let Ok(curve) = PositionCurve::through(&positions, smoothing) else { return Ok(()) };
        let _ = (curve.at(s), curve.torsion_per_mm(s));
        let needle = Needle::new(1.0 / 150.0).unwrap();
        if let Ok(p) = PositionPathProblem::new(needle, curve, PositionPathSettings::default()) {
            prop_assert!(p.initial_guess().poses().iter().all(Pose::is_finite));
        }
    }

    #[test]
    fn readers_of_any_text_return(text in "[-0-9.eEnaif, \\n]{0,120}") {
        let _ = read_planner_poses(&text, PlannerFile::InterpolatedPlan);
        let _ = ReferencePath::from_csv(&text);
        let _ = ReferencePath::from_csv(&format!("{PATH_CSV_HEADER}\n{text}"));
    }

    #[test]
    fn effects_of_any_numbers_return(a in any_number(), b in any_number(), c in any_number(), target in any_position()) {
        let _ = Arc::to_point(&Pose::identity(), &target);
        if let Ok(profile) = CurvatureProfile::new(&[(a, b.abs()), (c, b.abs())]) {
            prop_assert!(profile.at(b).curvature_per_mm().is_finite());
        }
        if let Ok(shaft) = StaticWindUp::at_depth(a, b) {
            let _ = Torsion::WindUp(shaft).advance(a, b, c, 0.1);
        }
    }
}
