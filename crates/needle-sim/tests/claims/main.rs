//! Claims of `needle-sim`: the replication, scenario files, closed loops.

// What a test's own functions cannot unwrap fails the test.
#![allow(clippy::unwrap_used, clippy::panic)]

mod checks;
mod closed_loops;
mod golden;
mod published_claims;
mod published_runs;
mod reference_files;
mod scenario_files;
mod sensing;
mod stray_scenarios;
