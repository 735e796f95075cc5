//! What a command leaves: words on standard error, results on standard output, a verdict or an error with its exit code.

use needle_model::{PositionCurveError, PositionPathError};
use needle_sim::campaign::CampaignError;
use needle_sim::output::OutputError;
use needle_sim::report::ReportError;
use needle_sim::{PathSourceError, RunError, ScenarioError};
use serde::Serialize;
use std::io::{self, Write};
use std::path::PathBuf;

/// The answer of a command that could be carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Yes,
    No,
}

impl From<bool> for Verdict {
    fn from(yes: bool) -> Self {
        if yes { Self::Yes } else { Self::No }
    }
}

/// Why a command could not be carried out.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    #[error("--set {argument}: expected KEY=VALUE, such as limits.v_max_mm_s=8.0")]
    Set { argument: String },
    #[error("no preset is called {name}; there are {known}")]
    Preset { name: String, known: String },
    #[error("the scenario cannot be run: {0}")]
    Run(#[from] RunError),
    #[error(transparent)]
    Path(#[from] PathSourceError),
    #[error("the needle")]
    Needle(#[from] needle_model::InvalidCurvature),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    #[error("cannot read {}", path.display())]
    Unreadable { path: PathBuf, source: io::Error },
    #[error("{} is no recorded run: needle run --record writes one", path.display())]
    NotARecord {
        path: PathBuf,
        source: serde_json::Error,
    },
    #[error("{} holds neither a recorded run nor the summary of a campaign", path.display())]
    NothingToReport { path: PathBuf },
    #[error("{} holds {count} runs: without --out each gets a page beside it", path.display())]
    ManyReports { path: PathBuf, count: usize },
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error("results need a folder of their own: give --out, {} is the campaign file", folder.display())]
    CampaignFolder { folder: PathBuf },
    #[error("the campaign has runs 0 to {}, not {run}", runs.saturating_sub(1))]
    NoSuchRun { run: u64, runs: u64 },
    #[error("interrupted after {done} runs; the same command goes on from there, results are in {}", folder.display())]
    Interrupted { done: u64, folder: PathBuf },
    #[error("the program's own place is unknown")]
    Program(#[source] io::Error),
    #[error("cannot write JSON")]
    Json(#[from] serde_json::Error),
    #[error("cannot write CSV")]
    Csv(#[from] csv::Error),
    #[error("cannot write to standard output")]
    Stdout(#[source] io::Error),
}

impl CliError {
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Scenario(_) | Self::Set { .. } | Self::Preset { .. } | Self::Needle(_) => 2,
            Self::Path(
                PathSourceError::Curve(PositionCurveError::Smoothing { .. })
                | PathSourceError::Positions(PositionPathError::Setting { .. }),
            ) => 2,
            Self::CampaignFolder { .. } | Self::ManyReports { .. } | Self::NoSuchRun { .. } => 2,
            Self::Campaign(CampaignError::Faults { .. } | CampaignError::Scenario(_)) => 2,
            Self::Campaign(CampaignError::OtherCampaign { .. }) => 2,
            Self::Interrupted { .. } => 130,
            _ => 1,
        }
    }
}

/// The error and what caused it.
pub(crate) fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let words = error.to_string();
        // A transparent layer says what its cause says.
        if !text.ends_with(&words) {
            text = format!("{text}: {words}");
        }
        cause = error.source();
    }
    text
}

/// A line on standard error. That nobody reads it is no reason to stop.
pub(crate) fn say(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// A result on standard output.
pub(crate) fn print(text: &str) -> Result<(), CliError> {
    let mut stdout = io::stdout().lock();
    stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush())
        .map_err(CliError::Stdout)
}

/// A result on standard output as JSON.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), CliError> {
    print(&(serde_json::to_string_pretty(value)? + "\n"))
}

/// A number for a table, a dash where there is none.
pub(crate) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}
