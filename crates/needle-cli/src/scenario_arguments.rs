//! How a scenario is named on the command line: a file or a preset, with keys set from outside.

use crate::answer::CliError;
use needle_sim::Scenario;
use needle_sim::scenario::{Document, PRESETS, Preset};
use std::path::Path;

/// A scenario and the keys to set in it.
#[derive(Debug, clap::Args)]
pub(crate) struct ScenarioArgs {
    /// Scenario file (TOML), or the name of a preset: paper, clinical, phantom.
    #[arg(value_name = "SCENARIO")]
    pub(crate) scenario: String,
    /// Set a key, for example --set controller.horizon=40; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
}

impl ScenarioArgs {
    pub(crate) fn read(&self) -> Result<Scenario, CliError> {
        read(&self.scenario, &self.set)
    }
}

/// The scenario of a file, or of a preset where no such file is.
pub(crate) fn read(name: &str, set: &[String]) -> Result<Scenario, CliError> {
    let path = Path::new(name);
    let mut document = match Preset::unless_file(name, path) {
        Some(preset) => Document::parse(preset.toml)?,
        None => Document::load(path)?,
    };
    for argument in set {
        let (key, value) = argument.split_once('=').ok_or_else(|| CliError::Set {
            argument: argument.clone(),
        })?;
        document.set(key.trim(), value_of(value.trim()))?;
    }
    Ok(document.scenario()?)
}

/// A TOML value; what is none is text, so that names need no quotes.
fn value_of(text: &str) -> toml::Value {
    let parsed = format!("value = {text}").parse::<toml::Table>();
    let value = parsed.ok().and_then(|mut table| table.remove("value"));
    value.unwrap_or_else(|| toml::Value::String(text.into()))
}

/// The preset of a name.
pub(crate) fn preset(name: &str) -> Result<Preset, CliError> {
    Preset::named(name).ok_or_else(|| CliError::Preset {
        name: name.into(),
        known: PRESETS.map(|preset| preset.name).join(", "),
    })
}
