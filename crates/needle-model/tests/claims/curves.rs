//! The smooth curve through positions: arc length, tangent, curvature, smoothing.

use nalgebra::Vector3;
use needle_model::{Input, Needle, Pose, PositionCurve, ReferencePath};

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

#[test]
fn the_curve_knows_a_circle() {
    let radius_mm = 80.0;
    let at = |angle: f64| Vector3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), 3.0);
    // Uneven spacing of 1 to 3 mm over a third of a turn.
    let angles: Vec<f64> = (0..80)
        .map(|i| 0.025 * f64::from(i) + 0.012 * f64::from(i % 2))
        .collect();
    let curve =
        PositionCurve::through(&angles.iter().map(|&a| at(a)).collect::<Vec<_>>(), 0.0).unwrap();
    let total = radius_mm * angles[79];
    assert!((curve.length_mm() - total).abs() < 1e-4);
    for i in 0..=50 {
        let s = total * f64::from(i) / 50.0;
        let point = curve.at(s);
        let angle = s / radius_mm;
        // Spacing h of 2 mm: position h^4 / (384 R^3), tangent h^3 / (24 R^3), curvature h^2 / (12 R^3),
        // each a few times larger at the ends.
        assert!((point.position_mm - at(angle)).norm() < 1e-5);
        assert!((point.tangent - Vector3::new(-angle.sin(), angle.cos(), 0.0)).norm() < 1e-5);
        let centre = (Vector3::new(0.0, 0.0, 3.0) - point.position_mm) / (radius_mm * radius_mm);
        assert!((point.curvature_per_mm - centre).norm() < 1e-2 / radius_mm);
    }
}

#[test]
fn smoothing_recovers_the_curvature_of_noisy_positions() {
    // Ripple of 0.05 mm on an arc of the needle: raw second differences of 0.5 mm spacing are useless.
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 0.0,
    };
    let needle = Needle::new(KAPPA_PER_MM).unwrap();
    let truth = ReferencePath::from_inputs(needle, Pose::identity(), vec![input; 60], 0.1).unwrap();
    let noisy: Vec<_> = truth
        .poses()
        .iter()
        .enumerate()
        .map(|(i, p)| p.position_mm + Vector3::new(0.0, 0.05, -0.05) * (i as f64 * 2.4).sin())
        .collect();
    let middle_error = |smoothing_mm: f64| {
        let curve = PositionCurve::through(&noisy, smoothing_mm).unwrap();
        (curve.at(15.0).curvature_per_mm.norm() - KAPPA_PER_MM).abs() / KAPPA_PER_MM
    };
    // Spacing 0.5 mm, 2.4 rad a sample: wavelength 1.3 mm. Smoothing at 3 mm keeps 1e-7 of it.
    assert!(
        middle_error(0.0) > 1.0 && middle_error(3.0) < 0.05,
        "{} {}",
        middle_error(0.0),
        middle_error(3.0)
    );
}

#[test]
fn the_torsion_of_an_executed_path_is_omega_over_v() {
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: -0.7,
    };
    let needle = Needle::new(KAPPA_PER_MM).unwrap();
    let path = ReferencePath::from_inputs(needle, Pose::identity(), vec![input; 60], 0.1).unwrap();
    let points: Vec<_> = path.poses().iter().map(|p| p.position_mm).collect();
    let curve = PositionCurve::through(&points, 0.0).unwrap();
    for s_mm in [0.0, 7.3, 15.0, 30.0] {
        let torsion = curve.torsion_per_mm(s_mm).unwrap();
        // Central differences over 0.5 mm: (torsion h)^2 / 6 = 8e-4, and the spline's own error.
        assert!((torsion + 0.14).abs() < 0.14 * 5e-3, "{s_mm} {torsion}");
    }
    let line: Vec<_> = (0..9).map(|i| Vector3::z() * f64::from(i)).collect();
    let straight = PositionCurve::through(&line, 0.0).unwrap();
    assert_eq!(straight.torsion_per_mm(4.0), None);
}
