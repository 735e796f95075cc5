//! Claims of plans, draws and rows. Threads, kills and disks are tried on the built program in `needle-cli`.

use super::table::{Cells, Column, Table};
use super::{Campaign, Execution, Shard, merge};
use crate::experiment::run;
use proptest::prelude::*;
use std::io::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use toml::Value;

const SCENARIO: &str = r#"
[needle]
curvature_per_mm = 0.006
[reference]
kind = "inputs"
curvature_factor = 0.5
segments = [{ duration_s = 4.0, v_mm_s = 5.0, omega_rad_s = 0.05 }]
[controller]
name = "sliding_mode"
[plant.disturbances]
heading_std_rad_per_sqrt_mm = 0.001
"#;

const CAMPAIGN: &str = r#"
scenario = "scenario.toml"
seed = 4
runs_per_cell = 500
[grid]
limits.v_max_mm_s = [6, 7.5]
plant.substeps = { from = 4, to = 12, steps = 3 }
[random]
dt_s = { distribution = "choice", values = [0.1, 0.2] }
limits.omega_max_rad_s = { distribution = "uniform", from = 100, to = 900, times = "needle.curvature_per_mm" }
needle.curvature_per_mm = { distribution = "log_uniform", from = 0.001, to = 0.02 }
plant.bevel_offset_mm = { distribution = "normal", mean = 2.0, std = 0.1 }
sensors.period_s = { distribution = "uniform", from = 0.1, to = 0.3 }
controller.patience_s = { distribution = "uniform_integer", from = 2, to = 4 }
"#;

fn folder_with(scenario: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scenario.toml"), scenario).unwrap();
    folder
}

fn execute(campaign: &Campaign, folder: &Path) {
    let executed = campaign.execute(&Execution {
        folder,
        shard: Shard::WHOLE,
        threads: 2,
        stop: &AtomicBool::new(false),
        progress: &|_, _| {},
    });
    assert!(executed.unwrap().complete);
}

#[test]
fn every_cell_meets_the_same_trials() {
    let folder = folder_with(SCENARIO);
    let campaign = Campaign::parse(CAMPAIGN, folder.path()).unwrap();
    assert_eq!((campaign.cells(), campaign.runs()), (6, 3000));
    for trial in [0, 1, 499] {
        let drawn = |cell: u64| campaign.parameters(cell * 500 + trial)[2..].to_vec();
        assert!((1..6).all(|cell| drawn(cell) == drawn(0)));
    }
    assert_ne!(campaign.parameters(0), campaign.parameters(1));
    let other = CAMPAIGN.replace("seed = 4", "seed = 5");
    let other = Campaign::parse(&other, folder.path()).unwrap();
    assert_ne!(other.parameters(0)[2..], campaign.parameters(0)[2..]);
}

#[test]
fn a_grid_has_every_combination_once_the_last_key_fastest() {
    let folder = folder_with(SCENARIO);
    let campaign = Campaign::parse(CAMPAIGN, folder.path()).unwrap();
    let cells: Vec<_> = (0..6)
        .map(|cell| campaign.parameters(500 * cell)[..2].to_vec())
        .collect();
    let speeds = [Value::Integer(6), Value::Float(7.5)];
    let expected: Vec<Vec<Value>> = speeds
        .iter()
        .flat_map(|v| [4, 8, 12].map(|substeps| vec![v.clone(), Value::Integer(substeps)]))
        .collect();
    assert_eq!(cells, expected);
}

#[test]
fn draws_follow_their_distributions() {
    let folder = folder_with(SCENARIO);
    let campaign = Campaign::parse(CAMPAIGN, folder.path()).unwrap();
    let names: Vec<_> = campaign.columns().into_iter().map(|c| c.key).collect();
    let trials: Vec<_> = (0..500).map(|run| campaign.parameters(run)).collect();
    let column = |name: &str| -> Vec<f64> {
        let at = names.iter().position(|n| n == name).unwrap();
        let number = |values: &Vec<Value>| super::variation::number(&values[at]).unwrap();
        trials.iter().map(number).collect()
    };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    // Means of 500 draws within four standard errors of what the distributions have.
    let bevel = column("plant.bevel_offset_mm");
    assert!((mean(&bevel) - 2.0).abs() < 4.0 * 0.1 / 500_f64.sqrt());
    let logs: Vec<_> = column("needle.curvature_per_mm")
        .iter()
        .map(|k| k.ln())
        .collect();
    let (low, high) = (0.001_f64.ln(), 0.02_f64.ln());
    let error = (high - low) / 12_f64.sqrt() / 500_f64.sqrt();
    assert!((mean(&logs) - (low + high) / 2.0).abs() < 4.0 * error);
    assert!(logs.iter().all(|log| (low..=high).contains(log)));
    let period = column("sensors.period_s");
    assert!((mean(&period) - 0.2).abs() < 4.0 * 0.2 / 12_f64.sqrt() / 500_f64.sqrt());
    for whole in [2.0, 3.0, 4.0] {
        let share = column("controller.patience_s")
            .iter()
            .filter(|p| **p == whole)
            .count();
        // A third of 500, give or take four standard deviations of 10.5.
        assert!((125..=209).contains(&share), "{whole}: {share}");
    }
    let short = column("dt_s").iter().filter(|dt| **dt == 0.1).count();
    assert!((205..=295).contains(&short), "{short}");
    // What is multiplied keeps its own share of the factor.
    let ratios = column("limits.omega_max_rad_s")
        .into_iter()
        .zip(column("needle.curvature_per_mm"));
    assert!(
        ratios
            .map(|(omega, kappa)| omega / kappa)
            .all(|r| (100.0 - 1e-9..900.0).contains(&r))
    );
}

