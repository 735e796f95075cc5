//! What a scenario file may hold, and what a wrong one is told.

use needle_sim::Scenario;
use needle_sim::scenario::{Document, PRESETS, Preset, ScenarioError};

/// A short scenario that is right.
pub(crate) const SOUND: &str = "\
seed = 3
dt_s = 0.1

[needle]
curvature_per_mm = 0.005

[reference]
kind = \"paper_bevel\"

[controller]
name = \"nmpc\"
horizon = 8

[limits]
v_max_mm_s = 20.0
";

pub(crate) fn preset(name: &str) -> Document {
    Document::parse(Preset::named(name).unwrap().toml).unwrap()
}

#[test]
fn every_preset_reads_back_from_its_own_toml() {
    for preset in PRESETS {
        let scenario = Scenario::parse(preset.toml).unwrap();
        assert_eq!(Scenario::parse(&scenario.to_toml()).unwrap(), scenario);
    }
}

#[test]
fn the_schema_states_the_defaults() {
    let mut schema = Document::parse(&Scenario::schema()).unwrap();
    let path = toml::Table::from_iter([("kind".to_owned(), "paper_bevel".into())]);
    schema.set("reference", path).unwrap();
    schema.set("needle.curvature_per_mm", 0.005).unwrap();
    let bare =
        "needle.curvature_per_mm = 0.005\nreference.kind = 'paper_bevel'\ncontroller.name = 'nmpc'";
    assert_eq!(schema.scenario().unwrap(), Scenario::parse(bare).unwrap());
}

#[test]
fn every_variant_of_the_schema_can_be_chosen_and_read_back() {
    for (key, names) in [
        (
            "controller",
            "name nmpc ltv straight pid lqr sliding_mode duty_cycled feed_forward published",
        ),
        ("reference", "kind paper_bevel paper_euler paper_straight"),
        ("estimator", "kind perfect raw filter"),
        ("plant.torsion", "kind rigid"),
    ] {
        let (tag, names) = names.split_once(' ').unwrap();
        for name in names.split(' ') {
            let mut document = Document::parse(SOUND).unwrap();
            let variant = toml::Table::from_iter([(tag.to_owned(), name.into())]);
            document.set(key, variant).unwrap();
            let scenario = document.scenario().unwrap();
            let text = scenario.to_toml();
            assert!(text.contains(&format!("{tag} = \"{name}\"")), "{text}");
            assert_eq!(Scenario::parse(&text).unwrap(), scenario, "{text}");
        }
    }
}

/// One replacement in the sound scenario, and the words of the fault that it makes.
#[test]
fn a_wrong_key_is_told_with_its_line_and_what_is_allowed() {
    for (from, to, words) in [
        (
            "horizon",
            "horison",
            "scenario:12: controller.horison: unknown key; known here: name, corridor_mm, horizon, ",
        ),
        (
            "seed = 3",
            "seed = -3",
            "scenario:1: seed: expected a whole number from 0 to 9223372036854775807, found -3",
        ),
        (
            "seed = 3",
            "seed = 3.0",
            "scenario:1: seed: expected a whole number from 0 to 9223372036854775807, found a float",
        ),
        (
            "0.005",
            "nan",
            "scenario:5: needle.curvature_per_mm: expected a number from 0 to 1, found NaN",
        ),
        (
            "0.005",
            "\"0.005\"",
            "scenario:5: needle.curvature_per_mm: expected a number from 0 to 1, found a string",
        ),
        (
            "curvature_per_mm = 0.005\n",
            "",
            "scenario:4: needle.curvature_per_mm: missing; expected a number from 0 to 1",
        ),
        (
            "paper_bevel",
            "paper",
            "scenario:8: reference.kind: expected one of inputs, paper_bevel, paper_euler, paper_straight, positions, poses, planner, found \"paper\"",
        ),
        (
            "name = \"nmpc\"\n",
            "",
            "scenario:10: controller.name: missing; expected one of nmpc, ltv, ",
        ),
        (
            "horizon = 8",
            "horizon = 0",
            "scenario:12: controller.horizon: expected a whole number from 1 to 1000, found 0",
        ),
        (
            "v_max_mm_s = 20.0",
            "v_max_mm_s = inf",
            "scenario:15: limits.v_max_mm_s: expected a number above 0, at most 1000000, found inf",
        ),
        (
            "[limits]\nv_max_mm_s = 20.0",
            "[[limits]]\nv_max_mm_s = 20.0",
            "scenario:14: limits: expected a table, found an array",
        ),
        ("[limits]", "[limits", "scenario:14: not TOML: "),
        (
            "v_max_mm_s = 20.0",
            "v_max_mm_s = 1979-05-27",
            "scenario:15: limits.v_max_mm_s: expected a number above 0, at most 1000000, found a date or time",
        ),
        (
            "kind = \"paper_bevel\"",
            "kind = \"inputs\"",
            "scenario: reference.segments: needs at least one segment",
        ),
        (
            "kind = \"paper_bevel\"",
            "kind = \"poses\"",
            "scenario:7: reference.file: missing; expected the name of a file",
        ),
    ] {
        assert!(SOUND.contains(from), "{from}");
        let error = Scenario::parse(&SOUND.replace(from, to)).unwrap_err();
        let told = error.to_string();
        assert!(told.lines().any(|line| line.starts_with(words)), "{told}");
        assert_eq!(error.faults().len(), told.lines().count(), "{told}");
    }
}

