//! What can be wrong with a problem's data or with a call, by stage and field.
//!
//! Numerical outcomes of a solve (infeasible, iteration limit, ...) are not errors: they are
//! [`SolveStatus`](crate::SolveStatus).

use crate::softening::ConstraintGroup;
use std::fmt;

/// Where in the horizon a datum sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Place {
    /// The given `x_0` or the input applied last.
    Initial,
    /// Stage `k`, counted from 0.
    Stage(usize),
    /// The end of the horizon, `x_N`.
    Terminal,
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Initial => formatter.write_str("initial condition"),
            Self::Stage(k) => write!(formatter, "stage {k}"),
            Self::Terminal => formatter.write_str("terminal stage"),
        }
    }
}

/// Data that no solver may see. `field` is the name of the public field or argument.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProblemError {
    /// A horizon of zero stages.
    #[error("the horizon has no stage; expected at least one")]
    EmptyHorizon,
    /// NaN, or an infinity where none has a meaning. Bounds may be infinite on their open side only.
    #[error(
        "{place}, field `{field}`, entry ({row}, {column}): expected {expected}, found {found}"
    )]
    NotFinite {
        /// Where.
        place: Place,
        /// Field name.
        field: &'static str,
        /// Row of the entry; of `rows` and `faces` which one of them.
        row: usize,
        /// Column of the entry (0 in vectors and limits).
        column: usize,
        /// What is accepted there.
        expected: &'static str,
        /// The value refused.
        found: f64,
    },
    /// A cost or shape matrix whose halves differ by more than rounding.
    #[error("{place}, field `{field}`: entry ({row}, {column}) is {found}, its mirror {expected}")]
    NotSymmetric {
        /// Where.
        place: Place,
        /// Field name.
        field: &'static str,
        /// Row of the entry, above the diagonal.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The mirrored entry.
        expected: f64,
        /// The entry.
        found: f64,
    },
    /// A cost or shape matrix with a negative direction: the problem would not be convex.
    #[error(
        "{place}, field `{field}`: expected a positive semidefinite matrix, found pivot {pivot} in row {row}"
    )]
    NotPositiveSemidefinite {
        /// Where.
        place: Place,
        /// Field name; `q, r, s` for the joint matrix `[Q S; S' R]`.
        field: &'static str,
        /// Row at which the factorisation broke down.
        row: usize,
        /// The pivot found there, relative to the diagonal entry.
        pivot: f64,
    },
    /// A lower bound above its upper bound.
    #[error(
        "{place}, bounds `{field}`, component {component}: lower {lower} exceeds upper {upper}"
    )]
    BoundsCrossed {
        /// Where.
        place: Place,
        /// Name of the pair: `u`, `du` or `x`.
        field: &'static str,
        /// Component of the vector.
        component: usize,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// The ellipsoid's level must be positive: at zero it has no interior (use an equality).
    #[error("terminal stage, field `level`: expected a positive finite number, found {found}")]
    EllipsoidLevel {
        /// The level refused.
        found: f64,
    },
    /// A penalty weight that is not positive and finite.
    #[error("penalty weight of {group}: expected a positive finite number, found {found}")]
    PenaltyWeight {
        /// The softened group.
        group: ConstraintGroup,
        /// The weight refused.
        found: f64,
    },
    /// A refill for a stage that the problem does not have.
    #[error("stage index: expected below {expected}, found {found}")]
    StageIndex {
        /// The horizon.
        expected: usize,
        /// The index asked for.
        found: usize,
    },
    /// A refill may change values, not the number of rows.
    #[error("{place}: expected {expected} rows as at construction, found {found}")]
    RowCount {
        /// Where.
        place: Place,
        /// Rows at construction.
        expected: usize,
        /// Rows in the refill.
        found: usize,
    },
    /// A refill may change the terminal set's values, not its kind.
    #[error("terminal set: expected `{expected}` as at construction, found `{found}`")]
    TerminalSetKind {
        /// Kind at construction.
        expected: &'static str,
        /// Kind in the refill.
        found: &'static str,
    },
    /// A refill may change penalty weights, not which groups are soft or how.
    #[error(
        "penalty of {group}: expected the kind `{expected}` as at construction, found `{found}`"
    )]
    PenaltyKind {
        /// The group.
        group: ConstraintGroup,
        /// Kind at construction.
        expected: &'static str,
        /// Kind in the refill.
        found: &'static str,
    },
}

/// A solve that could not start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The solution's memory was laid out for another problem.
    #[error("solution laid out for another problem: {field}, expected {expected}, found {found}")]
    SolutionShape {
        /// What differs.
        field: &'static str,
        /// Length in the problem.
        expected: usize,
        /// Length in the solution.
        found: usize,
    },
    /// A solver was given a problem with another horizon, row count, terminal set or softening
    /// than the one it was made for.
    #[error("solver laid out for another problem: {field}, expected {expected}, found {found}")]
    SolverShape {
        /// What differs.
        field: &'static str,
        /// Length in the solver.
        expected: usize,
        /// Length in the problem.
        found: usize,
    },
    /// A setting outside its range.
    #[error("setting `{field}`: expected {expected}, found {found}")]
    Setting {
        /// Name of the setting.
        field: &'static str,
        /// Its range.
        expected: &'static str,
        /// The value refused.
        found: f64,
    },
    /// The sparse pattern could not be made.
    #[error("sparse pattern of {rows} rows and {columns} columns")]
    SparsePattern {
        /// Rows of the matrix.
        rows: usize,
        /// Columns of the matrix.
        columns: usize,
        /// The sparse library's reason.
        source: faer::sparse::CreationError,
    },
    /// Clarabel refused the assembled problem.
    #[error("Clarabel refused the problem")]
    ClarabelSetup(#[from] clarabel::solver::SolverError),
    /// Clarabel refused new values for the assembled problem.
    #[error("Clarabel refused the update")]
    ClarabelUpdate(#[from] clarabel::solver::DataUpdateError),
}
