//! Reads a campaign file. Every fault is collected with its line and key.

use super::variation::{Axis, Distribution, Draw};
use crate::scenario::document::{Node, Value};
use crate::scenario::{Document, Fault, Problem};
use std::collections::BTreeMap;

/// The contents of a campaign file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Specification {
    pub(super) scenario: String,
    pub(super) seed: u64,
    pub(super) runs_per_cell: u64,
    pub(super) chunk_runs: Option<u64>,
    pub(super) track_every: Option<u64>,
    pub(super) axes: Vec<Axis>,
    pub(super) draws: Vec<Draw>,
}

const KEYS: [&str; 7] = [
    "scenario",
    "seed",
    "runs_per_cell",
    "chunk_runs",
    "track_every",
    "grid",
    "random",
];

/// Runs of a campaign and values of an axis at most: beyond it, a slip of the pen.
pub(super) const MOST_RUNS: u64 = 1_000_000_000;
/// Cells of a grid at most: the summary holds each of them.
pub(super) const MOST_CELLS: u64 = 100_000;
const MOST_VALUES: i64 = 10_000;
/// Whole numbers up to here are exact as `f64`.
const EXACT: i64 = 1 << 52;

type Table = BTreeMap<String, Node>;

/// Reads what a campaign file says, or says what is wrong with it.
pub(super) fn read(document: &Document) -> Result<Specification, Vec<Fault>> {
    let mut reader = Reader(Vec::new());
    let empty = Table::new();
    let root = table(&document.root).unwrap_or(&empty);
    reader.unknown(root, &KEYS, "");
    let mut axes = Vec::new();
    reader.leaves(root, "grid", &mut |reader, key, node| {
        let values = reader.axis(&key, node)?;
        let line = node.line;
        axes.push(Axis { key, line, values });
        Some(())
    });
    let mut draws = Vec::new();
    let mut factors = Vec::new();
    reader.leaves(root, "random", &mut |reader, key, node| {
        let (distribution, factor) = reader.draw(&key, node)?;
        factors.push(factor);
        draws.push(Draw {
            line: node.line,
            times: None,
            key,
            distribution,
        });
        Some(())
    });
    reader.doubled(&axes, &draws);
    reader.factors(&axes, &mut draws, &factors);
    let specification = Specification {
        scenario: reader.text(root, "scenario").unwrap_or_default(),
        seed: reader.count(root, "seed", (0, i64::MAX)).unwrap_or(0),
        runs_per_cell: reader
            .count(root, "runs_per_cell", (1, MOST_RUNS as i64))
            .unwrap_or(1),
        chunk_runs: reader.count(root, "chunk_runs", (1, 100_000)),
        track_every: reader.count(root, "track_every", (1, 1_000_000)),
        axes,
        draws,
    };
    if reader.0.is_empty() {
        Ok(specification)
    } else {
        Err(reader.0)
    }
}

fn table(node: &Node) -> Option<&Table> {
    match &node.value {
        Value::Table(table) => Some(table),
        _ => None,
    }
}

/// Collects faults.
struct Reader(Vec<Fault>);

impl Reader {
    fn fault(&mut self, line: Option<usize>, key: &str, problem: Problem) {
        self.0.push(Fault {
            line,
            key: key.into(),
            problem,
        });
    }

    fn range(&mut self, node: &Node, key: &str, expected: &str, found: String) {
        let expected = expected.into();
        self.fault(node.line, key, Problem::Range { expected, found });
    }

    fn wrong_type(&mut self, node: &Node, key: &str, expected: &str) {
        let problem = Problem::Type {
            expected: expected.into(),
            found: node.type_name(),
        };
        self.fault(node.line, key, problem);
    }

