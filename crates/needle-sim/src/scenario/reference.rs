//! The path of a scenario: a recipe of inputs, the paper's, or a file of positions or poses.

use super::keys::{Allowed, Choice, Keys};
use std::path::PathBuf;

/// Inputs held for some time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputSegment {
    /// Time, s.
    pub duration_s: f64,
    /// Insertion speed, mm/s.
    pub v_mm_s: f64,
    /// Spin, rad/s.
    pub omega_rad_s: f64,
}

/// The path to follow.
#[derive(Debug, Clone, PartialEq)]
pub enum Reference {
    /// The path of a needle under given inputs. With a curvature factor below 1 the controller's needle cannot execute the
    /// inputs themselves but, on average, the curve.
    Inputs {
        /// Curvature of the needle that makes the path, as a multiple of `needle.curvature_per_mm`.
        curvature_factor: f64,
        /// The inputs.
        segments: Vec<InputSegment>,
        /// Whether the controller gets the path as its own needle can execute it, found through the path's positions. Distances
        /// stay those to the path.
        reconstructed: bool,
    },
    /// The paper's bevel-tip recipe, executed exactly.
    PaperBevel,
    /// The paper's bevel-tip path as its own forward-Euler program made it.
    PaperEuler,
    /// The paper's straight-needle recipe.
    PaperStraight,
    /// Positions from a CSV file with a header that names `x_mm`, `y_mm` and `z_mm`; the needle's inputs are reconstructed.
    Positions {
        /// The file.
        file: PathBuf,
        /// Length below which ripple is smoothed away, mm.
        smoothing_mm: f64,
        /// Insertion speed, mm/s.
        speed_mm_s: f64,
    },
    /// Poses and inputs from a CSV file of `needle-model`.
    Poses {
        /// The file.
        file: PathBuf,
    },
    /// Poses from a plan of the UNC planner, one sample apart.
    Planner {
        /// The file.
        file: PathBuf,
    },
}

impl Default for Reference {
    fn default() -> Self {
        Self::named(0)
    }
}

impl Reference {
    const NAMES: &'static [&'static str] = &[
        "inputs",
        "paper_bevel",
        "paper_euler",
        "paper_straight",
        "positions",
        "poses",
        "planner",
    ];

    /// The file that the path comes from.
    #[must_use]
    pub fn file(&self) -> Option<&PathBuf> {
        match self {
            Self::Positions { file, .. } | Self::Poses { file } | Self::Planner { file } => {
                Some(file)
            }
            _ => None,
        }
    }

    fn index(&self) -> usize {
        match self {
            Self::Inputs { .. } => 0,
            Self::PaperBevel => 1,
            Self::PaperEuler => 2,
            Self::PaperStraight => 3,
            Self::Positions { .. } => 4,
            Self::Poses { .. } => 5,
            Self::Planner { .. } => 6,
        }
    }

    fn named(index: usize) -> Self {
        let file = PathBuf::new();
        match index {
            0 => Self::Inputs {
                curvature_factor: 1.0,
                segments: Vec::new(),
                reconstructed: false,
            },
            1 => Self::PaperBevel,
            2 => Self::PaperEuler,
            3 => Self::PaperStraight,
            4 => Self::Positions {
                file,
                smoothing_mm: 0.0,
                speed_mm_s: 5.0,
            },
            5 => Self::Poses { file },
            _ => Self::Planner { file },
        }
    }

    pub(super) fn keys(&mut self, keys: &mut dyn Keys) {
        keys.choice(Choice {
            key: "kind",
            about: "where the path comes from",
            names: Self::NAMES,
            chosen: self.index(),
            required: true,
            variant: &mut |index, keys| {
                if index != self.index() {
                    *self = Self::named(index);
                }
                self.variant_keys(keys);
            },
        });
    }

    fn variant_keys(&mut self, keys: &mut dyn Keys) {
        match self {
            Self::Inputs {
                curvature_factor,
                segments,
                reconstructed,
            } => {
                let about = "curvature of the needle that makes the path, as a multiple of needle.curvature_per_mm";
                keys.number(
                    "curvature_factor",
                    curvature_factor,
                    Allowed::From(0.0, 100.0),
                    about,
                );
                let about = "hand the controller what its own needle executes along the path's positions; distances stay those to the path";
                keys.flag("reconstructed", reconstructed, about);
                keys.rows(
                    "segments",
                    "inputs, each held for some time; at least one",
                    segments.len(),
                    &mut |i, keys| {
                        if segments.len() <= i {
                            segments.push(InputSegment::ABSENT);
                        }
                        segments[i].keys(keys);
                    },
                );
            }
            Self::PaperBevel | Self::PaperEuler | Self::PaperStraight => {}
            Self::Positions {
                file,
                smoothing_mm,
                speed_mm_s,
            } => {
                let about = "CSV file with a header that names x_mm, y_mm and z_mm";
                keys.file("file", file, about);
                let about = "ripple shorter than some six times this is smoothed away";
                keys.number("smoothing_mm", smoothing_mm, Allowed::NOT_NEGATIVE, about);
                let about = "insertion speed along the path";
                keys.number("speed_mm_s", speed_mm_s, Allowed::Above(0.0, 1e3), about);
            }
            Self::Poses { file } => {
                let about = "CSV file t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,v_mm_s,omega_rad_s";
                keys.file("file", file, about);
            }
            Self::Planner { file } => {
                let about = "plan of the UNC planner: x y z qx qy qz qw a line, one sample apart";
                keys.file("file", file, about);
            }
        }
    }
}

impl InputSegment {
    /// Every key must be there, but for the spin.
    const ABSENT: Self = Self {
        duration_s: f64::NAN,
        v_mm_s: f64::NAN,
        omega_rad_s: 0.0,
    };

    fn keys(&mut self, keys: &mut dyn Keys) {
        let time = Allowed::Above(0.0, 1e4);
        keys.number(
            "duration_s",
            &mut self.duration_s,
            time,
            "time; a whole number of samples",
        );
        let speed = Allowed::From(-1e3, 1e3);
        keys.number("v_mm_s", &mut self.v_mm_s, speed, "insertion speed");
        keys.number("omega_rad_s", &mut self.omega_rad_s, speed, "spin");
    }
}
