//! A campaign: which scenario each run has. Run `i` is trial `i % runs_per_cell` of cell `i / runs_per_cell`; trial `t` draws the
//! same numbers and meets the same noise in every cell, so that cells are compared on equal terms.

use super::fault::CampaignError;
use super::fingerprint::Fingerprint;
use super::specification::{Specification, read};
use super::variation::{multiplied, number};
use crate::random::{Purpose, Stream};
use crate::scenario::{Document, Preset, Scenario, ScenarioError};
use std::fs;
use std::path::{Path, PathBuf};
use toml::Value;

/// A campaign file, understood and checked.
#[derive(Debug, Clone)]
pub struct Campaign {
    pub(super) specification: Specification,
    base: Document,
    /// Folder that a preset's files are relative to; `None` for a scenario file, which has its own.
    folder: Option<PathBuf>,
    fingerprint: Fingerprint,
}

/// What a column of parameters holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ParameterKind {
    Whole,
    Number,
    Flag,
    Text,
}

/// A key that the campaign varies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Parameter {
    pub(super) key: String,
    pub(super) kind: ParameterKind,
    pub(super) on_grid: bool,
}

impl Campaign {
    /// Reads a campaign file and what it refers to. The scenario is tried in the first cell, with every value of every axis and at
    /// the ends of every distribution.
    ///
    /// # Errors
    /// [`CampaignError`] with file, line and key of every fault found.
    pub fn load(path: &Path) -> Result<Self, CampaignError> {
        let text = read_text(path)?;
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        Self::of(&text, &folder, Some(path))
    }

    /// Reads a campaign from text; files that it names are relative to `folder`.
    ///
    /// # Errors
    /// As [`Campaign::load`].
    pub fn parse(text: &str, folder: &Path) -> Result<Self, CampaignError> {
        Self::of(text, folder, None)
    }

    fn of(text: &str, folder: &Path, path: Option<&Path>) -> Result<Self, CampaignError> {
        let faults = |faults| CampaignError::Faults {
            path: path.map(Path::to_path_buf),
            faults,
        };
        let document = Document::parse(text).map_err(|error| faults(error.faults().to_vec()))?;
        let specification = read(&document).map_err(faults)?;
        let base_path = folder.join(&specification.scenario);
        let preset = Preset::unless_file(&specification.scenario, &base_path);
        let (base, base_text) = match preset {
            Some(preset) => (Document::parse(preset.toml)?, preset.toml.to_owned()),
            None => (Document::load(&base_path)?, read_text(&base_path)?),
        };
        let mut fingerprint = Fingerprint::new();
        fingerprint.add(env!("CARGO_PKG_VERSION").as_bytes());
        fingerprint.add(text.as_bytes());
        fingerprint.add(base_text.as_bytes());
        let mut campaign = Self {
            folder: preset.is_some().then(|| folder.to_path_buf()),
            specification,
            base,
            fingerprint,
        };
        let found = campaign.faults()?;
        if !found.is_empty() {
            return Err(faults(found));
        }
        campaign.add_reference_files()?;
        Ok(campaign)
    }

    /// Number of runs.
    #[must_use]
    pub fn runs(&self) -> u64 {
        self.cells() * self.specification.runs_per_cell
    }

    /// Number of cells of the grid; 1 without a grid.
    #[must_use]
    pub fn cells(&self) -> u64 {
        let axes = self.specification.axes.iter();
        axes.map(|axis| axis.values.len() as u64)
            .fold(1, u64::saturating_mul)
    }

    /// Runs that are computed and stored together: what a kill loses a thread at most. Some 2000 chunks a campaign, unless the file
    /// says otherwise.
    #[must_use]
    pub fn chunk_runs(&self) -> u64 {
        let few = (self.runs() / 2000).clamp(25, 1000);
        self.specification.chunk_runs.unwrap_or(few)
    }

