//! Design claims 4.8 to 4.10: what the chart hides and what a needle can correct.

use nalgebra::{Matrix2, Matrix6, SMatrix, Vector6};
use needle_model::{
    ControllabilityReport, ControllabilityWarning, EulerIntegrator, EulerPlant, Input, Needle,
};
use proptest::prelude::*;

use crate::chart::chart_point;

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

fn report(kappa: f64, v_mm_s: f64, omega_rad_s: f64) -> ControllabilityReport {
    let input = Input {
        v_mm_s,
        omega_rad_s,
    };
    ControllabilityReport::of_reference_input(Needle::new(kappa).unwrap(), input).unwrap()
}

fn words(report: &ControllabilityReport) -> Vec<&str> {
    report
        .uncontrollable
        .iter()
        .map(|d| d.words.as_str())
        .collect()
}

proptest! {
    #[test]
    fn in_the_chart_a_mode_at_one_is_never_controllable(
        state in chart_point(), v in -20.0..20.0_f64, omega in -6.0..6.0_f64, kappa in 0.0..0.05_f64,
    ) {
        for integrator in [EulerIntegrator::ForwardEuler, EulerIntegrator::PaperOrder, EulerIntegrator::Rk4] {
            let plant = EulerPlant { needle: Needle::new(kappa).unwrap(), integrator };
            let input = Input { v_mm_s: v, omega_rad_s: omega };
            let Ok(j) = plant.linearise(&state, input, 0.1) else { continue };
            let mut hautus = SMatrix::<f64, 8, 6>::zeros();
            hautus.fixed_view_mut::<6, 6>(0, 0).copy_from(&(j.a - Matrix6::identity()).transpose());
            hautus.fixed_view_mut::<2, 6>(6, 0).copy_from(&j.b.transpose());
            let s = hautus.singular_values();
            // Three columns of A - I are exactly zero: only the rounding of the SVD is left.
            prop_assert!(s.min() <= 1e-14 * s.max(), "{s}");
        }
    }

    #[test]
    fn a_general_helix_is_controllable_in_all_six_directions(
        kappa in 1e-3..0.05_f64, v in 1.0..20.0_f64, ratio in prop_oneof![0.05..0.9_f64, 1.1..5.0_f64],
        sign in prop_oneof![Just(1.0), Just(-1.0)],
    ) {
        let r = report(kappa, v * sign, ratio * kappa * v);
        prop_assert_eq!(r.dimension, 6);
        prop_assert!(r.uncontrollable.is_empty());
    }

    #[test]
    fn special_references_lose_dimensions(
        kappa in 1e-3..0.05_f64, v in 1.0..20.0_f64, omega in 0.01..6.0_f64,
    ) {
        prop_assert_eq!(report(0.0, v, omega).dimension, 2);
        prop_assert_eq!(report(0.0, v, 0.0).dimension, 2);
        prop_assert_eq!(report(kappa, v, 0.0).dimension, 4);
        prop_assert_eq!(report(kappa, 0.0, omega).dimension, 4);
        prop_assert_eq!(report(kappa, v, kappa * v).dimension, 5);
        prop_assert_eq!(report(kappa, -v, kappa * v).dimension, 5);
    }

    #[test]
    fn a_constant_window_has_the_dimension_of_its_input(
        kappa in 2e-3..0.02_f64, v in 2.0..20.0_f64, omega in 0.3..3.0_f64,
    ) {
        let needle = Needle::new(kappa).unwrap();
        for (v_mm_s, omega_rad_s) in [(v, 0.0), (0.0, omega)] {
            let window = vec![Input { v_mm_s, omega_rad_s }; 12];
            let r = ControllabilityReport::over_window(needle, &window, 0.1).unwrap();
            prop_assert_eq!(r.dimension, 4, "{}", r.singular_values);
        }
        let window = vec![Input { v_mm_s: v, omega_rad_s: kappa * v * 2.5 }; 40];
        let dt_s = 2.0 / (40.0 * kappa * v);
        prop_assert_eq!(ControllabilityReport::over_window(needle, &window, dt_s).unwrap().dimension, 6);
    }
}

