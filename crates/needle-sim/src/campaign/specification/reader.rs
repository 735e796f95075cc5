//! What every part of a campaign file is read with: a table's values, checked, and the faults found on the way.

use crate::scenario::document::{Node, Value};
use crate::scenario::{Fault, Problem};
use std::collections::BTreeMap;

/// Whole numbers up to here are exact as `f64`.
const EXACT: i64 = 1 << 52;

pub(super) type Table = BTreeMap<String, Node>;

pub(super) fn table(node: &Node) -> Option<&Table> {
    match &node.value {
        Value::Table(table) => Some(table),
        _ => None,
    }
}

/// Collects faults.
#[derive(Default)]
pub(super) struct Reader {
    pub(super) faults: Vec<Fault>,
}

impl Reader {
    pub(super) fn fault(&mut self, line: Option<usize>, key: &str, problem: Problem) {
        self.faults.push(Fault {
            line,
            key: key.into(),
            problem,
        });
    }

    pub(super) fn range(&mut self, node: &Node, key: &str, expected: &str, found: String) {
        let expected = expected.into();
        self.fault(node.line, key, Problem::Range { expected, found });
    }

    pub(super) fn wrong_type(&mut self, node: &Node, key: &str, expected: &str) {
        let problem = Problem::Type {
            expected: expected.into(),
            found: node.type_name(),
        };
        self.fault(node.line, key, problem);
    }

    pub(super) fn holds(
        &mut self,
        node: &Node,
        key: &str,
        holds: bool,
        expected: &str,
    ) -> Option<()> {
        if !holds {
            self.range(node, key, expected, "otherwise".into());
        }
        holds.then_some(())
    }

    pub(super) fn unknown(&mut self, table: &Table, known: &[&'static str], prefix: &str) {
        for (key, node) in table {
            if !known.contains(&key.as_str()) {
                let known = known.to_vec();
                self.fault(
                    node.line,
                    &format!("{prefix}{key}"),
                    Problem::Unknown { known },
                );
            }
        }
    }

    pub(super) fn text(&mut self, root: &Table, key: &str) -> Option<String> {
        const EXPECTED: &str = "a preset's name or a scenario file";
        match root.get(key).map(|node| (node, &node.value)) {
            Some((_, Value::Text(text))) if !text.is_empty() => Some(text.clone()),
            Some((node, _)) => {
                self.wrong_type(node, key, EXPECTED);
                None
            }
            None => {
                let expected = EXPECTED.into();
                self.fault(None, key, Problem::Missing { expected });
                None
            }
        }
    }

    pub(super) fn count(
        &mut self,
        root: &Table,
        key: &str,
        (least, most): (i64, i64),
    ) -> Option<u64> {
        let node = root.get(key)?;
        let expected = format!("a whole number from {least} to {most}");
        match node.value {
            Value::Integer(value) if (least..=most).contains(&value) => u64::try_from(value).ok(),
            Value::Integer(value) => {
                self.range(node, key, &expected, value.to_string());
                None
            }
            _ => {
                self.wrong_type(node, key, &expected);
                None
            }
        }
    }

    /// A finite number of a table; whole ones stay within what is exact as `f64`.
    pub(super) fn number(
        &mut self,
        node: &Node,
        inner: &Table,
        key: &str,
        name: &str,
    ) -> Option<f64> {
        let at = format!("{key}.{name}");
        let Some(found) = inner.get(name) else {
            let expected = "a number".into();
            self.fault(node.line, &at, Problem::Missing { expected });
            return None;
        };
        match found.value {
            Value::Float(value) if value.is_finite() => Some(value),
            Value::Integer(value) if (-EXACT..=EXACT).contains(&value) => Some(value as f64),
            Value::Float(value) => {
                self.range(found, &at, "a finite number", value.to_string());
                None
            }
            _ => {
                self.wrong_type(found, &at, "a number");
                None
            }
        }
    }

    /// Walks over the varied keys below `section`: `a.b = [..]` and `"a.b" = [..]` are the same key. A list, or a table that has
    /// `from`, `distribution` or `values`, says how a key varies; any other table is a part of a dotted key.
    pub(super) fn leaves(
        &mut self,
        root: &Table,
        section: &str,
        leaf: &mut dyn FnMut(&mut Self, String, &Node) -> Option<()>,
    ) {
        let Some(node) = root.get(section) else {
            return;
        };
        match table(node) {
            Some(table) => self.below(table, "", leaf),
            None => self.wrong_type(node, section, "a table of keys of the scenario"),
        }
    }

    fn below(
        &mut self,
        table_above: &Table,
        prefix: &str,
        leaf: &mut dyn FnMut(&mut Self, String, &Node) -> Option<()>,
    ) {
        for (part, node) in table_above {
            let key = format!("{prefix}{part}");
            match table(node) {
                Some(inner)
                    if !["from", "distribution"]
                        .iter()
                        .any(|k| inner.contains_key(*k)) =>
                {
                    self.below(inner, &format!("{key}."), leaf);
                }
                _ if key == "seed" => {
                    let words =
                        "the campaign's own seed rules every run; give it at the top of the file";
                    self.fault(node.line, &key, Problem::Conflict { words });
                }
                _ => {
                    let _ = leaf(self, key, node);
                }
            }
        }
    }
}
