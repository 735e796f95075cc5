//! A scenario's text as a tree of values with their lines, in which keys can be set: what a campaign varies.

use super::faults::{Fault, Problem, ScenarioError};
use super::{Scenario, reader};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value with the line that it begins on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Node {
    pub(crate) value: Value,
    pub(crate) line: Option<usize>,
}

/// What TOML can say.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    Text(String),
    Integer(i64),
    Float(f64),
    Flag(bool),
    List(Vec<Node>),
    Table(BTreeMap<String, Node>),
    /// A date, or an integer beyond 64 bits.
    Other(&'static str),
}

/// The text of a scenario before it is understood: keys can be set from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    pub(crate) root: Node,
    path: Option<PathBuf>,
}

/// A key set from outside reaches at most this row of a list: no list of a scenario is longer by far.
const MOST_ROWS: usize = 10_000;

impl Document {
    /// Reads a scenario file.
    ///
    /// # Errors
    /// [`ScenarioError`] when it cannot be read or is not TOML.
    pub fn load(path: &Path) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path).map_err(|source| ScenarioError::Unreadable {
            path: path.into(),
            source,
        })?;
        Self::of(&text, Some(path.into()))
    }

    /// Reads text.
    ///
    /// # Errors
    /// [`ScenarioError`] when it is not TOML.
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        Self::of(text, None)
    }

    fn of(text: &str, path: Option<PathBuf>) -> Result<Self, ScenarioError> {
        let lines = Lines::of(text);
        match DeTable::parse(text) {
            Ok(table) => Ok(Self {
                root: Node {
                    value: lines.table(table.get_ref()),
                    line: None,
                },
                path,
            }),
            Err(error) => {
                let fault = Fault {
                    line: error.span().map(|span| lines.line(&span)),
                    key: String::new(),
                    problem: Problem::Syntax {
                        message: error.message().into(),
                    },
                };
                Err(ScenarioError::Faults {
                    path,
                    faults: vec![fault],
                })
            }
        }
    }

    /// Sets a key such as `limits.v_max_mm_s` or `reference.segments.0.omega_rad_s`, present or not. Whether the scenario has
    /// such a key, and whether the value is allowed there, [`Document::scenario`] says.
    ///
    /// A word that chooses another variant takes the file's keys beside it along that the new variant does not have;
    /// keys that were set here stay, and are then told as unknown.
    ///
    /// # Errors
    /// [`ScenarioError`] when a part of the key is neither a table nor a row of a list.
    pub fn set(&mut self, key: &str, value: impl Into<toml::Value>) -> Result<(), ScenarioError> {
        let value = value.into();
        let parent = key.rsplit_once('.').filter(|_| value.is_str());
        let value = Node::from(value);
        match parent {
            Some((parent, _)) => {
                let before = self.unknown_keys();
                *self.at(key)? = value;
                let mut lost = self.unknown_keys();
                lost.retain(|unknown| !before.contains(unknown));
                if let Value::Table(table) = &mut self.at(parent)?.value {
                    table.retain(|sibling, node| {
                        node.line.is_none() || !lost.contains(&format!("{parent}.{sibling}"))
                    });
                }
            }
            None => *self.at(key)? = value,
        }
        Ok(())
    }

    /// Keys of the document that the scenario does not have.
    fn unknown_keys(&self) -> Vec<String> {
        let faults = reader::read(&mut Scenario::default(), &self.root).into_iter();
        faults
            .filter(|fault| matches!(fault.problem, Problem::Unknown { .. }))
            .map(|fault| fault.key)
            .collect()
    }

    /// The node at a key; tables on the way to it are made where there are none.
    fn at(&mut self, key: &str) -> Result<&mut Node, ScenarioError> {
        let mut node = &mut self.root;
        for part in key.split('.') {
            let found = match &mut node.value {
                Value::Table(table) => Some(table.entry(part.into()).or_insert_with(Node::table)),
                Value::List(rows) => part
                    .parse()
                    .ok()
                    .filter(|row| *row < rows.len().min(MOST_ROWS))
                    .and_then(|row: usize| rows.get_mut(row)),
                _ => None,
            };
            node = found.ok_or_else(|| ScenarioError::Faults {
                path: self.path.clone(),
                faults: vec![Fault {
                    line: None,
                    key: key.into(),
                    problem: Problem::NotATable { part: part.into() },
                }],
            })?;
        }
        Ok(node)
    }

    /// The scenario that the document describes.
    ///
    /// # Errors
    /// [`ScenarioError`] with every fault.
    pub fn scenario(&self) -> Result<Scenario, ScenarioError> {
        let mut scenario = Scenario::default();
        if let Some(folder) = self.path.as_ref().and_then(|path| path.parent()) {
            scenario.folder = folder.into();
        }
        let faults = reader::read(&mut scenario, &self.root);
        match faults.is_empty() {
            true => Ok(scenario),
            false => Err(ScenarioError::Faults {
                path: self.path.clone(),
                faults,
            }),
        }
    }
}