#[test]
fn on_a_planar_arc_in_plane_errors_are_named_uncontrollable() {
    let r = report(KAPPA_PER_MM, 10.0, 0.0);
    assert_eq!(
        words(&r),
        ["in-plane cross-track", "in-plane heading with along-track"]
    );
    assert!(matches!(
        r.warnings[0],
        ControllabilityWarning::NearPlanarArc { rate_ratio: 0.0 }
    ));
}

#[test]
fn a_straight_needle_corrects_depth_and_roll_only() {
    assert_eq!(
        words(&report(0.0, 10.0, 1.0)),
        [
            "out-of-plane cross-track",
            "in-plane cross-track",
            "in-plane heading",
            "out-of-plane heading"
        ]
    );
}

#[test]
fn equal_rates_are_warned_of_and_a_good_helix_is_not() {
    let r = report(KAPPA_PER_MM, 10.0, 1.02 * KAPPA_PER_MM * 10.0);
    assert!(matches!(
        r.warnings[0],
        ControllabilityWarning::NearEqualRates { .. }
    ));
    assert!(
        report(KAPPA_PER_MM, 10.0, 2.0 * KAPPA_PER_MM * 10.0)
            .warnings
            .is_empty()
    );
}

#[test]
fn the_papers_reference_is_controllable_on_paper_only() {
    // v = 10 mm/s, 0.05 deg/s: |omega| / (kappa v) = 0.0131.
    let r = report(KAPPA_PER_MM, 10.0, 0.05_f64.to_radians());
    assert_eq!(r.dimension, 6);
    assert!(
        r.warnings
            .iter()
            .any(|w| matches!(w, ControllabilityWarning::NearPlanarArc { .. }))
    );
    assert!(
        r.warnings
            .iter()
            .any(|w| matches!(w, ControllabilityWarning::Weak { .. })),
        "{r:?}"
    );
}

#[test]
fn one_varying_window_controls_what_a_planar_arc_cannot() {
    let needle = Needle::new(KAPPA_PER_MM).unwrap();
    let arc = vec![
        Input {
            v_mm_s: 10.0,
            omega_rad_s: 0.0
        };
        40
    ];
    let mut varied = arc.clone();
    for (k, u) in varied.iter_mut().enumerate() {
        u.omega_rad_s = (k as f64 * 0.3).sin() * 3.0;
    }
    let dimension = |w: &[Input]| {
        ControllabilityReport::over_window(needle, w, 0.1)
            .unwrap()
            .dimension
    };
    assert_eq!((dimension(&arc), dimension(&varied)), (4, 6));
}

/// Stabilising Riccati solution by structure-preserving doubling, and the closed loop's radius.
fn regulator(input: Input) -> (Matrix6<f64>, f64) {
    let j = Needle::new(KAPPA_PER_MM)
        .unwrap()
        .linearise(input, 0.1)
        .unwrap();
    let q = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 10.0, 10.0, 1.0));
    let r = Matrix2::identity() * 0.1;
    let (mut a, mut g, mut h) = (j.a, j.b * j.b.transpose() / 0.1, q);
    for _ in 0..40 {
        let w = (Matrix6::identity() + g * h).try_inverse().unwrap();
        let (a1, g1) = (a * w * a, g + a * w * g * a.transpose());
        h += a.transpose() * h * w * a;
        (a, g) = (a1, g1);
    }
    let k = (r + j.b.transpose() * h * j.b).try_inverse().unwrap() * j.b.transpose() * h * j.a;
    let closed = j.a - j.b * k;
    let radius = closed
        .complex_eigenvalues()
        .iter()
        .map(|z| z.norm())
        .fold(0.0, f64::max);
    (h, radius)
}

