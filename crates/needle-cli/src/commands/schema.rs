//! `needle schema`: what a scenario may hold, and the presets.

use crate::answer::{CliError, Verdict, print, print_json};
use crate::scenario_arguments::preset;
use needle_sim::Scenario;
use needle_sim::scenario::PRESETS;
use serde::Serialize;

/// Arguments of `needle schema`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Print this preset, a file to start from.
    #[arg(long, value_name = "NAME", conflicts_with = "presets")]
    preset: Option<String>,
    /// List the presets.
    #[arg(long)]
    presets: bool,
    /// Print as JSON: names with their text.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Named {
    name: &'static str,
    about: &'static str,
    toml: String,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let named = |preset: needle_sim::scenario::Preset| Named {
        name: preset.name,
        about: preset.about,
        toml: preset.toml.into(),
    };
    let chosen: Vec<Named> = match &args.preset {
        Some(name) => vec![named(preset(name)?)],
        None if args.presets => PRESETS.into_iter().map(named).collect(),
        None => vec![Named {
            name: "schema",
            about: "every key with default, range and meaning",
            toml: Scenario::schema(),
        }],
    };
    if args.json {
        print_json(&chosen)?;
    } else if args.presets {
        for Named { name, about, .. } in &chosen {
            print(&format!("{name:10} {about}\n"))?;
        }
    } else {
        for Named { toml, .. } in &chosen {
            print(toml)?;
        }
    }
    Ok(Verdict::Yes)
}