    fn unknown(&mut self, table: &Table, known: &[&'static str], prefix: &str) {
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

    fn text(&mut self, root: &Table, key: &str) -> Option<String> {
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

    fn count(&mut self, root: &Table, key: &str, (least, most): (i64, i64)) -> Option<u64> {
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

    /// Walks over the varied keys below `section`: `a.b = [..]` and `"a.b" = [..]` are the same key. A list, or a table that has
    /// `from`, `distribution` or `values`, says how a key varies; any other table is a part of a dotted key.
    fn leaves(
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

    /// The values of an axis.
    fn axis(&mut self, key: &str, node: &Node) -> Option<Vec<toml::Value>> {
        match &node.value {
            Value::List(rows) if !rows.is_empty() => self.values(key, rows),
            Value::Table(inner) => self.steps(key, node, inner),
            _ => {
                let expected = "a list of values, or { from = A, to = B, steps = N }";
                self.wrong_type(node, key, expected);
                None
            }
        }
    }

    fn values(&mut self, key: &str, rows: &[Node]) -> Option<Vec<toml::Value>> {
        let values: Vec<_> = rows.iter().map(Node::plain).collect();
        for (row, value) in rows.iter().zip(&values) {
            if value.is_none() {
                self.wrong_type(row, key, "values that a scenario can hold");
            }
        }
        values.into_iter().collect()
    }

    /// `{ from, to, steps, spacing }`: both ends are values.
    fn steps(&mut self, key: &str, node: &Node, inner: &Table) -> Option<Vec<toml::Value>> {
        self.unknown(
            inner,
            &["from", "to", "steps", "spacing"],
            &format!("{key}."),
        );
        let (from, to) = (
            self.number(node, inner, key, "from")?,
            self.number(node, inner, key, "to")?,
        );
        let Some(steps) = inner.get("steps") else {
            let expected = "the number of values".into();
            let at = format!("{key}.steps");
            self.fault(node.line, &at, Problem::Missing { expected });
            return None;
        };
        let Value::Integer(count @ 1..=MOST_VALUES) = steps.value else {
            self.wrong_type(
                steps,
                &format!("{key}.steps"),
                "a whole number from 1 to 10000",
            );
            return None;
        };
        let spacing = match inner.get("spacing").map(|node| (node, &node.value)) {
            None => "linear",
            Some((_, Value::Text(text))) if text == "linear" => "linear",
            Some((_, Value::Text(text))) if text == "log" => "log",
            Some((node, _)) => {
                self.wrong_type(node, &format!("{key}.spacing"), "\"linear\" or \"log\"");
                return None;
            }
        };
        let gaps = (count - 1).max(1);
        if spacing == "log" {
            if !(from > 0.0 && to > 0.0) {
                let found = format!("{from} and {to}");
                self.range(node, key, "`from` and `to` above 0 with log spacing", found);
                return None;
            }
            let step = |i: i64| from * ((to / from).ln() * i as f64 / gaps as f64).exp();
            return Some((0..count).map(|i| toml::Value::Float(step(i))).collect());
        }
        if let (Some(&Value::Integer(first)), Some(&Value::Integer(last))) = (
            inner.get("from").map(|node| &node.value),
            inner.get("to").map(|node| &node.value),
        ) && (last - first) % gaps == 0
        {
            let step = (last - first) / gaps;
            return Some(
                (0..count)
                    .map(|i| toml::Value::Integer(first + i * step))
                    .collect(),
            );
        }
        let step = |i: i64| from + (to - from) * (i as f64 / gaps as f64);
        Some((0..count).map(|i| toml::Value::Float(step(i))).collect())
    }

    /// A finite number of a table; whole ones stay within what is exact as `f64`.
    fn number(&mut self, node: &Node, inner: &Table, key: &str, name: &str) -> Option<f64> {
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

    /// A distribution and the key that it is multiplied with.
    fn draw(&mut self, key: &str, node: &Node) -> Option<(Distribution, Option<String>)> {
        const EXPECTED: &str = "{ distribution = \"uniform\" | \"log_uniform\" | \"uniform_integer\" | \"normal\" | \"choice\", .. }";
        let Some(inner) = table(node) else {
            self.wrong_type(node, key, EXPECTED);
            return None;
        };
        let Some(Value::Text(name)) = inner.get("distribution").map(|node| &node.value) else {
            let expected = EXPECTED.into();
            self.fault(node.line, key, Problem::Missing { expected });
            return None;
        };
        let known: &[&'static str] = match name.as_str() {
            "normal" => &["distribution", "mean", "std", "times"],
            "choice" => &["distribution", "values"],
            "uniform_integer" => &["distribution", "from", "to"],
            _ => &["distribution", "from", "to", "times"],
        };
        self.unknown(inner, known, &format!("{key}."));
        let distribution = match name.as_str() {
            "choice" => match inner.get("values").map(|node| &node.value) {
                Some(Value::List(rows)) if !rows.is_empty() => {
                    Some(Distribution::Choice(self.values(key, rows)?))
                }
                _ => {
                    self.wrong_type(node, &format!("{key}.values"), "a list of values");
                    None
                }
            },
            "normal" => {
                let mean = self.number(node, inner, key, "mean")?;
                let std = self.number(node, inner, key, "std")?;
                let holds = std >= 0.0;
                self.holds(node, key, holds, "`std` from 0 on")?;
                Some(Distribution::Normal { mean, std })
            }
            name => self.interval(key, node, inner, name),
        }?;
        let times = match inner.get("times").map(|node| (node, &node.value)) {
            None => None,
            Some((_, Value::Text(other))) => Some(other.clone()),
            Some((node, _)) => {
                self.wrong_type(
                    node,
                    &format!("{key}.times"),
                    "a key that this campaign varies",
                );
                None
            }
        };
        Some((distribution, times))
    }

    fn interval(
        &mut self,
        key: &str,
        node: &Node,
        inner: &Table,
        name: &str,
    ) -> Option<Distribution> {
        if !["uniform", "log_uniform", "uniform_integer"].contains(&name) {
            let expected = "uniform, log_uniform, uniform_integer, normal or choice";
            self.range(
                node,
                &format!("{key}.distribution"),
                expected,
                format!("\"{name}\""),
            );
            return None;
        }
        let from = self.number(node, inner, key, "from")?;
        let to = self.number(node, inner, key, "to")?;
        match name {
            "uniform" => {
                self.holds(node, key, from <= to, "`from` not above `to`")?;
                Some(Distribution::Uniform { from, to })
            }
            "log_uniform" => {
                let holds = 0.0 < from && from <= to;
                self.holds(node, key, holds, "`from` above 0 and not above `to`")?;
                Some(Distribution::LogUniform { from, to })
            }
            _ => {
                let holds = from <= to && from.fract() == 0.0 && to.fract() == 0.0;
                self.holds(node, key, holds, "whole numbers, `from` not above `to`")?;
                let (from, to) = (from as i64, to as i64);
                Some(Distribution::UniformInteger { from, to })
            }
        }
    }

    fn holds(&mut self, node: &Node, key: &str, holds: bool, expected: &str) -> Option<()> {
        if !holds {
            self.range(node, key, expected, "otherwise".into());
        }
        holds.then_some(())
    }

    /// A key is varied once, and a table not after a key inside it, which it would overwrite.
    fn doubled(&mut self, axes: &[Axis], draws: &[Draw]) {
        let axes = axes.iter().map(|axis| (&axis.key, axis.line));
        let varied: Vec<_> = axes
            .chain(draws.iter().map(|draw| (&draw.key, draw.line)))
            .collect();
        for (i, (key, line)) in varied.iter().enumerate() {
            let overwrites = |(other, _): &(&String, _)| {
                let rest = other.strip_prefix(key.as_str());
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            if varied[..i].iter().any(overwrites) {
                let words = "is varied already, or holds a key that is";
                self.fault(*line, key, Problem::Conflict { words });
            }
        }
    }

    /// Turns the names behind `times` into positions among the parameters.
    fn factors(&mut self, axes: &[Axis], draws: &mut [Draw], factors: &[Option<String>]) {
        for (i, factor) in factors.iter().enumerate() {
            let Some(factor) = factor else { continue };
            let keys = axes.iter().map(|axis| &axis.key);
            let position = keys
                .chain(draws.iter().map(|draw| &draw.key))
                .position(|key| key == factor);
            // A chain of factors would need an order; a number that is itself a product is none to multiply with.
            let product = |at: usize| at >= axes.len() && factors[at - axes.len()].is_some();
            match position {
                Some(at) if !product(at) => draws[i].times = Some(at),
                _ => {
                    let words = "`times` needs a key that this campaign varies and that has no `times` itself";
                    self.fault(draws[i].line, &draws[i].key, Problem::Conflict { words });
                }
            }
        }
    }
}
