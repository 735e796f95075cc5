//! What a campaign varies: the values of a grid's axes, and the distributions that trials are drawn from.

use crate::random::Stream;
use toml::Value;

/// A key that takes each of some values: one axis of the grid.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    pub(super) key: String,
    pub(super) line: Option<usize>,
    pub(super) values: Vec<Value>,
}

/// A key that is drawn anew in each trial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Draw {
    pub(super) key: String,
    pub(super) line: Option<usize>,
    pub(super) distribution: Distribution,
    /// Position, among the campaign's parameters, of the one that the number drawn is multiplied with.
    pub(super) times: Option<usize>,
}

/// Where values come from.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Distribution {
    /// Every number of [from, to) alike.
    Uniform { from: f64, to: f64 },
    /// Every order of magnitude of [from, to) alike.
    LogUniform { from: f64, to: f64 },
    /// Whole numbers, both ends included.
    UniformInteger { from: i64, to: i64 },
    /// Gauss.
    Normal { mean: f64, std: f64 },
    /// One of a list.
    Choice(Vec<Value>),
}

impl Distribution {
    /// One value. Each distribution takes as many random numbers whatever its parameters.
    pub(super) fn draw(&self, stream: &mut Stream) -> Value {
        match *self {
            Self::Uniform { from, to } => Value::Float(from + (to - from) * stream.uniform()),
            Self::LogUniform { from, to } => {
                Value::Float(from * ((to / from).ln() * stream.uniform()).exp())
            }
            Self::UniformInteger { from, to } => {
                // Exact: the parser keeps the span below 2^53.
                let span = (to - from + 1) as f64;
                Value::Integer(from + (span * stream.uniform()) as i64)
            }
            Self::Normal { mean, std } => Value::Float(mean + std * stream.normal()),
            Self::Choice(ref values) => {
                let row = (values.len() as f64 * stream.uniform()) as usize;
                values[row].clone()
            }
        }
    }

    /// Values that stand for the whole: its ends where it has any. A campaign is refused when the scenario takes none of them.
    pub(super) fn ends(&self) -> Vec<Value> {
        match *self {
            Self::Uniform { from, to } | Self::LogUniform { from, to } => {
                vec![Value::Float(from), Value::Float(to)]
            }
            Self::UniformInteger { from, to } => vec![Value::Integer(from), Value::Integer(to)],
            Self::Normal { mean, .. } => vec![Value::Float(mean)],
            Self::Choice(ref values) => values.clone(),
        }
    }
}

/// `value` times `factor`; what is no number stays as it is.
pub(super) fn multiplied(value: Value, factor: &Value) -> Value {
    match (number(&value), number(factor)) {
        (Some(value), Some(factor)) => Value::Float(value * factor),
        _ => value,
    }
}

/// The number that a value is.
pub(super) fn number(value: &Value) -> Option<f64> {
    match *value {
        Value::Float(value) => Some(value),
        Value::Integer(value) => Some(value as f64),
        _ => None,
    }
}
