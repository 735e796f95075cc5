//! Reads a scenario off a document: walks over the keys, takes what is there, and collects every fault instead of stopping at the
//! first.

use super::Scenario;
use super::conflicts::conflicts;
use super::document::{Node, Value};
use super::faults::{Fault, Problem};
use super::keys::{Allowed, Choice, Keys};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Fills `scenario` and returns what is wrong, in the order of the keys.
pub(super) fn read(scenario: &mut Scenario, root: &Node) -> Vec<Fault> {
    let mut faults = Vec::new();
    let mut reader = Reader::at(root, String::new(), &mut faults);
    scenario.keys(&mut reader);
    reader.finish();
    if faults.is_empty() {
        faults.extend(conflicts(scenario).map(|(key, words)| Fault {
            line: line_of(root, key),
            key: key.into(),
            problem: Problem::Conflict { words },
        }));
    }
    faults
}

fn line_of(root: &Node, key: &str) -> Option<usize> {
    let mut node = root;
    for part in key.split('.') {
        let Value::Table(table) = &node.value else {
            return None;
        };
        node = table.get(part)?;
    }
    node.line
}

/// Walks over one table.
struct Reader<'a> {
    table: Option<&'a BTreeMap<String, Node>>,
    /// Line of the table itself.
    line: Option<usize>,
    /// Dotted key of the table, with a dot at its end; empty at the root.
    prefix: String,
    known: Vec<&'static str>,
    /// Whether a choice was unreadable: which keys are known is then unknown.
    undecided: bool,
    faults: &'a mut Vec<Fault>,
}

impl<'a> Reader<'a> {
    fn at(node: &'a Node, prefix: String, faults: &'a mut Vec<Fault>) -> Self {
        let table = match &node.value {
            Value::Table(table) => Some(table),
            _ => None,
        };
        if table.is_none() {
            faults.push(Fault {
                line: node.line,
                key: prefix.trim_end_matches('.').into(),
                problem: Problem::Type {
                    expected: "a table".into(),
                    found: node.type_name(),
                },
            });
        }
        Self {
            undecided: table.is_none(),
            table,
            line: node.line,
            prefix,
            known: Vec::new(),
            faults,
        }
    }

    /// The value at a key.
    fn take(&mut self, key: &'static str) -> Option<&'a Node> {
        self.known.push(key);
        self.table?.get(key)
    }

    fn fault(&mut self, line: Option<usize>, key: &str, problem: Problem) {
        let key = format!("{}{key}", self.prefix);
        self.faults.push(Fault { line, key, problem });
    }

    fn missing(&mut self, key: &str, expected: String) {
        if !self.undecided {
            self.fault(self.line, key, Problem::Missing { expected });
        }
    }

    fn wrong_type(&mut self, node: &Node, key: &str, expected: impl Into<String>) {
        let problem = Problem::Type {
            expected: expected.into(),
            found: node.type_name(),
        };
        self.fault(node.line, key, problem);
    }

    /// A number of a node within range, or a fault.
    fn in_range(&mut self, node: &Node, key: &str, allowed: Allowed) -> Option<f64> {
        let value = match node.value {
            Value::Float(value) => value,
            // Integers of a scenario are far below 2^53.
            Value::Integer(value) => value as f64,
            _ => {
                self.wrong_type(node, key, format!("a number {allowed}"));
                return None;
            }
        };
        if allowed.holds(value) {
            return Some(value);
        }
        let problem = Problem::Range {
            expected: format!("a number {allowed}"),
            found: value.to_string(),
        };
        self.fault(node.line, key, problem);
        None
    }

    /// Reports keys that nobody asked for.
    fn finish(self) {
        if self.undecided {
            return;
        }
        for (key, node) in self.table.into_iter().flatten() {
            if !self.known.contains(&key.as_str()) {
                self.faults.push(Fault {
                    line: node.line,
                    key: format!("{}{key}", self.prefix),
                    problem: Problem::Unknown {
                        known: self.known.clone(),
                    },
                });
            }
        }
    }
}

impl Keys for Reader<'_> {
    fn number(&mut self, key: &'static str, value: &mut f64, allowed: Allowed, _: &'static str) {
        match self.take(key) {
            Some(node) => *value = self.in_range(node, key, allowed).unwrap_or(*value),
            None if value.is_nan() => self.missing(key, format!("a number {allowed}")),
            None => {}
        }
    }

