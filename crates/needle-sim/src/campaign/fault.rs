//! Why a campaign cannot be read, run or merged.

use crate::output::OutputError;
use crate::scenario::ScenarioError;
use crate::scenario::faults::{Fault, listed};
use parquet::errors::ParquetError;
use std::io;
use std::path::PathBuf;

/// Why a campaign cannot be read, run or merged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CampaignError {
    /// A file of the campaign cannot be read.
    #[error("cannot read {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The campaign file's contents; every fault is listed.
    #[error("{}", listed(path.as_ref(), faults))]
    Faults {
        /// The campaign file, where there is one.
        path: Option<PathBuf>,
        /// The faults; at least one.
        faults: Vec<Fault>,
    },
    /// The scenario that the campaign varies.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A file or folder cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The folder holds another campaign.
    #[error(
        "{} holds results of another campaign (fingerprint {found}, this one has {expected}): the campaign file, its \
         scenario or the program has changed; take another folder",
        folder.display()
    )]
    OtherCampaign {
        /// The folder.
        folder: PathBuf,
        /// Fingerprint of the campaign that was to run.
        expected: String,
        /// Fingerprint in the folder.
        found: String,
    },
    /// The folder holds no campaign, or its manifest is damaged.
    #[error("{} is no manifest of a campaign", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// Chunks are missing.
    #[error(
        "{missing} of {chunks} chunks are missing in {}, the first is {first}: run the campaign again, it goes on where it stopped",
        folder.display()
    )]
    Incomplete {
        /// The folder.
        folder: PathBuf,
        /// Number of missing chunks.
        missing: u64,
        /// Chunks of the campaign.
        chunks: u64,
        /// File name of the first that is missing.
        first: String,
    },
    /// A file of results is not what it should be.
    #[error("{} is damaged: delete it and run the campaign again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ParquetError,
    },
    /// A file of results holds other rows or columns than the campaign says.
    #[error("{} holds {found} where {expected} is expected: delete it and run the campaign again", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The threads cannot be started.
    #[error("cannot start {threads} threads")]
    Threads {
        /// Threads asked for; 0 for one a core.
        threads: usize,
        /// Why.
        source: rayon::ThreadPoolBuildError,
    },
}
