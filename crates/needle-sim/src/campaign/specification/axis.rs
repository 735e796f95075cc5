//! The values of a grid's axis: a list, or equal or logarithmic steps between two ends.

use super::reader::{Reader, Table};
use crate::scenario::Problem;
use crate::scenario::document::{Node, Value};

const MOST_VALUES: i64 = 10_000;

impl Reader {
    /// The values of an axis.
    pub(super) fn axis(&mut self, key: &str, node: &Node) -> Option<Vec<toml::Value>> {
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

    pub(super) fn values(&mut self, key: &str, rows: &[Node]) -> Option<Vec<toml::Value>> {
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
}
