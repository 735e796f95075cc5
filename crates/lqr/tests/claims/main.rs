//! The claims of `lqr`, one binary: linking five of them costs more than running them.

mod certificates;
mod darex;
mod riccati_properties;
mod riccati_refusals;
mod systems;
mod terminal_sets;
