//! The folder of a campaign: a manifest that says whose results these are, a file a chunk, and what was merged.

use super::fault::CampaignError;
use super::plan::Campaign;
use crate::output::{OutputError, make_folder, make_readable, write_whole};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// What a folder of results belongs to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Manifest {
    /// [`Campaign::fingerprint`].
    pub(super) fingerprint: String,
    /// Version of the program.
    pub(super) version: String,
    pub(super) runs: u64,
    pub(super) runs_per_cell: u64,
    pub(super) chunk_runs: u64,
    /// Keys of the grid.
    pub(super) grid: Vec<String>,
    /// Whether there are tracks.
    pub(super) tracks: bool,
}

/// The folder of a campaign.
#[derive(Debug, Clone)]
pub(super) struct Store {
    pub(super) folder: PathBuf,
    pub(super) manifest: Manifest,
}

impl Manifest {
    fn of(campaign: &Campaign) -> Self {
        let columns = campaign.columns().into_iter();
        Self {
            fingerprint: campaign.fingerprint(),
            version: env!("CARGO_PKG_VERSION").into(),
            runs: campaign.runs(),
            runs_per_cell: campaign.runs() / campaign.cells(),
            chunk_runs: campaign.chunk_runs(),
            grid: columns.filter(|c| c.on_grid).map(|c| c.key).collect(),
            tracks: campaign.track_every().is_some(),
        }
    }

    /// Number of chunks.
    pub(super) fn chunks(&self) -> u64 {
        self.runs.div_ceil(self.chunk_runs.max(1))
    }

    /// Runs of a chunk.
    pub(super) fn runs_of(&self, chunk: u64) -> std::ops::Range<u64> {
        let first = chunk * self.chunk_runs;
        first..(first + self.chunk_runs).min(self.runs)
    }
}

impl Store {
    /// The folder for a campaign: made where there is none, taken up where it is this campaign's.
    pub(super) fn of(campaign: &Campaign, folder: &Path) -> Result<Self, CampaignError> {
        let manifest = Manifest::of(campaign);
        let store = Self {
            folder: folder.into(),
            manifest,
        };
        let path = store.folder.join(MANIFEST);
        if path.exists() {
            let found = Self::open(folder)?.manifest;
            if found != store.manifest {
                return Err(CampaignError::OtherCampaign {
                    folder: folder.into(),
                    expected: store.manifest.fingerprint,
                    found: found.fingerprint,
                });
            }
        }
        make_folder(&store.folder.join(PARTS))?;
        let text = serde_json::to_vec_pretty(&store.manifest);
        let text = text.map_err(|source| CampaignError::Manifest {
            path: path.clone(),
            source,
        })?;
        // Shards that start together write the same bytes.
        write_whole(&path, &text)?;
        Ok(store)
    }

    /// A folder that holds a campaign.
    pub(super) fn open(folder: &Path) -> Result<Self, CampaignError> {
        let path = folder.join(MANIFEST);
        let text = fs::read(&path).map_err(|source| CampaignError::Unreadable {
            path: path.clone(),
            source,
        })?;
        let manifest = serde_json::from_slice(&text)
            .map_err(|source| CampaignError::Manifest { path, source })?;
        Ok(Self {
            folder: folder.into(),
            manifest,
        })
    }

    /// Whether a chunk is done: its runs are there, and its tracks where the campaign keeps them.
    pub(super) fn has(&self, chunk: u64) -> bool {
        self.part(chunk).exists() && (!self.manifest.tracks || self.tracks_part(chunk).exists())
    }

    /// File of a chunk's runs, written last.
    pub(super) fn part(&self, chunk: u64) -> PathBuf {
        self.folder.join(PARTS).join(part_name(chunk))
    }

    /// File of a chunk's tracks, written before the chunk's runs.
    pub(super) fn tracks_part(&self, chunk: u64) -> PathBuf {
        let name = format!("tracks-{chunk:06}.parquet");
        self.folder.join(PARTS).join(name)
    }

    /// A merged file.
    pub(super) fn merged(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Removes what killed processes left half written, merges included. Nobody writes any more once all is merged.
    pub(super) fn remove_leftovers(&self) {
        let folders = [self.folder.join(PARTS), self.folder.clone()];
        let entries = folders.iter().flat_map(fs::read_dir).flatten();
        for entry in entries.flatten() {
            if entry.file_name().to_string_lossy().starts_with(".tmp") {
                // Whoever cannot delete a leftover is not harmed by it either.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

const MANIFEST: &str = "manifest.json";
const PARTS: &str = "parts";

/// File name of a chunk.
pub(super) fn part_name(chunk: u64) -> String {
    format!("part-{chunk:06}.parquet")
}

/// A file that is written piece by piece and appears whole or not at all.
#[derive(Debug)]
pub(super) struct Emerging {
    file: NamedTempFile,
    path: PathBuf,
}

impl Emerging {
    pub(super) fn new(path: PathBuf) -> Result<Self, OutputError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        match NamedTempFile::new_in(folder) {
            Ok(file) => Ok(Self { file, path }),
            Err(source) => Err(failed(&path, &source)),
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// A handle to write with.
    pub(super) fn handle(&self) -> Result<File, OutputError> {
        let handle = self.file.as_file().try_clone();
        handle.map_err(|source| failed(&self.path, &source))
    }

    /// Puts the file under its name.
    pub(super) fn appear(self) -> Result<(), OutputError> {
        let Self { file, path } = self;
        let done = file
            .as_file()
            .sync_all()
            .and_then(|()| make_readable(&file))
            .and_then(|()| file.persist(&path).map_err(io::Error::from));
        done.map(drop).map_err(|source| failed(&path, &source))
    }
}

/// The kind alone: the whole error names the temporary file, which means nothing to a reader.
pub(super) fn failed(path: &Path, source: &io::Error) -> OutputError {
    OutputError::File {
        path: path.into(),
        source: source.kind().into(),
    }
}