    /// The campaign's seed, which is every scenario's.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.specification.seed
    }

    /// Identifies the campaign file, the scenario file, the files of paths and the program's version.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        format!("{:016x}", self.fingerprint.value())
    }

    /// Samples between two rows of a track; `None` without tracks.
    #[must_use]
    pub fn track_every(&self) -> Option<u64> {
        self.specification.track_every
    }

    /// Cell and trial of a run. The trial is the index that the scenario is run with.
    #[must_use]
    pub fn place(&self, run: u64) -> (u64, u64) {
        let trials = self.specification.runs_per_cell;
        (run / trials, run % trials)
    }

    /// The scenario of a run. It is run with the run's trial as its index.
    ///
    /// # Errors
    /// [`ScenarioError`] when the numbers drawn are none that a scenario can hold.
    pub fn scenario(&self, run: u64) -> Result<Scenario, ScenarioError> {
        self.with(&self.parameters(run))
    }

    /// Whether the runs of a cell differ in more than their noise.
    pub(super) fn draws_parameters(&self) -> bool {
        !self.specification.draws.is_empty()
    }

    /// Values of a run's parameters, in the order of [`Campaign::columns`].
    pub(super) fn parameters(&self, run: u64) -> Vec<Value> {
        let (cell, trial) = self.place(run);
        let mut values = self.cell(cell);
        let mut stream = Stream::new(self.specification.seed, trial, Purpose::Parameters);
        let draws = &self.specification.draws;
        values.extend(draws.iter().map(|draw| draw.distribution.draw(&mut stream)));
        self.multiply(&mut values);
        values
    }

    /// Values of the axes in a cell; the last axis varies fastest.
    fn cell(&self, cell: u64) -> Vec<Value> {
        let mut rest = cell;
        let axes = self.specification.axes.iter().rev();
        let mut values: Vec<_> = axes
            .map(|axis| {
                let count = axis.values.len() as u64;
                let value = axis.values[(rest % count) as usize].clone();
                rest /= count;
                value
            })
            .collect();
        values.reverse();
        values
    }

    pub(super) fn multiply(&self, values: &mut [Value]) {
        let axes = self.specification.axes.len();
        for (i, draw) in self.specification.draws.iter().enumerate() {
            if let Some(factor) = draw.times {
                values[axes + i] = multiplied(values[axes + i].clone(), &values[factor]);
            }
        }
    }

    /// The scenario with values for all parameters.
    pub(super) fn with(&self, values: &[Value]) -> Result<Scenario, ScenarioError> {
        let mut document = self.base.clone();
        for (key, value) in self.keys().zip(values) {
            document.set(key, value.clone())?;
        }
        document.set("seed", self.specification.seed as i64)?;
        let mut scenario = document.scenario()?;
        if let Some(folder) = &self.folder {
            scenario.folder.clone_from(folder);
        }
        Ok(scenario)
    }

    fn keys(&self) -> impl Iterator<Item = &String> {
        let axes = self.specification.axes.iter().map(|axis| &axis.key);
        axes.chain(self.specification.draws.iter().map(|draw| &draw.key))
    }

    /// The keys that vary, with what their values are.
    pub(super) fn columns(&self) -> Vec<Parameter> {
        let axes = self.specification.axes.iter();
        let grid = axes.map(|axis| (&axis.key, axis.values.clone(), false, true));
        let draws = self.specification.draws.iter();
        let drawn = draws.map(|draw| {
            let (ends, scaled) = (draw.distribution.ends(), draw.times.is_some());
            (&draw.key, ends, scaled, false)
        });
        let column =
            |(key, values, scaled, on_grid): (&String, Vec<Value>, bool, bool)| Parameter {
                key: key.clone(),
                kind: kind(&values, scaled),
                on_grid,
            };
        grid.chain(drawn).map(column).collect()
    }

    /// Takes the files of paths into the fingerprint.
    fn add_reference_files(&mut self) -> Result<(), CampaignError> {
        let varies = self.keys().any(|key| key.starts_with("reference"));
        let cells = if varies { self.cells().min(1000) } else { 1 };
        for cell in 0..cells {
            let run = cell * self.specification.runs_per_cell;
            // A draw that no scenario holds is a refused row, here as in a run.
            let Ok(scenario) = self.scenario(run) else {
                continue;
            };
            if let Some(file) = scenario.reference_file() {
                let contents = fs::read(&file)
                    .map_err(|source| CampaignError::Unreadable { path: file, source })?;
                self.fingerprint.add(&contents);
            }
        }
        Ok(())
    }
}

fn read_text(path: &Path) -> Result<String, CampaignError> {
    fs::read_to_string(path).map_err(|source| CampaignError::Unreadable {
        path: path.into(),
        source,
    })
}

fn kind(values: &[Value], scaled: bool) -> ParameterKind {
    match values {
        values if values.iter().all(Value::is_integer) && !scaled => ParameterKind::Whole,
        values if values.iter().all(|value| number(value).is_some()) => ParameterKind::Number,
        values if values.iter().all(Value::is_bool) => ParameterKind::Flag,
        _ => ParameterKind::Text,
    }
}
