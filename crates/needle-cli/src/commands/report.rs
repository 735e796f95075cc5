//! `needle report`: recorded runs and campaigns as HTML pages that open from disk.

use crate::answer::{CliError, Verdict, print};
use needle_sim::RunRecord;
use needle_sim::campaign::{CampaignSummary, SUMMARY_FILE};
use needle_sim::output::write_whole;
use needle_sim::report::{campaign_report, run_report};
use serde::de::DeserializeOwned;
use std::fs;
use std::path::{Path, PathBuf};

/// Arguments of `needle report`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  needle run clinical --record run.json && needle report run.json\n  needle campaign \
                  sweep.toml && needle report sweep\n\nPages need no network: every script is inside."
)]
pub(crate) struct Args {
    /// A run recorded by `needle run --record`, or a folder with such runs or the results of `needle campaign`.
    #[arg(value_name = "PATH")]
    path: PathBuf,
    /// Where the page goes, for a single run or campaign; by default beside its data, ending in .html.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let sources = sources(&args.path)?;
    if let (Some(_), [_, _, ..]) = (&args.out, sources.as_slice()) {
        return Err(CliError::ManyReports {
            path: args.path.clone(),
            count: sources.len(),
        });
    }
    let mut written = String::new();
    for source in &sources {
        let page = match is_summary(source) {
            true => campaign_report(&read::<CampaignSummary>(source)?, &title(source))?,
            false => run_report(&read::<RunRecord>(source)?)?,
        };
        let out = args.out.clone();
        let out = out.unwrap_or_else(|| source.with_extension("html"));
        write_whole(&out, page.as_bytes())?;
        written += &format!("{}\n", out.display());
    }
    print(&written)?;
    Ok(Verdict::Yes)
}

/// The data behind a path: itself, or what a folder holds, in the order of names.
fn sources(path: &Path) -> Result<Vec<PathBuf>, CliError> {
    if !path.is_dir() {
        return Ok(vec![path.into()]);
    }
    let unreadable = |source| CliError::Unreadable {
        path: path.into(),
        source,
    };
    let mut sources = Vec::new();
    for entry in fs::read_dir(path).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.path();
        let json = file.extension().is_some_and(|ending| ending == "json");
        // A campaign keeps other JSON beside its summary, such as its manifest.
        if json && (is_summary(&file) || read::<RunRecord>(&file).is_ok()) {
            sources.push(file);
        }
    }
    sources.sort();
    match sources.is_empty() {
        true => Err(CliError::NothingToReport { path: path.into() }),
        false => Ok(sources),
    }
}

fn is_summary(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == SUMMARY_FILE)
}

/// A campaign is known by its folder.
fn title(summary: &Path) -> String {
    let folder = summary.canonicalize().ok();
    let folder = folder
        .as_deref()
        .and_then(Path::parent)
        .and_then(Path::file_name);
    folder.map_or(String::new(), |name| name.to_string_lossy().into_owned())
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, CliError> {
    let text = fs::read(path).map_err(|source| CliError::Unreadable {
        path: path.into(),
        source,
    })?;
    serde_json::from_slice(&text).map_err(|source| CliError::NotARecord {
        path: path.into(),
        source,
    })
}