    fn optional(
        &mut self,
        key: &'static str,
        value: &mut Option<f64>,
        allowed: Allowed,
        _: &'static str,
    ) {
        if let Some(node) = self.take(key) {
            *value = self.in_range(node, key, allowed);
        }
    }

    fn numbers(
        &mut self,
        key: &'static str,
        values: &mut [f64],
        allowed: Allowed,
        _: &'static str,
    ) {
        let Some(node) = self.take(key) else {
            return;
        };
        match &node.value {
            Value::List(list) if list.len() == values.len() => {
                for (value, node) in values.iter_mut().zip(list) {
                    *value = self.in_range(node, key, allowed).unwrap_or(*value);
                }
            }
            Value::List(list) => {
                let problem = Problem::Range {
                    expected: format!("{} numbers {allowed}", values.len()),
                    found: format!("{} values", list.len()),
                };
                self.fault(node.line, key, problem);
            }
            _ => self.wrong_type(node, key, format!("{} numbers {allowed}", values.len())),
        }
    }

    fn count(
        &mut self,
        key: &'static str,
        value: &mut u64,
        (least, most): (u64, u64),
        _: &'static str,
    ) {
        let Some(node) = self.take(key) else {
            return;
        };
        let expected = format!("a whole number from {least} to {most}");
        let Value::Integer(found) = node.value else {
            return self.wrong_type(node, key, expected);
        };
        match u64::try_from(found) {
            Ok(found) if (least..=most).contains(&found) => *value = found,
            _ => {
                let found = found.to_string();
                self.fault(node.line, key, Problem::Range { expected, found });
            }
        }
    }

    fn flag(&mut self, key: &'static str, value: &mut bool, _: &'static str) {
        if let Some(node) = self.take(key) {
            match node.value {
                Value::Flag(flag) => *value = flag,
                _ => self.wrong_type(node, key, "true or false"),
            }
        }
    }

    fn file(&mut self, key: &'static str, value: &mut PathBuf, _: &'static str) {
        const EXPECTED: &str = "the name of a file, relative to the scenario's";
        match self.take(key) {
            Some(Node {
                value: Value::Text(text),
                ..
            }) if !text.is_empty() => *value = text.into(),
            Some(node) => self.wrong_type(node, key, EXPECTED),
            None if value.as_os_str().is_empty() => self.missing(key, EXPECTED.into()),
            None => {}
        }
    }

    fn table(
        &mut self,
        key: &'static str,
        _: &'static str,
        section: &mut dyn FnMut(&mut dyn Keys),
    ) {
        // An absent table is an empty one: what has no default is then missing by its own name.
        let absent = Node {
            value: Value::Table(BTreeMap::new()),
            line: None,
        };
        let node = self.take(key);
        let prefix = format!("{}{key}.", self.prefix);
        let mut reader = Reader::at(node.unwrap_or(&absent), prefix, self.faults);
        reader.undecided |= self.undecided;
        section(&mut reader);
        reader.finish();
    }

    fn rows(
        &mut self,
        key: &'static str,
        _: &'static str,
        _: usize,
        row: &mut dyn FnMut(usize, &mut dyn Keys),
    ) {
        let Some(node) = self.take(key) else {
            return;
        };
        let Value::List(list) = &node.value else {
            return self.wrong_type(node, key, "an array of tables");
        };
        for (i, node) in list.iter().enumerate() {
            let prefix = format!("{}{key}.{i}.", self.prefix);
            let mut reader = Reader::at(node, prefix, self.faults);
            row(i, &mut reader);
            reader.finish();
        }
    }

    fn choice(&mut self, choice: Choice<'_>) {
        let expected = || format!("one of {}", choice.names.join(", "));
        let index = match self.take(choice.key) {
            None if choice.required => {
                self.missing(choice.key, expected());
                None
            }
            None => Some(choice.chosen),
            Some(node) => match &node.value {
                Value::Text(text) => {
                    let index = choice.names.iter().position(|name| name == text);
                    if index.is_none() {
                        let problem = Problem::Range {
                            expected: expected(),
                            found: format!("\"{text}\""),
                        };
                        self.fault(node.line, choice.key, problem);
                    }
                    index
                }
                _ => {
                    self.wrong_type(node, choice.key, expected());
                    None
                }
            },
        };
        match index {
            Some(index) => (choice.variant)(index, self),
            None => self.undecided = true,
        }
    }
}
