//! Claims of the predictive controllers: closed loops, stability, survival, memory.

#![allow(
    clippy::unwrap_used,
    reason = "a scene that cannot be set up fails its test"
)]

mod agreement;
mod beginning_and_end;
mod closed_loop;
mod copies;
mod corridor;
mod deadline;
#[path = "../deviates/mod.rs"]
mod deviates;
mod faulty_solver;
mod interruptions;
mod linear;
mod memory;
mod near_full_bend;
mod nonlinear;
mod nonlinear_terminal;
mod reconstruction;
mod recovery;
mod refusals;
mod robot;
mod scene;
mod stability;
mod survival;
mod terminal_rollouts;
