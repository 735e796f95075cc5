//! Claims of the predictive controllers: closed loops, stability, survival, memory.

mod closed_loop;
mod linear;
mod memory;
mod nonlinear;
mod reconstruction;
mod scene;
mod survival;