#[test]
fn a_twisting_reference_has_a_fast_regulator() {
    let (_, radius) = regulator(Input {
        v_mm_s: 10.0,
        omega_rad_s: 1.0,
    });
    // Design claim 4.9: 0.9555.
    assert!((radius - 0.9555).abs() < 5e-5, "{radius}");
}

#[test]
fn the_papers_reference_has_a_huge_riccati_solution() {
    let (p, radius) = regulator(Input {
        v_mm_s: 10.0,
        omega_rad_s: 0.05_f64.to_radians(),
    });
    // Design claim 4.10: about 1e8 and 0.99991.
    assert!(p.amax() > 1e7 && p.amax() < 1e9, "{:e}", p.amax());
    assert!((radius - 0.99991).abs() < 2e-5, "{radius}");
}

fn window_warnings(inputs: &[(f64, f64)]) -> Vec<ControllabilityWarning> {
    let inputs: Vec<_> = inputs
        .iter()
        .cycle()
        .take(40)
        .map(|&(v_mm_s, omega_rad_s)| Input {
            v_mm_s,
            omega_rad_s,
        })
        .collect();
    let needle = Needle::new(KAPPA_PER_MM).unwrap();
    ControllabilityReport::over_window(needle, &inputs, 0.1)
        .unwrap()
        .warnings
}

#[test]
fn turns_in_place_make_no_planar_arc() {
    let planar =
        |w: &ControllabilityWarning| matches!(w, ControllabilityWarning::NearPlanarArc { .. });
    assert!(
        window_warnings(&[(10.0, 0.0), (0.0, 1.0)])
            .iter()
            .all(|w| !planar(w))
    );
    // Standing still changes nothing: this is a planar arc with a pause.
    assert!(
        window_warnings(&[(10.0, 0.0), (0.0, 0.0)])
            .iter()
            .any(planar)
    );
}

#[test]
fn rates_that_alternate_in_sign_are_not_equal_rates() {
    let equal =
        |w: &ControllabilityWarning| matches!(w, ControllabilityWarning::NearEqualRates { .. });
    let rate = KAPPA_PER_MM * 10.0;
    assert!(
        window_warnings(&[(10.0, rate), (10.0, -rate)])
            .iter()
            .all(|w| !equal(w))
    );
    assert!(
        window_warnings(&[(10.0, rate), (-10.0, -rate)])
            .iter()
            .any(equal)
    );
}

proptest! {
    #[test]
    fn functionals_of_uncontrollable_directions_vanish_on_what_inputs_can_do(
        kappa in 1e-3..0.05_f64, v in 1.0..20.0_f64, ratio in prop_oneof![Just(0.0), Just(1.0)],
    ) {
        let (needle, input) = (Needle::new(kappa).unwrap(), Input { v_mm_s: v, omega_rad_s: ratio * kappa * v });
        let dt_s = 0.2 / (kappa * v);
        let r = ControllabilityReport::over_window(needle, &[input; 20], dt_s).unwrap();
        prop_assert!(!r.uncontrollable.is_empty());
        let j = needle.linearise(input, dt_s).unwrap();
        let mut reachable = j.b;
        for _ in 0..20 {
            for d in &r.uncontrollable {
                for column in reachable.column_iter() {
                    // In physical units, no scaling: rounding against the terms of the product.
                    let terms = d.functional.component_mul(&column).abs().sum();
                    let size = d.functional.norm() * column.norm();
                    prop_assert!(d.functional.dot(&column).abs() <= 1e-9 * terms.max(size), "{}", d.words);
                }
                let l = r.length_scale_mm;
                for i in 0..6 {
                    let scale = if i < 3 { l * l } else { 1.0 };
                    prop_assert!((d.xi[i] - d.functional[i] * scale).abs() <= 1e-12 * d.xi[i].abs());
                }
            }
            reachable = j.a * reachable;
        }
    }
}
