//! Reports: a page opens in a real browser without an error or a request, shows what was run, and stays small and harmless whatever
//! the run.

use crate::browser::{examine, has_none};
use crate::closed_loops::HELIX;
use needle_sim::campaign::{CampaignSummary, CellSummary, Estimate, Setting, Share, Spread};
use needle_sim::record::{OriginRecord, RunRecord};
use needle_sim::report::{campaign_report, run_report};
use needle_sim::run;
use needle_sim::scenario::Document;

const RUN: &str = include_str!("browser/run.js");
const CAMPAIGN: &str = include_str!("browser/campaign.js");

/// What a hostile file might call things.
const HOSTILE: &str = "</pre><script>boom()</script><img src=http://192.0.2.1/x>";

/// A run of a controller with a terminal set.
fn record() -> RunRecord {
    let mut document = Document::parse(HELIX).unwrap();
    for (key, value) in [
        ("controller.name", "ltv"),
        ("controller.terminal", "helix_dare"),
    ] {
        document.set(key, value).unwrap();
    }
    document.set("controller.horizon", 8).unwrap();
    document
        .set("plant.start.offset_mm", vec![0.05, 0.0, 0.0])
        .unwrap();
    run(&document.scenario().unwrap(), 0).unwrap()
}

/// The page without plotly's script.
fn without_library(page: &str) -> &str {
    let end = page.find("</script>").unwrap();
    &page[end..]
}

#[test]
fn a_run_opens_in_a_browser_and_its_slider_moves_shaft_and_cursor() {
    if has_none() {
        return;
    }
    let record = record();
    let found = examine(&run_report(&record).unwrap(), RUN, "1400,900");
    assert_eq!(found["errors"], serde_json::json!([]));
    assert_eq!(found["blocked"], serde_json::json!([]));
    assert_eq!(found["requests"], serde_json::json!([]));
    let traces = [
        "path",
        "track of the tip",
        "measured positions",
        "shaft",
        "bevel",
        "predicted horizon",
        "terminal set",
    ];
    assert_eq!(found["traces"], serde_json::json!(traces));
    assert!(found["drawn"].as_u64() >= Some(1), "no canvas: {found}");
    assert_eq!(found["frames"], record.steps.len().min(101));
    assert_eq!(found["before"]["horizon"], 9);
    assert!(found["before"]["terminal"].as_u64() > Some(50));

    let last = record.steps.last().unwrap();
    assert_eq!(
        found["after"]["active"].as_u64(),
        Some(found["frames"].as_u64().unwrap() - 1)
    );
    // Frames are named by time to the millisecond.
    let cursor_s = found["after"]["cursor_s"].as_f64().unwrap();
    assert!(
        (cursor_s - last.time_s).abs() < 1e-3,
        "{cursor_s} of {}",
        last.time_s
    );
    for (axis, position_mm) in last.tip.position_mm.into_iter().enumerate() {
        let shown_mm = found["after"]["shaft"][axis].as_f64().unwrap();
        // Single precision of some 100 mm.
        assert!((shown_mm - position_mm).abs() < 1e-5);
    }
    assert_ne!(found["before"]["shaft"], found["after"]["shaft"]);

    // Equal scales: drawn length by range, the same on each axis.
    let scales = ["x", "y", "z"].map(|axis| {
        let range = &found["ranges"][["x", "y", "z"].iter().position(|a| *a == axis).unwrap()];
        let span = range[1].as_f64().unwrap() - range[0].as_f64().unwrap();
        found["aspect"][axis].as_f64().unwrap() / span
    });
    assert!(
        scales
            .iter()
            .all(|scale| (scale / scales[0] - 1.0).abs() < 1e-6),
        "{scales:?}"
    );
}

#[test]
fn a_page_fits_a_narrow_window() {
    if has_none() {
        return;
    }
    let found = examine(&run_report(&record()).unwrap(), RUN, "500,900");
    assert_eq!(found["overflow"], false);
}

/// Without this, a browser that reports nothing would pass every test here.
#[test]
fn the_examination_sees_errors_and_requests() {
    if has_none() {
        return;
    }
    let page = "<html><head><meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'\"></head>\
                <body><img src=\"http://192.0.2.1/x.png\"><script>console.error('seen'); undefined_name;</script></body></html>";
    let found = examine(page, "const examine = async () => ({});", "800,600");
    let errors = found["errors"].to_string();
    assert!(
        errors.contains("seen") && errors.contains("undefined_name"),
        "{errors}"
    );
    assert_eq!(found["blocked"].as_array().unwrap().len(), 1);
}

