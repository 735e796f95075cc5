//! The claims of `lqr`, one binary: linking five of them costs more than running them.

mod certificates;
mod darex;
