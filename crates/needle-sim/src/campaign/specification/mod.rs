//! Reads a campaign file. Every fault is collected with its line and key.

mod axis;
mod draw;
mod reader;

use super::variation::{Axis, Draw};
use crate::scenario::{Document, Fault, Problem};
use reader::{Reader, Table, table};

/// The contents of a campaign file.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::campaign) struct Specification {
    pub(in crate::campaign) scenario: String,
    pub(in crate::campaign) seed: u64,
    pub(in crate::campaign) runs_per_cell: u64,
    pub(in crate::campaign) chunk_runs: Option<u64>,
    pub(in crate::campaign) track_every: Option<u64>,
    pub(in crate::campaign) axes: Vec<Axis>,
    pub(in crate::campaign) draws: Vec<Draw>,
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
pub(in crate::campaign) const MOST_RUNS: u64 = 1_000_000_000;
/// Cells of a grid at most: the summary holds each of them.
pub(in crate::campaign) const MOST_CELLS: u64 = 100_000;

/// Reads what a campaign file says, or says what is wrong with it.
pub(in crate::campaign) fn read(document: &Document) -> Result<Specification, Vec<Fault>> {
    let mut reader = Reader::default();
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
    if reader.faults.is_empty() {
        Ok(specification)
    } else {
        Err(reader.faults)
    }
}

impl Reader {
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
