//! Golden runs of the presets: what a change of any layer would move.

use needle_sim::Scenario;
use needle_sim::run;
use needle_sim::scenario::Preset;

/// (preset, RMS, largest and final distance in mm, revolutions) of run 0.
const GOLDEN: [(&str, [f64; 4]); 3] = [
    ("paper", [0.0, 0.0, 0.0, 0.000_778]),
    ("clinical", [0.0561, 0.0884, 0.0454, 11.74]),
    ("phantom", [0.0359, 0.0604, 0.0298, 10.14]),
];

#[test]
fn each_preset_runs_as_it_did() {
    for (name, golden) in GOLDEN {
        let scenario = Scenario::parse(Preset::named(name).unwrap().toml).unwrap();
        let summary = run(&scenario, 0).unwrap().summary;
        assert!(summary.success, "{name}: {summary:?}");
        let [rms, max, end, revolutions] = golden;
        // A hundredth of a millimetre and a tenth of a turn: rounding that another machine's fused multiplications feed through
        // two hundred samples of feedback stays below, a change of a controller or of a random stream does not.
        for (found, golden) in [
            (summary.rms_mm, rms),
            (summary.max_mm, max),
            (Some(summary.final_mm), end),
        ] {
            assert!(
                (found.unwrap() - golden).abs() < 0.01,
                "{name}: {golden} {summary:?}"
            );
        }
        // The paper's path is the model's own, and nothing disturbs it: what is left is the solver's tolerance.
        if name == "paper" {
            assert!(summary.max_mm.unwrap() < 1e-5, "{summary:?}");
        }
        assert!(
            (summary.rotation_rev - revolutions).abs() < 0.1,
            "{name}: {revolutions} {summary:?}"
        );
    }
}