#[test]
fn a_row_is_the_run_repeated_alone() {
    let folder = folder_with(SCENARIO);
    let text = CAMPAIGN.replace("runs_per_cell = 500", "runs_per_cell = 8");
    let campaign = Campaign::parse(&text, folder.path()).unwrap();
    let out = folder.path().join("out");
    execute(&campaign, &out);
    merge(&out).unwrap();
    let file = std::fs::File::open(out.join(super::RUNS_FILE)).unwrap();
    let table = Table::from_parquet(file).unwrap();
    assert_eq!(table.len(), 48);
    for index in [47, 0, 19] {
        let (_, trial) = campaign.place(index);
        let alone = run(&campaign.scenario(index).unwrap(), trial)
            .unwrap()
            .summary;
        let row = index as usize;
        assert_eq!(table.numbers("rms_mm")[row], alone.rms_mm);
        assert_eq!(table.numbers("rotation_rev")[row], Some(alone.rotation_rev));
        assert_eq!(table.whole("steps")[row], Some(alone.steps as i64));
    }
}

#[test]
fn a_draw_that_no_scenario_holds_is_a_refused_row_and_no_success() {
    // Some of these refuse their very first draw.
    for seed in 0..8 {
        refused_rows_are_the_draws_below_zero(seed);
    }
}

fn refused_rows_are_the_draws_below_zero(seed: u64) {
    let folder = folder_with(SCENARIO);
    // Half of the draws are below zero, where the scenario's range ends.
    let text = format!(
        "scenario = 'scenario.toml'\nseed = {seed}\nruns_per_cell = 12\n[random]\nplant.bevel_offset_mm = {{ distribution = \
         'normal', mean = 0.0, std = 1.0 }}"
    );
    let campaign = Campaign::parse(&text, folder.path()).unwrap();
    let out = folder.path().join("out");
    execute(&campaign, &out);
    let summary = merge(&out).unwrap();
    let cell = &summary.cells[0];
    let drawn = (0..12).map(|run| super::variation::number(&campaign.parameters(run)[0]).unwrap());
    let negative = drawn.filter(|offset| *offset < 0.0).count() as u64;
    assert_eq!((cell.runs, cell.refused), (12, negative));
    assert!(0 < negative && negative < 12);
    assert!(cell.success.of == 12 && cell.success.count <= 12 - negative);
    let file = std::fs::File::open(out.join(super::RUNS_FILE)).unwrap();
    let Some(Cells::Text(why)) = Table::from_parquet(file)
        .unwrap()
        .column("refusal")
        .cloned()
    else {
        panic!("no column of refusals");
    };
    let told = why
        .iter()
        .flatten()
        .filter(|why| why.starts_with("plant.bevel_offset_mm: "));
    assert_eq!(told.count() as u64, negative);
}

#[test]
fn every_campaign_that_is_shown_loads() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    Campaign::load(&root.join("campaigns/rucker.toml")).unwrap();
    let page = std::fs::read_to_string(root.join("../../docs/campaigns.md")).unwrap();
    let blocks: Vec<_> = page.split("```toml\n").skip(1).collect();
    assert!(!blocks.is_empty());
    for block in blocks {
        let text = block.split("```").next().unwrap();
        Campaign::parse(text, root).unwrap();
    }
}

