//! Problems to test and measure solvers with: random ones of every kind, and ones whose answer is known in closed form.
//!
//! Public so that tests, benches and other solvers use the same ones. Everything is a function of a seed: no clock, no
//! global state, the same numbers on every machine with IEEE arithmetic (up to the last bits of `sqrt`, `ln` and `cos`).

mod draw;
pub mod known;
pub mod random;
mod recipe;
pub mod tracking;
