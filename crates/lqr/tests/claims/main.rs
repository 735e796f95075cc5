//! The claims of `lqr`, one binary: linking five of them costs more than running them.

// What a test's own functions cannot unwrap fails the test.
#![allow(clippy::unwrap_used, clippy::panic)]

mod certificates;
mod darex;
mod darex_data;
mod periodic;
mod polytopes;
mod riccati_properties;
mod riccati_refusals;
mod systems;
mod terminal_sets;
mod weights;
