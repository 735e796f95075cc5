//! The Euler chart and its plant against SE(3) and against the paper's recorded path.

use nalgebra::Vector6;
use needle_model::{ChartError, EulerIntegrator, EulerPlant, EulerState, Input, Needle, Pose};
use proptest::prelude::*;

fn plant(integrator: EulerIntegrator) -> EulerPlant {
    EulerPlant {
        needle: Needle::new(1.0 / 150.0).expect("valid curvature"),
        integrator,
    }
}

pub(crate) fn chart_point() -> impl Strategy<Value = EulerState> {
    let angle = -3.0..3.0_f64;
    (
        -50.0..50.0_f64,
        -50.0..50.0_f64,
        angle.clone(),
        -1.4..1.4_f64,
        angle,
    )
        .prop_map(|(x, z, alpha, beta, gamma)| {
            EulerState::from_vector(&Vector6::new(x, -x, z, alpha, beta, gamma))
        })
}

#[test]
fn paper_order_reproduces_the_recorded_reference_path() {
    // (step, x mm, y mm, z mm) as the authors recorded it, 9 digits (x in mm, y and z in cm).
    let recorded = [
        (2, 0.0, -0.00666661728, 1.99997778),
        (10, 6.9801223e-05, -0.2999, 9.99366793),
        (29, 0.00212212868, -2.6985351, 28.8288868),
        (50, 0.0113422219, -8.09281802, 49.1065451),
        (60, 0.0147752275, -9.61980679, 53.3393393),
    ];
    let omega_rad_s = 0.05_f64.to_radians();
    let mut state = EulerState::default();
    let mut visited = vec![state];
    for step in 0..60 {
        let v_mm_s = if step < 50 {
            10.0
        } else {
            9.0 - f64::from(step - 50)
        };
        let input = Input {
            v_mm_s,
            omega_rad_s,
        };
        state = plant(EulerIntegrator::PaperOrder)
            .step(&state, input, 0.1)
            .unwrap();
        visited.push(state);
    }
    for (step, x, y, z) in recorded {
        let s: &EulerState = &visited[step];
        assert!(
            (s.x_mm - x).abs() < 1e-9 && (s.y_mm - y).abs() < 1e-7 && (s.z_mm - z).abs() < 1e-7,
            "{s:?}"
        );
    }
}

/// Distance between chart and SE(3) after two seconds at step `dt_s`.
fn chart_error(integrator: EulerIntegrator, steps: u32) -> f64 {
    let plant = plant(integrator);
    let input = Input {
        v_mm_s: 20.0,
        omega_rad_s: 1.0,
    };
    let start = EulerState::from_vector(&Vector6::new(1.0, 2.0, 3.0, 0.4, -0.5, 0.6));
    let mut state = start;
    for _ in 0..steps {
        state = plant.step(&state, input, 2.0 / f64::from(steps)).unwrap();
    }
    let exact = plant.needle.step(&start.to_pose(), input, 2.0).unwrap();
    state.to_pose().error_from(&exact).norm()
}

#[test]
fn forward_euler_converges_to_se3_with_order_one() {
    let order = (chart_error(EulerIntegrator::ForwardEuler, 200)
        / chart_error(EulerIntegrator::ForwardEuler, 400))
    .log2();
    // The next term of the expansion is 1/200 of the first.
    assert!((order - 1.0).abs() < 0.02, "{order}");
}

#[test]
fn paper_order_converges_to_se3_with_order_one() {
    let order = (chart_error(EulerIntegrator::PaperOrder, 200)
        / chart_error(EulerIntegrator::PaperOrder, 400))
    .log2();
    assert!((order - 1.0).abs() < 0.02, "{order}");
}

#[test]
fn runge_kutta_converges_to_se3_with_order_four() {
    let order =
        (chart_error(EulerIntegrator::Rk4, 20) / chart_error(EulerIntegrator::Rk4, 40)).log2();
    assert!((order - 4.0).abs() < 0.1, "{order}");
}

#[test]
fn near_the_singularity_the_chart_is_an_error_not_an_infinity() {
    let state = EulerState {
        beta_rad: std::f64::consts::FRAC_PI_2,
        ..EulerState::default()
    };
    let input = Input {
        v_mm_s: 1.0,
        omega_rad_s: 0.0,
    };
    for integrator in [
        EulerIntegrator::ForwardEuler,
        EulerIntegrator::PaperOrder,
        EulerIntegrator::Rk4,
    ] {
        assert!(matches!(
            plant(integrator).step(&state, input, 0.1),
            Err(ChartError::NearSingularity { .. })
        ));
    }
    assert!(matches!(
        EulerState::from_pose(&state.to_pose()),
        Err(ChartError::NearSingularity { .. })
    ));
}

#[test]
fn a_rolling_needle_has_a_continuous_chart_over_many_turns() {
    let needle = Needle::new(1.0 / 150.0).unwrap();
    let input = Input {
        v_mm_s: 2.0,
        omega_rad_s: 3.0,
    };
    let mut pose = EulerState {
        beta_rad: 2.0,
        ..EulerState::default()
    }
    .to_pose();
    let mut state = EulerState {
        beta_rad: 2.0,
        ..EulerState::default()
    };
    for _ in 0..200 {
        pose = needle.step(&pose, input, 0.1).unwrap();
        let next = EulerState::from_pose_near(&pose, &state).unwrap();
        // At most 0.3 rad of roll and a little bending in one step.
        assert!(
            (next.to_vector() - state.to_vector())
                .fixed_rows::<3>(3)
                .norm()
                < 0.4
        );
        state = next;
    }
    assert!(state.gamma_rad > 50.0);
}

proptest! {
    #[test]
    fn chart_and_pose_round_trip(state in chart_point()) {
        let back = EulerState::from_pose(&state.to_pose()).unwrap();
        // cos 1.4 = 0.17: the chart amplifies rounding at most six times.
        prop_assert!((back.to_vector() - state.to_vector()).norm() < 1e-13);
    }

    #[test]
    fn chart_rate_is_the_body_twist(
        state in chart_point(), v in -20.0..20.0_f64, omega in -6.0..6.0_f64,
    ) {
        let p = plant(EulerIntegrator::Rk4);
        let input = Input { v_mm_s: v, omega_rad_s: omega };
        let rate = p.rate(&state, input).unwrap();
        let h = 1e-5;
        let at = |t: f64| -> Pose { EulerState::from_vector(&(state.to_vector() + rate * t)).to_pose() };
        let body = (at(h).error_from(&at(0.0)) - at(-h).error_from(&at(0.0))) / (2.0 * h);
        // Central differences of step 1e-5: rounding 1e-14 * 50 / 1e-5, truncation 1e-10 |rate|^3.
        prop_assert!((body - p.needle.twist(input)).norm() < 1e-6);
    }
}
