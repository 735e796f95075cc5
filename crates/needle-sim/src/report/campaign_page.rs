//! The page of a campaign: its head and its table in words, around the pictures.

use super::ReportError;
use super::campaign_figures as figures;
use super::facts::Fact;
use super::page::{self, Figure};
use crate::campaign::{CampaignSummary, CellSummary, Estimate, Share, Spread};
use askama::Template;

#[derive(Template)]
#[template(path = "campaign.html")]
struct CampaignPage<'a> {
    plotly_script: &'a str,
    title: &'a str,
    facts: Vec<Fact>,
    pareto: Figure,
    fallbacks: Figure,
    spreads: Figure,
    rows: Vec<Row<'a>>,
}

/// A cell in words.
struct Row<'a> {
    cell: &'a CellSummary,
    success: String,
    rms: String,
    p95: String,
    worst: String,
    rotation: String,
    step: String,
    fallback_samples: u64,
}

/// A campaign as an HTML page: accuracy against rotation, fallbacks by cause, spreads with confidence intervals, a table.
///
/// `title` is what the reader knows the campaign by, a file or folder.
///
/// # Errors
/// [`ReportError`] when the page could not be put together.
pub fn campaign_report(summary: &CampaignSummary, title: &str) -> Result<String, ReportError> {
    let page = CampaignPage {
        plotly_script: page::plotly_script(),
        title,
        facts: facts(summary),
        pareto: Figure::new("pareto", &figures::pareto(summary)),
        fallbacks: Figure::new("fallbacks", &figures::fallbacks(summary)),
        spreads: Figure::new("spreads", &figures::spreads(summary)),
        rows: summary.cells.iter().map(Row::of).collect(),
    };
    Ok(page.render()?)
}

fn facts(summary: &CampaignSummary) -> Vec<Fact> {
    let cells = &summary.cells;
    let sum = |of: fn(&CellSummary) -> u64| cells.iter().map(of).sum::<u64>();
    let refused = sum(|cell| cell.refused);
    let successes = Share::new(sum(|cell| cell.success.count), sum(|cell| cell.success.of));
    let fact = |name, value: String| Fact {
        name,
        value,
        alarming: false,
    };
    vec![
        fact("runs", summary.runs.to_string()),
        fact("cells", cells.len().to_string()),
        fact("samples", sum(|cell| cell.steps).to_string()),
        fact("worst and end below 1 mm", percent(&successes)),
        fact("samples on a fallback", sum(fallback_samples).to_string()),
        Fact {
            name: "runs refused",
            value: refused.to_string(),
            alarming: refused > 0,
        },
    ]
}

fn fallback_samples(cell: &CellSummary) -> u64 {
    let f = &cell.fallbacks;
    f.degraded.steps + f.shifted_plan.steps + f.no_plan.steps + f.no_measurement.steps
}

fn percent(share: &Share) -> String {
    let [value, low, high] = [share.share, share.low, share.high].map(|x| 100.0 * x);
    format!("{value:.1} % [{low:.1}, {high:.1}]")
}

/// The mean with its interval.
fn mean(spread: Option<Spread>, digits: usize) -> String {
    let Some(Estimate { value, low, high }) = spread.map(|spread| spread.mean) else {
        return "–".into();
    };
    match low.zip(high) {
        Some((low, high)) => format!("{value:.digits$} [{low:.digits$}, {high:.digits$}]"),
        None => format!("{value:.digits$}"),
    }
}

impl<'a> Row<'a> {
    fn of(cell: &'a CellSummary) -> Self {
        Self {
            success: percent(&cell.success),
            rms: mean(cell.rms_mm, 3),
            p95: mean(cell.p95_mm, 3),
            worst: mean(cell.max_mm, 3),
            rotation: mean(cell.rotation_rev, 2),
            step: mean(cell.step_median_us, 0),
            fallback_samples: fallback_samples(cell),
            cell,
        }
    }
}
