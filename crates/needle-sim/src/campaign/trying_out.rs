//! Tries a campaign's scenario before any run: the first cell, every value of every axis, the ends of every distribution.

use super::fault::CampaignError;
use super::plan::Campaign;
use super::specification::{MOST_CELLS, MOST_RUNS};
use crate::scenario::{Fault, Problem, ScenarioError};
use toml::Value;

impl Campaign {
    /// Faults of the campaign's values in the scenario, each with the line of the campaign file.
    pub(super) fn faults(&self) -> Result<Vec<Fault>, CampaignError> {
        let specification = &self.specification;
        if self.cells().saturating_mul(specification.runs_per_cell) > MOST_RUNS {
            return Ok(vec![Fault {
                line: None,
                key: "runs_per_cell".into(),
                problem: Problem::Conflict {
                    words: "the campaign has more than a thousand million runs",
                },
            }]);
        }
        if self.cells() > MOST_CELLS {
            return Ok(vec![Fault {
                line: None,
                key: "grid".into(),
                problem: Problem::Conflict {
                    words: "the grid has more than 100,000 cells",
                },
            }]);
        }
        let axes = specification.axes.iter();
        let axes = axes.map(|axis| axis.values.clone());
        let draws = specification.draws.iter().map(|d| d.distribution.ends());
        let candidates: Vec<_> = axes.chain(draws).collect();
        let first: Vec<_> = candidates.iter().map(|values| values[0].clone()).collect();
        let mut found: Vec<Fault> = Vec::new();
        let mut try_out = |mut values: Vec<Value>| {
            self.multiply(&mut values);
            match self.with(&values) {
                Ok(_) => Ok(()),
                Err(error) => self.attributed(error, &mut found),
            }
        };
        try_out(first.clone())?;
        for (i, values) in candidates.iter().enumerate() {
            for value in values {
                let mut varied = first.clone();
                varied[i] = value.clone();
                try_out(varied)?;
            }
        }
        Ok(found)
    }

    /// Sorts faults of a scenario into `found`, with the campaign's line where the campaign set the key. A fault of the scenario alone
    /// is returned as it is.
    fn attributed(
        &self,
        error: ScenarioError,
        found: &mut Vec<Fault>,
    ) -> Result<(), CampaignError> {
        let related = |key: &str, other: &str| {
            let inside = |a: &str, b: &str| {
                a.strip_prefix(b)
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            inside(key, other) || inside(other, key)
        };
        let line = |key: &str| {
            let axes = self.specification.axes.iter().map(|a| (&a.key, a.line));
            let draws = self.specification.draws.iter().map(|d| (&d.key, d.line));
            axes.chain(draws)
                .find(|(varied, _)| related(key, varied))
                .map(|(_, line)| line)
        };
        let mut ours = Vec::new();
        for fault in error.faults() {
            match line(&fault.key) {
                Some(line) => ours.push(Fault {
                    line,
                    ..fault.clone()
                }),
                None => return Err(error.into()),
            }
        }
        if ours.is_empty() {
            return Err(error.into());
        }
        for fault in ours {
            if !found.contains(&fault) {
                found.push(fault);
            }
        }
        Ok(())
    }
}
