//! What the ranges of single keys cannot say: values that are allowed each but not together.

use super::{EstimatorChoice, InputSegment, MOST_SAMPLES, Reference, Scenario};
use nalgebra::Vector3;

/// Half a turn and a rounding: a longer rotation vector looks like another offset.
const MOST_TURN_RAD: f64 = 3.2;

/// Part of a sample that is rounding of a quotient of decimal numbers.
const SAMPLE_ROUNDING: f64 = 1e-6;

/// The key and what is wrong, for each.
pub(super) fn conflicts(scenario: &Scenario) -> impl Iterator<Item = (&'static str, &'static str)> {
    let sensors = &scenario.sensors;
    let blind = !(sensors.tangent_measured && sensors.roll_measured);
    let knots = &scenario.plant.curvature_profile;
    let segments = match &scenario.reference {
        Reference::Inputs { segments, .. } => Some(segments),
        _ => None,
    };
    let broken = |segment: &InputSegment| {
        let samples = segment.duration_s / scenario.dt_s;
        (samples - samples.round()).abs() > SAMPLE_ROUNDING || samples.round() < 1.0
    };
    let samples: f64 = segments.map_or(1.0, |segments| {
        segments.iter().map(|s| s.duration_s / scenario.dt_s).sum()
    });
    let turn_rad = Vector3::from(scenario.plant.start.rotation_rad).norm();
    [
        (
            turn_rad > MOST_TURN_RAD,
            "plant.start.rotation_rad",
            "turns by more than half a turn, 3.2 rad to leave room for rounding",
        ),
        (
            scenario.estimator == EstimatorChoice::Raw && blind,
            "estimator.kind",
            "`raw` needs sensors that measure tangent and roll; `filter` does not",
        ),
        (
            knots
                .windows(2)
                .any(|pair| pair[1].depth_mm <= pair[0].depth_mm),
            "plant.curvature_profile",
            "depth_mm must increase from knot to knot",
        ),
        (
            segments.is_some_and(Vec::is_empty),
            "reference.segments",
            "needs at least one segment",
        ),
        (
            segments.is_some_and(|segments| segments.iter().any(broken)),
            "reference.segments",
            "each duration_s must be a whole number of samples of dt_s",
        ),
        (
            samples > MOST_SAMPLES,
            "reference.segments",
            "the path has more than a million samples of dt_s",
        ),
        (
            scenario.duration_s.unwrap_or(0.0) / scenario.dt_s > MOST_SAMPLES,
            "duration_s",
            "the run has more than a million samples of dt_s",
        ),
    ]
    .into_iter()
    .filter_map(|(wrong, key, words)| wrong.then_some((key, words)))
}
