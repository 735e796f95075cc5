//! What can be wrong with a scenario: each fault with its place, its key and what is allowed there.

use std::io;
use std::path::PathBuf;

/// What is wrong at a key.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The text is not TOML.
    #[error("not TOML: {message}")]
    Syntax {
        /// The parser's words.
        message: String,
    },
    /// No such key.
    #[error("unknown key; known here: {}", known.join(", "))]
    Unknown {
        /// Keys of this table.
        known: Vec<&'static str>,
    },
    /// A key without default is absent.
    #[error("missing; expected {expected}")]
    Missing {
        /// What should be there.
        expected: String,
    },
    /// Another type.
    #[error("expected {expected}, found {found}")]
    Type {
        /// What should be there.
        expected: String,
        /// What is there.
        found: &'static str,
    },
    /// A value out of range.
    #[error("expected {expected}, found {found}")]
    Range {
        /// What is allowed.
        expected: String,
        /// The value.
        found: String,
    },
    /// Values that are allowed each but not together.
    #[error("{words}")]
    Conflict {
        /// What is wrong.
        words: &'static str,
    },
    /// A key that cannot be set because a part of it is no table or no row of a list.
    #[error("cannot be set: `{part}` is no table and no row of a list")]
    NotATable {
        /// The part.
        part: String,
    },
}

/// One fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Line in the file, from 1 on; `None` for a key that is absent or was set from outside the file.
    pub line: Option<usize>,
    /// Dotted key, such as `limits.v_max_mm_s`; empty where the text is not TOML.
    pub key: String,
    /// What is wrong there.
    pub problem: Problem,
}

/// Why there is no scenario.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("cannot read the scenario {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file's contents; every fault is listed.
    #[error("{}", listed(path.as_ref(), faults))]
    Faults {
        /// The file, where there is one.
        path: Option<PathBuf>,
        /// The faults in the order of the keys; at least one.
        faults: Vec<Fault>,
    },
}

impl ScenarioError {
    /// The faults of the contents; empty when the file could not be read.
    #[must_use]
    pub fn faults(&self) -> &[Fault] {
        match self {
            Self::Faults { faults, .. } => faults,
            Self::Unreadable { .. } => &[],
        }
    }
}

/// A line a fault: `file:line: key: problem`.
pub(crate) fn listed(path: Option<&PathBuf>, faults: &[Fault]) -> String {
    let place = path.map_or_else(|| "scenario".into(), |path| path.display().to_string());
    let line = |fault: &Fault| {
        let line = fault
            .line
            .map(|line| format!(":{line}"))
            .unwrap_or_default();
        let key = match fault.key.as_str() {
            "" => String::new(),
            key => format!("{key}: "),
        };
        format!("{place}{line}: {key}{}", fault.problem)
    };
    faults.iter().map(line).collect::<Vec<_>>().join("\n")
}
