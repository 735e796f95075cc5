//! Campaigns: one scenario, many runs. A TOML file names the scenario, the keys that a grid varies and the keys that are drawn anew
//! in each trial; runs are computed in chunks on all cores, stored as they are finished, and merged into Parquet files.
//!
//! Nothing but chunks is ever held in memory. A chunk's file appears whole or not at all, so a campaign that was killed goes on where
//! it stopped; chunks depend on the campaign and their number alone, so shards computed anywhere merge into the same bytes.

mod campaign_summary;
mod estimate;
mod execution;
mod fault;
mod fingerprint;
mod merging;
mod plan;
mod rows;
mod slurm;
mod specification;
mod store;
mod table;
mod trying_out;
mod variation;

pub use campaign_summary::{CampaignSummary, Cause, CellSummary, Fallbacks, Setting};
pub use estimate::{Estimate, Share, Spread};
pub use execution::{Executed, Execution, Shard, ShardError};
pub use fault::CampaignError;
pub use merging::{RUNS_FILE, SUMMARY_FILE, TIMES_FILE, TRACKS_FILE, merge, merge_from};
pub use plan::Campaign;
pub use slurm::{ARRAY_SCRIPT, MERGE_SCRIPT, SUBMIT_SCRIPT, SlurmArray};

#[cfg(test)]
mod tests;