#[test]
fn runs_without_samples_with_one_and_with_numbers_that_are_none_open_as_well() {
    let whole = record();
    let mut one = whole.clone();
    one.steps.truncate(1);
    let mut none = one.clone();
    none.steps.clear();
    let mut broken = whole;
    broken.scenario_toml = "another version wrote this".into();
    broken.summary.rms_mm = Some(f64::NAN);
    for (step, value) in broken.steps.iter_mut().zip(
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY]
            .into_iter()
            .cycle(),
    ) {
        step.tip.position_mm[1] = value;
        step.tip.quaternion_wxyz = [value; 4];
        step.distance_mm = value;
        step.input.v_mm_s = value;
        step.step_us = value;
        step.predicted_mm.push([value; 3]);
        if let Some(terminal) = &mut step.terminal {
            terminal.half_axes_mm[0][0] = value;
        }
    }
    for record in [none, one, broken] {
        let page = run_report(&record).unwrap();
        let own = without_library(&page);
        assert!(!own.contains(":NaN") && !own.contains("Infinity"));
        if has_none() {
            continue;
        }
        let found = examine(&page, RUN, "1400,900");
        assert_eq!(
            found["errors"],
            serde_json::json!([]),
            "{} samples",
            record.steps.len()
        );
    }
}

#[test]
fn names_from_files_stay_text() {
    let mut record = record();
    record.scenario_toml = HOSTILE.into();
    record.certificate.as_mut().unwrap().checks[0].name = HOSTILE.into();
    record.summary.status = HOSTILE.into();
    let page = run_report(&record).unwrap();
    let own = without_library(&page);
    assert!(!own.contains("<script>boom") && !own.contains("<img"));
    assert!(page.matches("script&#62;boom").count() >= 3);
}

#[test]
fn a_hundred_thousand_samples_make_a_bounded_page_with_every_peak() {
    let mut record = record();
    let pattern = record.steps.clone();
    record.steps = pattern.into_iter().cycle().take(100_000).collect();
    for (i, step) in record.steps.iter_mut().enumerate() {
        step.step = i;
        step.time_s = 0.1 * i as f64;
        step.origin = OriginRecord::ShiftedPlan;
    }
    record.steps[54_321].distance_mm = 77.125;
    let page = run_report(&record).unwrap();
    let own = without_library(&page);
    // 11 lines of at most 3200 points, two numbers of some 10 characters each, and 101 frames of some 250 points.
    assert!(own.len() < 1_800_000, "{}", own.len());
    assert!(own.contains(",77.125,"));
}

fn spread(mean: f64) -> Option<Spread> {
    let estimate = |value: f64| Estimate {
        value,
        low: Some(0.9 * value),
        high: Some(1.2 * value),
    };
    Some(Spread {
        count: 50,
        mean: estimate(mean),
        std: 0.1 * mean,
        median: estimate(0.95 * mean),
        p95: Estimate {
            value: 2.0 * mean,
            low: Some(1.8 * mean),
            high: None,
        },
        worst: 3.0 * mean,
    })
}

fn campaign() -> CampaignSummary {
    let cell = |(cell, controller): (usize, &str)| CellSummary {
        cell: cell as u64,
        settings: vec![Setting {
            key: "controller.name".into(),
            value: controller.into(),
        }],
        runs: 50,
        refused: 0,
        success: Share::new(40 + cell as u64, 50),
        rms_mm: spread(0.1 / (1.0 + cell as f64)),
        p95_mm: spread(0.2),
        max_mm: spread(0.5),
        final_mm: spread(0.1),
        rotation_rev: spread(3.0 + cell as f64),
        step_median_us: spread(50.0),
        step_worst_us: None,
        steps: 5000,
        fallbacks: Default::default(),
        pareto: true,
    };
    let mut cells: Vec<_> = ["pid", "ltv", HOSTILE]
        .into_iter()
        .enumerate()
        .map(cell)
        .collect();
    cells[0].rms_mm = None;
    cells[1].fallbacks.no_plan.steps = 7;
    CampaignSummary { runs: 150, cells }
}

#[test]
fn a_campaign_opens_in_a_browser_with_a_colour_a_controller() {
    if has_none() {
        return;
    }
    let page = campaign_report(&campaign(), "sweep").unwrap();
    let found = examine(&page, CAMPAIGN, "1400,900");
    assert_eq!(found["errors"], serde_json::json!([]));
    assert_eq!(found["blocked"], serde_json::json!([]));
    assert_eq!(found["requests"], serde_json::json!([]));
    let pareto = found["pareto"].as_array().unwrap();
    assert_eq!(pareto.len(), 4);
    assert_eq!(pareto[1], "ltv");
    assert_eq!(pareto[3], "Pareto front");
    assert_eq!(found["fallbacks"].as_array().unwrap().len(), 4);
    assert_eq!(found["rows"], 3);
    // The third controller's name is read as text by plotly, too; the examination writes ? for angle brackets.
    let label = found["labels"][2].as_str().unwrap();
    assert!(label.starts_with("?/pre??script?"), "{label}");
}

#[test]
fn campaigns_without_cells_and_of_many_make_pages() {
    let mut campaign = campaign();
    campaign.cells.truncate(1);
    campaign.cells[0].steps = 0;
    for count in [0, 1, 500] {
        campaign.cells = campaign
            .cells
            .iter()
            .cloned()
            .cycle()
            .take(count.max(1))
            .collect();
        let mut shown = campaign.clone();
        shown.cells.truncate(count);
        let page = campaign_report(&shown, HOSTILE).unwrap();
        assert!(!page.contains("<script>boom"));
        assert!(!without_library(&page).contains("NaN"), "{count} cells");
        assert_eq!(page.matches("<td>").count(), 2 * count);
    }
}