#[test]
fn every_controller_can_be_named_on_every_preset() {
    for preset in crate::scenario::PRESETS {
        for name in crate::scenario::ControllerChoice::NAMES {
            let mut document = crate::scenario::Document::parse(preset.toml).unwrap();
            document.set("controller.name", *name).unwrap();
            let scenario = document.scenario().unwrap();
            assert_eq!(scenario.controller.name(), *name, "{}", preset.name);
            // A key that was wrong before, or was set from outside, is told as ever.
            document.set("controller.nonsense", 1).unwrap();
            document.set("controller.name", "nmpc").unwrap();
            assert!(document.scenario().is_err());
        }
    }
}

#[test]
fn a_cell_some_of_whose_runs_have_no_figure_is_not_on_the_front() {
    let column = |name: &str, cells| Column {
        name: name.into(),
        cells,
    };
    let table = Table {
        columns: vec![
            column("cell", Cells::Whole([0, 0, 1, 1].map(Some).to_vec())),
            column(
                "rms_mm",
                Cells::Number(vec![Some(0.1), None, Some(1.0), Some(1.0)]),
            ),
            column("rotation_rev", Cells::Number([1.0; 4].map(Some).to_vec())),
        ],
    };
    let mut gatherer = super::campaign_summary::Gatherer::new(&[]);
    gatherer.add(&table);
    let cells = gatherer.finish().cells;
    assert_eq!([cells[0].pareto, cells[1].pareto], [false, true]);
}

#[test]
fn a_cell_is_on_the_front_unless_another_is_better_in_both() {
    let column = |name: &str, cells| Column {
        name: name.into(),
        cells,
    };
    let numbers = |cells: [f64; 5]| Cells::Number(cells.map(Some).to_vec());
    let table = Table {
        columns: vec![
            column("cell", Cells::Whole((0..5).map(Some).collect())),
            column("rms_mm", numbers([1.0, 2.0, 3.0, 2.5, 1.0])),
            column("rotation_rev", numbers([9.0, 5.0, 1.0, 5.5, 9.5])),
        ],
    };
    let mut gatherer = super::campaign_summary::Gatherer::new(&[]);
    gatherer.add(&table);
    let front = gatherer
        .finish()
        .cells
        .iter()
        .map(|cell| cell.pareto)
        .collect::<Vec<_>>();
    assert_eq!(front, [true, true, true, false, false]);
}

#[test]
fn a_shard_is_one_of_its_count() {
    assert!("1/1".parse() == Ok(Shard::WHOLE));
    assert!("7/7".parse::<Shard>().is_ok());
    for wrong in ["0/2", "3/2", "1", "1/0", "-1/2", "a/b", "1/2/3", ""] {
        assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
    }
}

/// Any number, the ones that print as words included.
fn any_number() -> impl Strategy<Value = Option<f64>> {
    let special = [f64::NAN, f64::INFINITY, -0.0, f64::MIN_POSITIVE, f64::MAX];
    prop::option::of(prop_oneof![
        any::<f64>(),
        prop::sample::select(special.to_vec())
    ])
}

proptest! {
    #[test]
    fn tables_come_back_from_parquet_bit_by_bit(
        rows in prop::collection::vec(
            (prop::option::of(any::<i64>()), any_number(), prop::option::of(any::<bool>()), prop::option::of(".{0,12}")),
            0..40,
        )
    ) {
        let column = |name: &str, cells| Column { name: name.into(), cells };
        let table = Table { columns: vec![
            column("run", Cells::Whole(rows.iter().map(|row| row.0).collect())),
            column("a.dotted key", Cells::Number(rows.iter().map(|row| row.1).collect())),
            column("flag", Cells::Flag(rows.iter().map(|row| row.2).collect())),
            column("text", Cells::Text(rows.iter().map(|row| row.3.clone()).collect())),
        ] };
        let bytes = table.to_parquet().unwrap();
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&bytes).unwrap();
        let back = Table::from_parquet(file).unwrap();
        // Bits, for NaN is no number's equal.
        let bits = |table: &Table| table.numbers("a.dotted key").iter().map(|n| n.map(f64::to_bits)).collect::<Vec<_>>();
        prop_assert_eq!(bits(&back), bits(&table));
        for name in ["run", "flag", "text"] {
            prop_assert_eq!(back.column(name), table.column(name));
        }
    }

    #[test]
    fn no_campaign_file_makes_the_reader_panic(
        key in "[a-z_.]{0,20}", value in "[-a-z0-9.{}\\[\\]\"', =_]{0,60}", section in prop::sample::select(vec!["", "[grid]", "[random]"])
    ) {
        let text = format!("scenario = 'paper'\n{section}\n{key} = {value}\n");
        let _ = Campaign::parse(&text, Path::new("."));
    }
}
