//! The simulated needle of a scenario: what a real one adds to the model, where it starts, what disturbs it.

use super::keys::{Allowed, Choice, Keys};

/// A point of the curvature profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvatureKnot {
    /// Inserted length, mm.
    pub depth_mm: f64,
    /// Curvature there, as a multiple of the plant's.
    pub factor: f64,
}

/// How rotation of the base reaches the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlantTorsion {
    /// The tip turns with the base.
    Rigid,
    /// First-order lag.
    FirstOrder {
        /// Time constant, s.
        time_constant_s: f64,
    },
    /// Static wind-up by friction along the shaft.
    WindUp {
        /// Largest lag at `depth_mm`, rad.
        angle_rad: f64,
        /// Depth of that lag, mm.
        depth_mm: f64,
    },
}

/// Where the tip starts relative to the first pose of the path, in the body frame of that pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StartOffset {
    /// Offset of the position, mm.
    pub offset_mm: [f64; 3],
    /// Rotation vector, rad; the third is roll.
    pub rotation_rad: [f64; 3],
    /// Standard deviation of a random offset in each direction, mm.
    pub offset_std_mm: f64,
    /// Standard deviation of a random tilt about each normal, rad.
    pub tilt_std_rad: f64,
    /// Standard deviation of a random roll, rad.
    pub roll_std_rad: f64,
}

/// Random disturbances while the needle moves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disturbances {
    /// Standard deviation of the plant's curvature between runs, as a fraction of it.
    pub curvature_std_fraction: f64,
    /// Random walk of the tip's position a millimetre of insertion, mm.
    pub position_std_mm_per_sqrt_mm: f64,
    /// Random walk of the tip's heading a millimetre of insertion, rad.
    pub heading_std_rad_per_sqrt_mm: f64,
    /// Random walk of the tip's roll a millimetre of insertion, rad.
    pub roll_std_rad_per_sqrt_mm: f64,
    /// Standard deviation of the driver's speed in each sample, as a fraction of the commanded one.
    pub v_std_fraction: f64,
    /// Standard deviation of the driver's spin in each sample, as a fraction of the commanded one.
    pub omega_std_fraction: f64,
}

/// The simulated needle.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// Curvature as a multiple of the one that the controller believes in.
    pub curvature_factor: f64,
    /// Further factors along the inserted length, linear between knots; empty for none.
    pub curvature_profile: Vec<CurvatureKnot>,
    /// Torsion of the shaft.
    pub torsion: PlantTorsion,
    /// Distance from the kinematic frame to the visible tip, mm.
    pub bevel_offset_mm: f64,
    /// Integration steps in each sample.
    pub substeps: u64,
    /// Where the tip starts.
    pub start: StartOffset,
    /// What disturbs it.
    pub disturbances: Disturbances,
}

impl Default for Plant {
    /// The model's needle, integrated ten times finer.
    fn default() -> Self {
        Self {
            curvature_factor: 1.0,
            curvature_profile: Vec::new(),
            torsion: PlantTorsion::Rigid,
            bevel_offset_mm: 0.0,
            substeps: 10,
            start: StartOffset::default(),
            disturbances: Disturbances::default(),
        }
    }
}

impl Plant {
    pub(super) fn keys(&mut self, keys: &mut dyn Keys) {
        keys.number(
            "curvature_factor",
            &mut self.curvature_factor,
            Allowed::From(0.0, 100.0),
            "true curvature as a multiple of needle.curvature_per_mm",
        );
        let profile = &mut self.curvature_profile;
        keys.rows(
            "curvature_profile",
            "further factors along the inserted length, linear between knots",
            profile.len(),
            &mut |i, keys| {
                if profile.len() <= i {
                    profile.push(CurvatureKnot {
                        depth_mm: f64::NAN,
                        factor: f64::NAN,
                    });
                }
                let knot = &mut profile[i];
                let depth = "inserted length; must increase from knot to knot";
                keys.number("depth_mm", &mut knot.depth_mm, Allowed::NOT_NEGATIVE, depth);
                let factor = "multiple of the plant's curvature";
                keys.number(
                    "factor",
                    &mut knot.factor,
                    Allowed::From(0.0, 100.0),
                    factor,
                );
            },
        );
        keys.number(
            "bevel_offset_mm",
            &mut self.bevel_offset_mm,
            Allowed::From(0.0, 100.0),
            "distance from the kinematic frame to the visible tip",
        );
        keys.count(
            "substeps",
            &mut self.substeps,
            (1, 1000),
            "integration steps in each sample",
        );
        keys.table(
            "torsion",
            "how rotation of the base reaches the tip",
            &mut |keys| {
                self.torsion.keys(keys);
            },
        );
        keys.table(
            "start",
            "where the tip starts relative to the path's first pose, in its body frame",
            &mut |keys| self.start.keys(keys),
        );
        keys.table(
            "disturbances",
            "random disturbances; all zero without this table",
            &mut |keys| self.disturbances.keys(keys),
        );
    }
}

