//! `cargo xtask sweep`: the paper's figures from end to end.

mod compute;
mod dataset;
mod golden;
mod manifest;
mod pictures;
mod summary;
mod tracks;

use crate::output::{self, OutputError};
use crate::say;
use clap::ValueEnum;
use compute::{ComputedFigure, FigureFile};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Options of `cargo xtask sweep`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder to write to.
    #[arg(
        long,
        value_name = "DIR",
        default_value = "out/sweep",
        conflicts_with = "check"
    )]
    out: PathBuf,
    /// Only the figures of one experiment.
    #[arg(long, value_enum)]
    only: Option<Experiment>,
    /// Write nothing: recompute, compare with the golden data in the repository, exit with 1 if they differ.
    #[arg(long)]
    check: bool,
    /// Replace the golden data by what is computed now.
    #[arg(long, conflicts_with_all = ["check", "out", "only"])]
    bless: bool,
}

/// The paper's experiments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Experiment {
    /// Fig. 8, both readings of R.
    Q,
    /// Fig. 9.
    R,
    /// Fig. 10.
    N,
    /// Fig. 4 and 5.
    Straight,
    /// Fig. 6 and 7.
    Bevel,
}

/// Why a sweep ended early.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SweepError {
    #[error("run {run} cannot be computed")]
    Run {
        run: String,
        source: needle_sim::published::PublishedError,
    },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Dataset(#[from] dataset::DatasetError),
    #[error(transparent)]
    Golden(#[from] golden::GoldenError),
    #[error("cannot draw {file}")]
    Picture {
        file: String,
        source: pictures::PictureError,
    },
    #[error("cannot draw the 3D tracks")]
    Tracks(#[source] Box<dyn std::error::Error>),
    #[error("cannot write the manifest as JSON")]
    Manifest(#[source] serde_json::Error),
}

/// Computes, then writes, checks or blesses.
pub(crate) fn run(args: &Args) -> Result<(), SweepError> {
    let start = Instant::now();
    let files: Vec<FigureFile> = FigureFile::ALL
        .into_iter()
        .filter(|file| args.only.is_none_or(|only| file.experiment() == only))
        .collect();
    if !args.check && !args.bless {
        output::make_folder(&args.out.join("published"))?;
    }
    let figures = compute::figures(&files)?;
    if args.check {
        golden::check(&figures)?;
        say(&format!(
            "{} data files agree with the golden data",
            figures.len()
        ));
    } else if args.bless {
        golden::bless(&figures)?;
    } else {
        write(&args.out, &figures, start)?;
        say(&format!(
            "wrote {} in {:.1} s",
            args.out.display(),
            start.elapsed().as_secs_f64()
        ));
    }
    Ok(())
}

fn write(out: &Path, figures: &[ComputedFigure], start: Instant) -> Result<(), SweepError> {
    let published = out.join("published");
    for figure in figures {
        let name = figure.file.stem();
        output::write_whole(
            &published.join(format!("{name}.csv")),
            &dataset::encode(&figure.logs)?,
        )?;
        let picture = pictures::draw(figure).map_err(|source| SweepError::Picture {
            file: format!("{name}.svg"),
            source,
        })?;
        output::write_whole(&published.join(format!("{name}.svg")), picture.as_bytes())?;
    }
    if let Some(page) = tracks::page(figures).map_err(SweepError::Tracks)? {
        output::write_whole(&published.join("fig04_fig06_tracks.html"), page.as_bytes())?;
    }
    output::write_whole(&published.join("summary.csv"), &summary::encode(figures)?)?;
    let manifest = manifest::encode(figures, start.elapsed()).map_err(SweepError::Manifest)?;
    output::write_whole(&out.join("manifest.json"), &manifest)?;
    Ok(())
}
