//! Claims of `needle-sim`: the replication, scenario files, closed loops, reports.

// What a test's own functions cannot unwrap fails the test.
#![allow(clippy::unwrap_used, clippy::panic)]

#[cfg(all(feature = "campaign", feature = "report"))]
mod browser;
mod checks;
mod closed_loops;
mod golden;
mod published_claims;
mod published_runs;
mod reference_files;
#[cfg(all(feature = "campaign", feature = "report"))]
mod reports;
mod scenario_files;
mod sensing;
mod stray_scenarios;
