#![doc = include_str!("../README.md")]

mod blame;
mod certificate;
mod constraints;
mod error;
mod lagrangian;
mod multipliers;
mod problem;
mod residuals;
mod softening;
mod solution;
mod solver;
mod stage;
mod structured;
mod terminal;
mod units;
mod validation;

pub mod conic;
pub mod problems;

pub use blame::{Blame, BlameEntry};
pub use certificate::{InfeasibilityCertificate, cancel_opposite_multipliers, examine_certificate};
pub use conic::ClarabelSolver;
pub use error::{Place, ProblemError, SolveError};
pub use multipliers::{
    Multipliers, Slacks, StageMultipliers, StageSlacks, TerminalMultipliers,
    TerminalSetMultipliers, TerminalSetSlacks, TerminalSlacks,
};
pub use problem::{OcpQp, TerminalCone};
pub use residuals::{Residual, Residuals};
pub use softening::{ConstraintGroup, Penalty, Softening};
pub use solution::{Solution, SolveStatus};
pub use solver::{OcpSolver, SolverSettings, Start};
pub use stage::{Row, Stage};
pub use structured::StructuredSolver;
pub use terminal::{HalfSpace, Terminal, TerminalSet};
