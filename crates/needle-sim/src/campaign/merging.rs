//! Merges the chunks of a campaign: `runs.parquet` with a row a run, whose bytes depend on the campaign alone; `times.parquet` with
//! what depends on the machine; `tracks.parquet` where there are tracks; `summary.json`.

use super::campaign_summary::{CampaignSummary, Gatherer};
use super::fault::CampaignError;
use super::rows::TIMES;
use super::store::{Emerging, Store, failed, part_name};
use super::table::{Table, TableWriter};
use crate::output::{OutputError, write_whole};
use parquet::errors::ParquetError;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Rows of a row group: enough to compress well and to read fast, some 6 MB in memory.
const GROUP_ROWS: usize = 1 << 14;

/// A row a run.
pub const RUNS_FILE: &str = "runs.parquet";
/// Wall times, a row a run.
pub const TIMES_FILE: &str = "times.parquet";
/// A row a sample that is kept.
pub const TRACKS_FILE: &str = "tracks.parquet";
/// The [`CampaignSummary`] as JSON.
pub const SUMMARY_FILE: &str = "summary.json";

/// Merges the chunks in `folder` into the files named in this module and sums them up. Chunks are read one after another; they stay
/// where they are.
///
/// # Errors
/// [`CampaignError`]: chunks are missing or damaged, or a file cannot be written. No file is then left half written.
pub fn merge(folder: &Path) -> Result<CampaignSummary, CampaignError> {
    merge_from(folder, &[])
}

/// [`merge`], with chunks of the same campaign that were computed in other folders.
///
/// # Errors
/// As [`merge`]; [`CampaignError::OtherCampaign`] when one of `others` is.
pub fn merge_from(folder: &Path, others: &[PathBuf]) -> Result<CampaignSummary, CampaignError> {
    let store = Store::open(folder)?;
    let mut stores = vec![store.clone()];
    for other in others {
        let other = Store::open(other)?;
        if other.manifest != store.manifest {
            return Err(CampaignError::OtherCampaign {
                folder: other.folder,
                expected: store.manifest.fingerprint,
                found: other.manifest.fingerprint,
            });
        }
        stores.push(other);
    }
    let homes = homes(&stores)?;
    let summary = merge_runs(&store, &homes)?;
    if store.manifest.tracks {
        merge_tracks(&store, &homes)?;
    }
    let path = store.merged(SUMMARY_FILE);
    let text = serde_json::to_vec_pretty(&summary).map_err(|source| CampaignError::Manifest {
        path: path.clone(),
        source,
    })?;
    write_whole(&path, &text)?;
    store.remove_leftovers();
    Ok(summary)
}

/// The folder that holds each chunk.
fn homes(stores: &[Store]) -> Result<Vec<&Store>, CampaignError> {
    let manifest = &stores[0].manifest;
    let mut homes = Vec::new();
    let mut missing = Vec::new();
    for chunk in 0..manifest.chunks() {
        match stores.iter().find(|store| store.has(chunk)) {
            Some(store) => homes.push(store),
            None => missing.push(chunk),
        }
    }
    match missing.first() {
        None => Ok(homes),
        Some(&first) => Err(CampaignError::Incomplete {
            folder: stores[0].folder.clone(),
            missing: missing.len() as u64,
            chunks: manifest.chunks(),
            first: part_name(first),
        }),
    }
}

fn merge_runs(store: &Store, homes: &[&Store]) -> Result<CampaignSummary, CampaignError> {
    let mut gatherer = Gatherer::new(&store.manifest.grid);
    let mut runs = Merged::new(store.merged(RUNS_FILE))?;
    let mut times = Merged::new(store.merged(TIMES_FILE))?;
    for (chunk, home) in homes.iter().enumerate() {
        let chunk = chunk as u64;
        let path = home.part(chunk);
        let mut table = read(&path)?;
        let expected = store.manifest.runs_of(chunk).map(|run| Some(run as i64));
        if !table.whole("run").iter().copied().eq(expected) {
            let range = store.manifest.runs_of(chunk);
            return Err(CampaignError::Foreign {
                expected: format!("runs {} to {}", range.start, range.end.saturating_sub(1)),
                found: format!("{} rows of others", table.len()),
                path,
            });
        }
        gatherer.add(&table);
        let mut apart = table.split_off(&TIMES);
        runs.add(&mut table, &path)?;
        times.add(&mut apart, &path)?;
    }
    // Times first: when the runs are there, so is all else.
    times.finish()?;
    runs.finish()?;
    Ok(gatherer.finish())
}

fn merge_tracks(store: &Store, homes: &[&Store]) -> Result<(), CampaignError> {
    let mut tracks = Merged::new(store.merged(TRACKS_FILE))?;
    for (chunk, home) in homes.iter().enumerate() {
        let path = home.tracks_part(chunk as u64);
        tracks.add(&mut read(&path)?, &path)?;
    }
    tracks.finish()
}

fn read(path: &Path) -> Result<Table, CampaignError> {
    let file = File::open(path).map_err(|source| CampaignError::Unreadable {
        path: path.into(),
        source,
    })?;
    Table::from_parquet(file).map_err(|source| CampaignError::Damaged {
        path: path.into(),
        source,
    })
}

/// A file that grows a row group at a time. Where row groups end depends on the campaign alone.
struct Merged {
    emerging: Emerging,
    writer: Option<TableWriter<File>>,
    waiting: Table,
}

impl Merged {
    fn new(path: PathBuf) -> Result<Self, CampaignError> {
        Ok(Self {
            emerging: Emerging::new(path)?,
            writer: None,
            waiting: Table::default(),
        })
    }

    /// Appends the rows of a part.
    fn add(&mut self, table: &mut Table, part: &Path) -> Result<(), CampaignError> {
        if !self.waiting.append(table) {
            return Err(CampaignError::Foreign {
                path: part.into(),
                expected: "the columns of the chunks before".into(),
                found: "other columns".into(),
            });
        }
        if self.waiting.len() >= GROUP_ROWS {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), CampaignError> {
        let path = self.emerging.path().to_path_buf();
        let failed = |error| unwritten(&path, error);
        let writer = match &mut self.writer {
            Some(writer) => writer,
            none => {
                let file = self.emerging.handle()?;
                none.insert(TableWriter::new(file, &self.waiting).map_err(failed)?)
            }
        };
        writer.write(&self.waiting).map_err(failed)?;
        self.waiting.clear();
        Ok(())
    }

    fn finish(mut self) -> Result<(), CampaignError> {
        if self.writer.is_none() || self.waiting.len() > 0 {
            self.flush()?;
        }
        if let Some(writer) = self.writer.take() {
            let done = writer.finish();
            done.map_err(|error| unwritten(self.emerging.path(), error))?;
        }
        Ok(self.emerging.appear()?)
    }
}

/// What Parquet says of a sink that fails is an input or output error underneath.
fn unwritten(path: &Path, error: ParquetError) -> OutputError {
    let source = match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(source) => *source,
            Err(other) => io::Error::other(other),
        },
        other => io::Error::other(other),
    };
    failed(path, &source)
}
