//! Claims of the predictive controllers: closed loops, stability, survival, memory.

#![allow(
    clippy::unwrap_used,
    reason = "a scene that cannot be set up fails its test"
)]

mod closed_loop;
mod deadline;
mod interruptions;
mod linear;
mod memory;
mod near_full_bend;
mod nonlinear;
mod nonlinear_terminal;
mod reconstruction;
mod refusals;
mod scene;
mod stability;
mod survival;