impl PlantTorsion {
    const NAMES: &'static [&'static str] = &["rigid", "first_order", "wind_up"];

    fn index(self) -> usize {
        match self {
            Self::Rigid => 0,
            Self::FirstOrder { .. } => 1,
            Self::WindUp { .. } => 2,
        }
    }

    fn named(index: usize) -> Self {
        let (angle_rad, depth_mm) = (f64::NAN, 100.0);
        match index {
            0 => Self::Rigid,
            1 => Self::FirstOrder {
                time_constant_s: f64::NAN,
            },
            _ => Self::WindUp {
                angle_rad,
                depth_mm,
            },
        }
    }

    fn keys(&mut self, keys: &mut dyn Keys) {
        keys.choice(Choice {
            key: "kind",
            about: "model of the shaft",
            names: Self::NAMES,
            chosen: self.index(),
            required: false,
            variant: &mut |index, keys| {
                if index != self.index() {
                    *self = Self::named(index);
                }
                match self {
                    Self::Rigid => {}
                    Self::FirstOrder { time_constant_s } => {
                        let about = "time constant of the lag";
                        keys.number("time_constant_s", time_constant_s, Allowed::POSITIVE, about);
                    }
                    Self::WindUp {
                        angle_rad,
                        depth_mm,
                    } => {
                        let about = "largest lag at depth_mm";
                        keys.number("angle_rad", angle_rad, Allowed::NOT_NEGATIVE, about);
                        keys.number("depth_mm", depth_mm, Allowed::POSITIVE, "depth of that lag");
                    }
                }
            },
        });
    }
}

impl StartOffset {
    fn keys(&mut self, keys: &mut dyn Keys) {
        let about = "offset of the position (body x, y, z)";
        keys.numbers("offset_mm", &mut self.offset_mm, Allowed::ANY, about);
        let about = "rotation vector; the third is roll";
        let angle = Allowed::From(-3.2, 3.2);
        keys.numbers("rotation_rad", &mut self.rotation_rad, angle, about);
        for (key, value, about) in [
            (
                "offset_std_mm",
                &mut self.offset_std_mm,
                "standard deviation of a random offset in each direction",
            ),
            (
                "tilt_std_rad",
                &mut self.tilt_std_rad,
                "standard deviation of a random tilt about each normal",
            ),
            (
                "roll_std_rad",
                &mut self.roll_std_rad,
                "standard deviation of a random roll",
            ),
        ] {
            keys.number(key, value, Allowed::NOT_NEGATIVE, about);
        }
    }
}

impl Disturbances {
    fn keys(&mut self, keys: &mut dyn Keys) {
        for (key, value, about) in [
            (
                "curvature_std_fraction",
                &mut self.curvature_std_fraction,
                "standard deviation of the plant's curvature between runs, as a fraction of it; no run bends the other way",
            ),
            (
                "position_std_mm_per_sqrt_mm",
                &mut self.position_std_mm_per_sqrt_mm,
                "random walk of the tip's position along the insertion",
            ),
            (
                "heading_std_rad_per_sqrt_mm",
                &mut self.heading_std_rad_per_sqrt_mm,
                "random walk of the tip's heading along the insertion",
            ),
            (
                "roll_std_rad_per_sqrt_mm",
                &mut self.roll_std_rad_per_sqrt_mm,
                "random walk of the tip's roll along the insertion",
            ),
            (
                "v_std_fraction",
                &mut self.v_std_fraction,
                "standard deviation of the driver's speed, as a fraction of the commanded one",
            ),
            (
                "omega_std_fraction",
                &mut self.omega_std_fraction,
                "standard deviation of the driver's spin, as a fraction of the commanded one",
            ),
        ] {
            keys.number(key, value, Allowed::From(0.0, 10.0), about);
        }
    }
}
