#![doc = include_str!("../README.md")]

mod blame;
mod certificate;
mod constraints;
mod error;
mod infeasibility;
mod lagrangian;
mod multipliers;
mod objective;
mod optimality;
mod problem;
mod residuals;
mod semidefinite;
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

pub use certificate::{cancel_opposite_multipliers, examine_certificate};
pub use conic::ClarabelSolver;
pub use error::{Place, ProblemError, SolveError};
pub use infeasibility::{Blame, BlameEntry, InfeasibilityCertificate};
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
