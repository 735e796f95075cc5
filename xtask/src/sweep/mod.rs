//! `cargo xtask sweep`: the paper's figures from end to end.

mod compute;
mod dataset;
mod extended;
mod golden;
mod manifest;
mod pictures;
mod summary;
mod tracks;

use crate::say;
use clap::ValueEnum;
use compute::{ComputedFigure, FigureFile};
use needle_sim::output::{self, OutputError};
use needle_sim::published::Figure;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Options of `cargo xtask sweep`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder to write to [default: out/sweep in the repository].
    #[arg(long, value_name = "DIR", conflicts_with = "check")]
    out: Option<PathBuf>,
    /// Only the figures of one experiment; summary, manifest and 3D page then cover those alone.
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
    #[error("run {run} cannot be computed")]
    Extended {
        run: String,
        source: Box<extended::ExtendedError>,
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
    let files: Vec<FigureFile> = Figure::ALL
        .into_iter()
        .map(FigureFile)
        .filter(|file| args.only.is_none_or(|only| file.experiment() == only))
        .collect();
    // The families stand in no figure of the paper alone.
    let extended = match args.only {
        None => extended::compute()?,
        Some(_) => Vec::new(),
    };
    if args.check {
        golden::check(&compute::figures(&files, 1)?)?;
        golden::check_extended(&extended)?;
        say(&format!(
            "{} data files agree with the golden data",
            files.len() + extended.len()
        ));
    } else if args.bless {
        golden::bless(&compute::figures(&files, 1)?)?;
        golden::bless_extended(&extended)?;
    } else {
        let out = args
            .out
            .clone()
            .unwrap_or_else(|| repository().join("out/sweep"));
        output::make_folder(&out)?;
        output::make_folder(&out.join("published"))?;
        if !extended.is_empty() {
            extended::write(&out, &extended)?;
        }
        write(&out, &compute::figures(&files, REPETITIONS)?, start)?;
        say(&format!(
            "wrote {} in {:.1} s",
            out.display(),
            start.elapsed().as_secs_f64()
        ));
    }
    Ok(())
}

/// A run that is written is computed this often, and the least time of each solve is kept: the times are to be compared.
const REPETITIONS: usize = 3;

/// The folder of the workspace that this program was built from.
fn repository() -> &'static Path {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    crate_folder.parent().unwrap_or(crate_folder)
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
    output::write_whole(
        &published.join("summary.csv"),
        &summary::encode(figures, compute::unit_solve_us(figures)?)?,
    )?;
    let manifest = manifest::encode(figures, start.elapsed()).map_err(SweepError::Manifest)?;
    output::write_whole(&out.join("manifest.json"), &manifest)?;
    Ok(())
}
