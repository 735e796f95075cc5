//! Scenarios that come with the crate.

use std::path::Path;

/// A scenario that comes with the crate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preset {
    /// Its name.
    pub name: &'static str,
    /// What it is for, in a line.
    pub about: &'static str,
    /// Its TOML.
    pub toml: &'static str,
}

/// The presets.
pub const PRESETS: [Preset; 3] = [
    Preset {
        name: "paper",
        about: "the paper's own path, limits and sample time, tracked by the nonlinear controller",
        toml: include_str!("../../presets/paper.toml"),
    },
    Preset {
        name: "clinical",
        about: "5 mm/s, 2 rev/s, 0.2 mm and 1 degree of noise, roll unmeasured, torsional lag",
        toml: include_str!("../../presets/clinical.toml"),
    },
    Preset {
        name: "phantom",
        about: "a bench-top phantom: good tracking of the tip, layers of gelatine, a start that is off",
        toml: include_str!("../../presets/phantom.toml"),
    },
];

impl Preset {
    /// The preset of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        PRESETS.into_iter().find(|preset| preset.name == name)
    }

    /// The preset of a name that stands for a file as well: the file comes first.
    #[must_use]
    pub fn unless_file(name: &str, file: &Path) -> Option<Self> {
        Self::named(name).filter(|_| !file.exists())
    }
}
