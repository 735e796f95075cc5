//! Reports: a run or a campaign as one HTML file that opens from disk, without a network.
//!
//! Pictures are made by plotly, whose script is part of the file. What comes from a scenario or a file is escaped: the templates do it
//! for the page's text and the JSON for the pictures' labels. The page forbids its browser any request.

#[cfg(feature = "campaign")]
mod campaign_figures;
#[cfg(feature = "campaign")]
mod campaign_page;
mod decimation;
mod extent;
mod facts;
mod page;
mod scene;
mod signals;
mod sphere;
mod theme;

#[cfg(feature = "campaign")]
pub use campaign_page::campaign_report;

use crate::record::RunRecord;
use crate::scenario::Scenario;
use askama::Template;
use facts::Fact;
use lqr::{Certificate, Rigour};
use page::Figure;

/// Why a report could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The page's text.
    #[error("the report's template")]
    Template(#[from] askama::Error),
}

#[derive(Template)]
#[template(path = "run.html")]
struct RunPage<'a> {
    plotly_script: &'a str,
    subtitle: String,
    facts: Vec<Fact>,
    scene: Figure,
    signals: Figure,
    certificate: Option<&'a Certificate>,
    scenario_toml: &'a str,
}

/// A run as an HTML page: the 3D scene with a slider of time, errors, inputs with their limits, solve times, certificate.
///
/// The size is bounded, some 5 MB of which plotly's script is most: long runs are shown with fewer points, every peak of a signal
/// kept. Numbers that are not finite are gaps.
///
/// # Errors
/// [`ReportError`] when the page could not be put together.
pub fn run_report(record: &RunRecord) -> Result<String, ReportError> {
    // A record of another version may hold keys that this one does not know: then limits are not shown.
    let scenario = Scenario::parse(&record.scenario_toml).ok();
    let page = RunPage {
        plotly_script: page::plotly_script(),
        subtitle: facts::subtitle(record, scenario.as_ref()),
        facts: facts::of_run(record),
        scene: Figure::new("scene", &scene::plot(record)),
        signals: Figure::new("signals", &signals::plot(record, scenario.as_ref())),
        certificate: record.certificate.as_ref(),
        scenario_toml: &record.scenario_toml,
    };
    Ok(page.render()?)
}

/// Text for a picture's label, where plotly reads a little HTML.
#[cfg(feature = "campaign")]
fn escaped(text: &str) -> String {
    askama::filters::escape(text, askama::filters::Html)
        .map_or(String::new(), |safe| safe.to_string())
}
