//! A scenario: everything that a run depends on but its index, in one TOML file.
//!
//! Keys carry units. Each section lists its keys once, with range and meaning (`keys`); reading, printing and the description
//! of what may be written all walk over the same list.

mod conflicts;
mod controller;
pub(crate) mod document;
mod estimator;
pub(crate) mod faults;
mod keys;
mod plant;
mod presets;
mod printer;
mod reader;
mod reference;
mod sensors;

pub use controller::{ControllerChoice, Patience};
pub use document::Document;
pub use estimator::{EntryKnowledge, EstimatorChoice, FilterChoice};
pub use faults::{Fault, Problem, ScenarioError};
pub use plant::{CurvatureKnot, Disturbances, Plant, PlantTorsion, StartOffset};
pub use presets::{PRESETS, Preset};
pub use reference::{InputSegment, Reference};
pub use sensors::Sensors;

use keys::{Allowed, Keys};
use needle_control::InputLimits;
use std::path::{Path, PathBuf};

/// Samples that a path or a run may have: more is a slip of the pen, and memory.
const MOST_SAMPLES: f64 = 1e6;

/// Everything that a run depends on but its index.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Seed of every random number; a run's numbers follow from it and the run's index alone.
    pub seed: u64,
    /// Sample time of the loop, s.
    pub dt_s: f64,
    /// Longest duration, s; `None` for 1.3 times the path's. A run ends earlier when the controller has come to rest at the end.
    pub duration_s: Option<f64>,
    /// Curvature that the controller believes in, 1/mm.
    pub curvature_per_mm: f64,
    /// The path.
    pub reference: Reference,
    /// The controller.
    pub controller: ControllerChoice,
    /// What stands between sensors and controller.
    pub estimator: EstimatorChoice,
    /// Limits of the actuators.
    pub limits: InputLimits,
    /// The simulated needle.
    pub plant: Plant,
    /// What is seen of the tip.
    pub sensors: Sensors,
    /// Folder that the reference's file is relative to.
    pub folder: PathBuf,
}

impl Default for Scenario {
    /// What holds for keys that a file leaves out; the curvature is NaN, for it must be there.
    fn default() -> Self {
        Self {
            seed: 0,
            dt_s: 0.1,
            duration_s: None,
            curvature_per_mm: f64::NAN,
            reference: Reference::default(),
            controller: ControllerChoice::default(),
            estimator: EstimatorChoice::default(),
            limits: InputLimits::default(),
            plant: Plant::default(),
            sensors: Sensors::default(),
            folder: PathBuf::new(),
        }
    }
}

impl Scenario {
    /// Reads a scenario file; its reference's file is relative to it.
    ///
    /// # Errors
    /// [`ScenarioError`] with every fault: file, line, key, what is allowed.
    pub fn load(path: &Path) -> Result<Self, ScenarioError> {
        Document::load(path)?.scenario()
    }

    /// Reads a scenario from text.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        Document::parse(text)?.scenario()
    }

    /// The scenario as TOML, every key written out; reading it back gives the same scenario.
    #[must_use]
    pub fn to_toml(&self) -> String {
        printer::scenario(self)
    }

    /// A documented TOML file with every key, its default, range and meaning.
    #[must_use]
    pub fn schema() -> String {
        printer::schema()
    }

    /// Path of the reference's file.
    #[must_use]
    pub fn reference_file(&self) -> Option<PathBuf> {
        self.reference.file().map(|file| self.folder.join(file))
    }

    fn keys(&mut self, keys: &mut dyn Keys) {
        let about = "seed of every random number";
        keys.count("seed", &mut self.seed, (0, i64::MAX as u64), about);
        let about = "sample time of the loop";
        keys.number("dt_s", &mut self.dt_s, Allowed::From(1e-3, 10.0), about);
        let about = "longest duration of a run; absent for 1.3 times the path's";
        let time = Allowed::Above(0.0, 1e4);
        keys.optional("duration_s", &mut self.duration_s, time, about);
        keys.table("needle", "what the controller believes", &mut |keys| {
            let about =
                "curvature of the path of a needle that is not turned; 0 for a straight one";
            let curvature = Allowed::From(0.0, 1.0);
            keys.number(
                "curvature_per_mm",
                &mut self.curvature_per_mm,
                curvature,
                about,
            );
        });
        keys.table("reference", "the path to follow", &mut |keys| {
            self.reference.keys(keys);
        });
        keys.table("controller", "the controller", &mut |keys| {
            self.controller.keys(keys);
        });
        keys.table(
            "estimator",
            "what stands between sensors and controller",
            &mut |keys| self.estimator.keys(keys),
        );
        keys.table("limits", "limits of the actuators", &mut |keys| {
            limits(&mut self.limits, keys);
        });
        keys.table("plant", "the simulated needle", &mut |keys| {
            self.plant.keys(keys);
        });
        keys.table("sensors", "what is seen of the tip", &mut |keys| {
            self.sensors.keys(keys);
        });
    }
}

fn limits(limits: &mut InputLimits, keys: &mut dyn Keys) {
    let least = Allowed::From(-1e6, 0.0);
    let about = "least insertion speed; 0 forbids to retract";
    keys.number("v_min_mm_s", &mut limits.v_min_mm_s, least, about);
    for (key, value, about) in [
        (
            "v_max_mm_s",
            &mut limits.v_max_mm_s,
            "largest insertion speed",
        ),
        (
            "omega_max_rad_s",
            &mut limits.omega_max_rad_s,
            "largest spin either way",
        ),
        (
            "v_rate_max_mm_s2",
            &mut limits.v_rate_max_mm_s2,
            "largest change of the speed",
        ),
        (
            "omega_rate_max_rad_s2",
            &mut limits.omega_rate_max_rad_s2,
            "largest change of the spin",
        ),
    ] {
        keys.number(key, value, Allowed::POSITIVE, about);
    }
}
