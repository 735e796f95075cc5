//! What stands between sensors and controller.

use super::keys::{Allowed, Choice, Keys};
use needle_control::{FilterSettings, ProcessNoise};

/// The estimator.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum EstimatorChoice {
    /// The true pose of the visible tip, whatever the sensors: what perfect sensing is worth.
    #[default]
    Perfect,
    /// The sensors' readings as they come; needs tangent and roll to be measured.
    Raw,
    /// The error-state filter.
    Filter(FilterChoice),
}

/// Settings of the filter. What it knows of the sensors' noise is the truth unless the scenario says otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterChoice {
    /// Settings of the filter itself; a standard deviation of zero stands for the sensors' own.
    pub settings: FilterSettings,
    /// Time constant of the torsional lag that the filter assumes, s; `None` for a rigid shaft.
    pub torsion_time_constant_s: Option<f64>,
    /// Rolls that are tried at entry; 1 where the roll is known.
    pub roll_hypotheses: u64,
    /// What is known at entry: standard deviations.
    pub entry: EntryKnowledge,
}

/// Standard deviations of what is known when the needle enters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EntryKnowledge {
    /// Of the position in each direction, mm.
    pub position_std_mm: f64,
    /// Of the heading about each normal, rad.
    pub heading_std_rad: f64,
    /// Of the roll, rad.
    pub roll_std_rad: f64,
    /// Of the curvature, as a fraction of it.
    pub curvature_std_fraction: f64,
    /// Of the torsional lag, rad.
    pub lag_std_rad: f64,
}

impl Default for FilterChoice {
    fn default() -> Self {
        Self {
            settings: FilterSettings {
                position_std_mm: 0.0,
                tangent_std_rad: 0.0,
                ..FilterSettings::default()
            },
            torsion_time_constant_s: None,
            roll_hypotheses: 1,
            entry: EntryKnowledge {
                position_std_mm: 0.2,
                heading_std_rad: 0.02,
                roll_std_rad: 0.1,
                curvature_std_fraction: 0.3,
                lag_std_rad: 0.01,
            },
        }
    }
}

impl EstimatorChoice {
    const NAMES: &'static [&'static str] = &["perfect", "raw", "filter"];

    fn index(&self) -> usize {
        match self {
            Self::Perfect => 0,
            Self::Raw => 1,
            Self::Filter(_) => 2,
        }
    }

    pub(super) fn keys(&mut self, keys: &mut dyn Keys) {
        keys.choice(Choice {
            key: "kind",
            about: "the true pose, the sensors' readings as they are, or the error-state filter",
            names: Self::NAMES,
            chosen: self.index(),
            required: false,
            variant: &mut |index, keys| {
                if index != self.index() {
                    *self = match index {
                        0 => Self::Perfect,
                        1 => Self::Raw,
                        _ => Self::Filter(FilterChoice::default()),
                    };
                }
                if let Self::Filter(filter) = self {
                    filter.keys(keys);
                }
            },
        });
    }
}

impl FilterChoice {
    fn keys(&mut self, keys: &mut dyn Keys) {
        let size = Allowed::NOT_NEGATIVE;
        let FilterSettings {
            position_std_mm,
            tangent_std_rad,
            process,
            gate_probability,
            outliers_until_lost,
            blind_limit_s,
            history,
            ..
        } = &mut self.settings;
        let about = "assumed standard deviation of the position; 0 for the sensors' own";
        keys.number("position_std_mm", position_std_mm, size, about);
        let about = "assumed standard deviation of the tangent; 0 for the sensors' own";
        keys.number("tangent_std_rad", tangent_std_rad, size, about);
        let about = "assumed time constant of the torsional lag; absent for a rigid shaft";
        let time = Allowed::Above(0.0, 1e3);
        keys.optional(
            "torsion_time_constant_s",
            &mut self.torsion_time_constant_s,
            time,
            about,
        );
        let about = "rolls that are tried at entry; 1 where the roll is known";
        keys.count("roll_hypotheses", &mut self.roll_hypotheses, (1, 64), about);
        let about = "probability that a good observation is refused";
        keys.number(
            "gate_probability",
            gate_probability,
            Allowed::From(1e-12, 0.5),
            about,
        );
        let mut outliers = u64::from(*outliers_until_lost);
        let about = "outliers in a row after which the filter takes itself to be lost";
        keys.count("outliers_until_lost", &mut outliers, (1, 1_000_000), about);
        *outliers_until_lost = u32::try_from(outliers).unwrap_or(*outliers_until_lost);
        let about = "longest time without an accepted observation for which a pose is reported";
        keys.number("blind_limit_s", blind_limit_s, time, about);
        let about = "samples and observations that are remembered for late ones";
        super::keys::size(keys, "history", history, (4, 1000), about);
        keys.table("entry", "what is known at entry", &mut |keys| {
            self.entry.keys(keys);
        });
        keys.table(
            "process",
            "random walks that the model leaves out, in one second",
            &mut |keys| {
                process_keys(process, keys);
            },
        );
    }
}

impl EntryKnowledge {
    fn keys(&mut self, keys: &mut dyn Keys) {
        for (key, value, about) in [
            (
                "position_std_mm",
                &mut self.position_std_mm,
                "of the position in each direction",
            ),
            (
                "heading_std_rad",
                &mut self.heading_std_rad,
                "of the heading about each normal",
            ),
            ("roll_std_rad", &mut self.roll_std_rad, "of the roll"),
            (
                "curvature_std_fraction",
                &mut self.curvature_std_fraction,
                "of the curvature, as a fraction of it",
            ),
            ("lag_std_rad", &mut self.lag_std_rad, "of the torsional lag"),
        ] {
            keys.number(key, value, Allowed::From(1e-6, 1e3), about);
        }
    }
}

fn process_keys(process: &mut ProcessNoise, keys: &mut dyn Keys) {
    for (key, value, about) in [
        ("position_mm", &mut process.position_mm, "of the position"),
        ("heading_rad", &mut process.heading_rad, "of the heading"),
        ("roll_rad", &mut process.roll_rad, "of the roll"),
        (
            "curvature_per_mm",
            &mut process.curvature_per_mm,
            "of the curvature",
        ),
        ("lag_rad", &mut process.lag_rad, "of the torsional lag"),
    ] {
        keys.number(key, value, Allowed::NOT_NEGATIVE, about);
    }
}
