//! What a check says before anything moves.

use crate::closed_loops::HELIX;
use crate::scenario_files::preset;
use needle_sim::Scenario;
use needle_sim::check::{CheckReport, check};

fn checked(text: &str) -> CheckReport {
    check(&Scenario::parse(text).unwrap()).unwrap()
}

#[test]
fn nothing_stands_against_the_presets() {
    for name in ["paper", "clinical", "phantom"] {
        let report = check(&preset(name).scenario().unwrap()).unwrap();
        assert_eq!(report.objections, Vec::<String>::new(), "{name}");
    }
}

#[test]
fn the_margin_of_a_path_of_half_the_curvature_is_half() {
    let report = checked(&HELIX.replace(
        "reference.kind = 'inputs'",
        "reference.kind = 'inputs'\nreference.curvature_factor = 0.5",
    ));
    // The bend turns by 0.05 rad within a sample: the angle between its ends falls short by a part in 10^4.
    assert!(
        (report.curvature.margin - 0.5).abs() < 2e-4,
        "{:?}",
        report.curvature
    );
    assert!(!report.executable);
    assert!(
        report.objections[0].contains("does not execute them"),
        "{:?}",
        report.objections
    );
}

#[test]
fn a_path_that_bends_too_much_is_objected_to_with_its_place() {
    let text = HELIX.replace("feed_forward", "nmpc");
    let report = checked(&text.replace(
        "reference.kind = 'inputs'",
        "reference.kind = 'inputs'\nreference.curvature_factor = 1.5",
    ));
    assert!(
        (report.curvature.margin + 0.5).abs() < 2e-4,
        "{:?}",
        report.curvature
    );
    assert!(
        report.objections[0].starts_with("the path bends by 9.999e-3 per mm"),
        "{:?}",
        report.objections
    );
}

#[test]
fn a_helix_is_controllable_and_certified() {
    let report = checked(&HELIX.replace("feed_forward", "ltv"));
    assert_eq!(report.controllability.unwrap().dimension, 6);
    assert!(report.certificate.unwrap().holds());
    assert_eq!(report.terminal.as_deref(), Some("helix_dare"));
    assert_eq!(report.objections, Vec::<String>::new());
}

#[test]
fn inputs_beyond_the_limits_are_named() {
    let report = checked(&HELIX.replace(
        "[limits]",
        "[limits]\nv_max_mm_s = 4.0\nomega_max_rad_s = 0.4",
    ));
    let limits: Vec<_> = report
        .limits
        .iter()
        .map(|l| (l.limit, l.wanted, l.allowed))
        .collect();
    assert_eq!(
        limits,
        [("v_max_mm_s", 5.0, 4.0), ("omega_max_rad_s", 0.5, 0.4)]
    );
    assert_eq!(report.objections.len(), 2);
}

#[test]
fn a_planar_arc_warns() {
    let report = checked(&HELIX.replace("feed_forward", "nmpc").replace("0.5", "0.0"));
    let c = report.controllability.unwrap();
    assert_eq!(c.dimension, 4);
    assert!(
        c.uncontrollable
            .iter()
            .any(|words| words.contains("in-plane")),
        "{c:?}"
    );
}
