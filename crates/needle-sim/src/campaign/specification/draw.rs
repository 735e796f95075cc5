//! How a key is drawn in each trial: a distribution, and the key that it is multiplied with.

use super::reader::{Reader, Table, table};
use crate::campaign::variation::Distribution;
use crate::scenario::Problem;
use crate::scenario::document::{Node, Value};

impl Reader {
    /// A distribution and the key that it is multiplied with.
    pub(super) fn draw(
        &mut self,
        key: &str,
        node: &Node,
    ) -> Option<(Distribution, Option<String>)> {
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
}