#[test]
fn every_fault_of_a_file_is_told_at_once() {
    let text = SOUND
        .replace("horizon = 8", "horizon = 0\nspeed = 1")
        .replace("20.0", "-1");
    let error = Scenario::parse(&text).unwrap_err();
    let keys: Vec<&str> = error
        .faults()
        .iter()
        .map(|fault| fault.key.as_str())
        .collect();
    assert_eq!(
        keys,
        [
            "controller.horizon",
            "controller.speed",
            "limits.v_max_mm_s"
        ]
    );
}

#[test]
fn keys_of_another_variant_are_unknown() {
    let text = SOUND.replace("\"nmpc\"", "\"pid\"");
    let error = Scenario::parse(&text).unwrap_err();
    assert!(
        error.to_string().starts_with(
            "scenario:12: controller.horizon: unknown key; known here: name, patience_s"
        )
    );
}

#[test]
fn raw_readings_without_roll_are_a_conflict() {
    let text = format!("{SOUND}[estimator]\nkind = 'raw'\n[sensors]\nroll_measured = false\n");
    let error = Scenario::parse(&text).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("scenario:17: estimator.kind: `raw` needs sensors"),
        "{error}"
    );
}

#[test]
fn a_path_of_more_than_a_million_samples_is_refused() {
    let segment = "[[reference.segments]]\nduration_s = 1e4\nv_mm_s = 1.0\n";
    let text = SOUND
        .replace("\"paper_bevel\"", "\"inputs\"")
        .replace("dt_s = 0.1", "dt_s = 1e-3");
    let text = format!("{text}\n{}", segment.repeat(101));
    assert!(
        Scenario::parse(&text)
            .unwrap_err()
            .to_string()
            .contains("more than a million samples")
    );
}

#[test]
fn a_segment_that_ends_between_samples_is_refused() {
    let mut clinical = preset("clinical");
    clinical
        .set("reference.segments.0.duration_s", 0.25)
        .unwrap();
    let error = clinical.scenario().unwrap_err().to_string();
    assert!(
        error.contains("reference.segments: each duration_s must be a whole number of samples"),
        "{error}"
    );
    // 0.3 / 0.1 is not 3 in doubles.
    clinical
        .set("reference.segments.0.duration_s", 0.3)
        .unwrap();
    clinical.scenario().unwrap();
}

#[test]
fn a_key_set_from_outside_is_as_if_written() {
    let mut document = Document::parse(SOUND).unwrap();
    document.set("limits.v_max_mm_s", 30).unwrap();
    document.set("plant.torsion.kind", "rigid").unwrap();
    let written = Scenario::parse(&SOUND.replace("20.0", "30")).unwrap();
    assert_eq!(document.scenario().unwrap(), written);
    // Rows of a list by number.
    let mut clinical = preset("clinical");
    clinical
        .set("reference.segments.0.omega_rad_s", 0.25)
        .unwrap();
    assert!(
        clinical
            .scenario()
            .unwrap()
            .to_toml()
            .contains("omega_rad_s = 0.25")
    );
    for wrong in [
        "reference.segments.1.v_mm_s",
        "seed.x",
        "reference.segments.x",
    ] {
        let error = clinical.set(wrong, 1).unwrap_err();
        assert!(
            error.to_string().contains("no table and no row of a list"),
            "{error}"
        );
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let error = Scenario::load("no/such/file.toml".as_ref()).unwrap_err();
    assert!(matches!(error, ScenarioError::Unreadable { .. }));
    assert!(error.to_string().contains("no/such/file.toml"));
}
