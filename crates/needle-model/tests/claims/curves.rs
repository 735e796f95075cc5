//! The smooth curve through positions: arc length, tangent, curvature, smoothing.

use nalgebra::Vector3;
use needle_model::{Input, Needle, Pose, PositionCurve, PositionCurveError, ReferencePath};

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

fn circle(radius_mm: f64, spacing_mm: f64, length_mm: f64) -> Vec<Vector3<f64>> {
    let count = (length_mm / spacing_mm).round() as u32;
    let angle = |i: u32| f64::from(i) * length_mm / f64::from(count) / radius_mm;
    (0..=count)
        .map(|i| Vector3::new(angle(i).cos(), angle(i).sin(), 0.1) * radius_mm)
        .collect()
}

#[test]
fn smoothing_a_circle_leaves_a_circle_at_any_spacing_and_length() {
    let radius_mm = 100.0;
    for spacing_mm in [0.02, 0.05, 0.1, 0.5, 2.0] {
        for smoothing_mm in [0.5, 2.0, 5.0, 10.0, 20.0, 30.0] {
            let points = circle(radius_mm, spacing_mm, 150.0);
            let curve = PositionCurve::through(&points, smoothing_mm).unwrap();
            let off = |s: f64| {
                let p = curve.at(s).position_mm;
                (p.xy().norm() - radius_mm).abs().max((p.z - 10.0).abs())
            };
            let worst = (0..=100)
                .map(|i| off(1.5 * f64::from(i)))
                .fold(0.0, f64::max);
            // The filter keeps 1 / (1 + (l / R)^6) of a turn. Free ends put the third and fourth
            // derivatives to zero, a circle has 1 / R^3 across it: 2.4 l^4 / R^3 is lost there (measured).
            let ratio = smoothing_mm / radius_mm;
            let filtered_mm = radius_mm * ratio.powi(6);
            let ends_mm = radius_mm * ratio.powi(4);
            assert!(
                worst < 1e-5 + 3.0 * ends_mm + 2.0 * filtered_mm,
                "h {spacing_mm} l {smoothing_mm}: {worst:e} {filtered_mm:e}"
            );
        }
    }
}

#[test]
fn smoothing_at_a_coarser_resolution_agrees_with_smoothing_at_every_point() {
    // The same noisy curve, sampled so that all points are nodes, and four times finer.
    let ripple = |p: &Vector3<f64>| p + Vector3::z() * 0.3 * (p.y * 0.25).sin();
    let curve = |spacing_mm: f64| {
        let points: Vec<_> = circle(100.0, spacing_mm, 120.0)
            .iter()
            .map(ripple)
            .collect();
        PositionCurve::through(&points, 6.0).unwrap()
    };
    let (coarse, fine) = (curve(0.4), curve(0.1));
    for i in 0..=60 {
        let s = coarse.length_mm() * f64::from(i) / 60.0;
        let gap = (coarse.at(s).position_mm - fine.at(s).position_mm).norm();
        // The ends of a sum over four times as many samples differ by half a spacing of weight.
        assert!(gap < 0.02, "{s} {gap}");
    }
}

#[test]
fn smoothing_that_leaves_no_curve_is_refused_by_name() {
    let points = circle(100.0, 0.5, 100.0);
    for smoothing_mm in [201.0, 1e10, 1e60, f64::MAX] {
        let refused = PositionCurve::through(&points, smoothing_mm);
        assert_eq!(refused, Err(PositionCurveError::Smoothing { smoothing_mm }));
    }
    // The longest accepted: nearly the parabola of least squares, and of about its length.
    let curve = PositionCurve::through(&points, 199.0).unwrap();
    assert!(
        (curve.length_mm() - 100.0).abs() < 5.0,
        "{}",
        curve.length_mm()
    );
}

#[test]
fn curves_that_turn_back_are_refused_as_cusps() {
    let line =
        |z: &[f64]| -> Vec<_> { z.iter().map(|&z| Vector3::new(0.0, 0.01 * z, z)).collect() };
    assert_eq!(
        PositionCurve::through(&line(&[0.0, 1.0, 2.0, 1.0, 0.0]), 0.0),
        Err(PositionCurveError::Cusp { index: 2 })
    );
    let mut wedge = line(&[0.0, 1.0, 2.0, 1.0, 0.0]);
    wedge[3].x = 1e-3;
    wedge[4].x = 2e-3;
    assert!(PositionCurve::through(&wedge, 0.0).is_err());
    let corner: Vec<_> = [(0.0, 0.0), (0.0, 1.0), (0.0, 2.0), (1.0, 2.0), (2.0, 2.0)]
        .iter()
        .map(|&(x, z)| Vector3::new(x, 0.0, z))
        .collect();
    // A right angle is a sharp bend, which the excess names, and no cusp.
    let curve = PositionCurve::through(&corner, 0.0).unwrap();
    assert!(
        !curve
            .curvature_excesses(Needle::new(KAPPA_PER_MM).unwrap(), 0.1)
            .is_empty()
    );
}

#[test]
fn a_tilted_straight_line_does_not_exceed_a_straight_needle() {
    let needle = Needle::new(0.0).unwrap();
    for spacing_mm in [0.01, 0.5, 3.0] {
        let direction = Vector3::new(0.3, -0.7, 0.9).normalize() * spacing_mm;
        let line: Vec<_> = (0..200)
            .map(|i| Vector3::new(50.0, -80.0, 7.0) + direction * f64::from(i))
            .collect();
        let curve = PositionCurve::through(&line, 0.0).unwrap();
        assert_eq!(curve.curvature_excesses(needle, 0.0), [], "{spacing_mm}");
    }
    let bent = PositionCurve::through(&circle(1e4, 0.5, 50.0), 0.0).unwrap();
    assert_eq!(bent.curvature_excesses(needle, 0.0).len(), 1);
}