impl Node {
    fn table() -> Self {
        Self {
            value: Value::Table(BTreeMap::new()),
            line: None,
        }
    }

    /// The type in TOML's words.
    pub(crate) fn type_name(&self) -> &'static str {
        match &self.value {
            Value::Text(_) => "a string",
            Value::Integer(_) => "an integer",
            Value::Float(_) => "a float",
            Value::Flag(_) => "a boolean",
            Value::List(_) => "an array",
            Value::Table(_) => "a table",
            Value::Other(name) => name,
        }
    }
}

#[cfg(feature = "campaign")]
impl Node {
    /// The value without lines; `None` where it holds a date or an integer beyond 64 bits.
    pub(crate) fn plain(&self) -> Option<toml::Value> {
        Some(match &self.value {
            Value::Text(text) => toml::Value::String(text.clone()),
            Value::Integer(integer) => toml::Value::Integer(*integer),
            Value::Float(float) => toml::Value::Float(*float),
            Value::Flag(flag) => toml::Value::Boolean(*flag),
            Value::List(rows) => {
                toml::Value::Array(rows.iter().map(Self::plain).collect::<Option<_>>()?)
            }
            Value::Table(table) => {
                let entries = table
                    .iter()
                    .map(|(key, node)| Some((key.clone(), node.plain()?)));
                toml::Value::Table(entries.collect::<Option<_>>()?)
            }
            Value::Other(_) => return None,
        })
    }
}

impl From<toml::Value> for Node {
    fn from(value: toml::Value) -> Self {
        let value = match value {
            toml::Value::String(text) => Value::Text(text),
            toml::Value::Integer(integer) => Value::Integer(integer),
            toml::Value::Float(float) => Value::Float(float),
            toml::Value::Boolean(flag) => Value::Flag(flag),
            toml::Value::Datetime(_) => Value::Other("a date or time"),
            toml::Value::Array(rows) => Value::List(rows.into_iter().map(Self::from).collect()),
            toml::Value::Table(table) => Value::Table(
                table
                    .into_iter()
                    .map(|(key, value)| (key, Self::from(value)))
                    .collect(),
            ),
        };
        Self { value, line: None }
    }
}

/// Offsets at which the lines of a text begin.
struct Lines(Vec<usize>);

impl Lines {
    fn of(text: &str) -> Self {
        let after_breaks = text.match_indices('\n').map(|(at, _)| at + 1);
        Self(std::iter::once(0).chain(after_breaks).collect())
    }

    fn line(&self, span: &Range<usize>) -> usize {
        self.0.partition_point(|begin| *begin <= span.start)
    }

    fn table(&self, table: &DeTable<'_>) -> Value {
        let entry = |(key, value): (&Spanned<_>, &Spanned<_>)| {
            let key: &std::borrow::Cow<'_, str> = key.get_ref();
            (key.to_string(), self.node(value))
        };
        Value::Table(table.iter().map(entry).collect())
    }

    fn node(&self, value: &Spanned<DeValue<'_>>) -> Node {
        let line = Some(self.line(&value.span()));
        let value = match value.get_ref() {
            DeValue::String(text) => Value::Text(text.to_string()),
            DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
                .map_or(Value::Other("an integer beyond 64 bits"), Value::Integer),
            DeValue::Float(float) => float
                .as_str()
                .parse()
                .map_or(Value::Other("a float beyond 64 bits"), Value::Float),
            DeValue::Boolean(flag) => Value::Flag(*flag),
            DeValue::Datetime(_) => Value::Other("a date or time"),
            DeValue::Array(rows) => {
                Value::List(rows.iter().map(|value| self.node(value)).collect())
            }
            DeValue::Table(table) => self.table(table),
        };
        Node { value, line }
    }
}
