//! The cases, as pieces of scenarios: a path, a plant that is not the model, and what the controller gets to see.
//!
//! Unless a case says otherwise: 100 mm at 5 mm/s, dt = 0.1 s, a model that bends by 1/150 per mm, a path of half of that with a
//! torsion of 0.01 rad/mm, the pose measured exactly, ten steps of the plant in a sample.

/// A case.
#[derive(Debug, Clone, Copy)]
pub(super) struct Case {
    pub(super) name: &'static str,
    path: &'static str,
    /// Keys of its own, one a line.
    keys: &'static str,
    /// Runs, each with noise of its own.
    pub(super) runs: u64,
    /// Whether the start is off along the path: the distance across it, from the nearest point, is then zero for every controller.
    pub(super) along: bool,
}

/// Runs of a case with noise.
const NOISY_RUNS: u64 = 8;

/// The controllers by their names in a scenario, in the order of the table.
pub(super) const CONTROLLERS: [&str; 9] = [
    "nmpc",
    "ltv",
    "straight",
    "lqr",
    "pid",
    "sliding_mode",
    "duty_cycled",
    "feed_forward",
    "published",
];

/// Controllers that follow a path's own inputs: of a curve they get what the needle executes along it.
const BY_INPUTS: [&str; 4] = ["ltv", "lqr", "feed_forward", "published"];

const CURVE: &str = "\
needle.curvature_per_mm = 0.006666666666666667
reference.kind = 'inputs'
reference.curvature_factor = 0.5
reference.segments = [{ duration_s = 20.0, v_mm_s = 5.0, omega_rad_s = 0.05 }]
";

const STRONGLY_BENT: &str = "\
needle.curvature_per_mm = 0.006666666666666667
reference.kind = 'inputs'
reference.curvature_factor = 0.8
reference.segments = [{ duration_s = 20.0, v_mm_s = 5.0, omega_rad_s = 0.05 }]
";

const LINE: &str = "\
needle.curvature_per_mm = 0.006666666666666667
reference.kind = 'inputs'
reference.curvature_factor = 0.0
reference.segments = [{ duration_s = 20.0, v_mm_s = 5.0 }]
";

const PAPER_BEVEL: &str = "\
needle.curvature_per_mm = 0.006666666666666667
reference.kind = 'paper_bevel'
";

/// A needle without bevel, and the paper's limits but for the lower bound of the speed, which it lacks.
const PAPER_STRAIGHT: &str = "\
needle.curvature_per_mm = 0.0
reference.kind = 'paper_straight'
limits.v_max_mm_s = 200.0
limits.v_rate_max_mm_s2 = 1000.0
";

/// A needle without bevel, turned as it goes in: speeds and spin leave room for a terminal set, which the paper's leave not.
const ROD: &str = "\
needle.curvature_per_mm = 0.0
reference.kind = 'inputs'
reference.segments = [{ duration_s = 20.0, v_mm_s = 5.0, omega_rad_s = 0.5 }]
";

const BEHIND: &str = "\
plant.start.offset_mm = [0.0, 0.0, -1.0]
plant.start.rotation_rad = [0.0, 0.0, -0.1]
";

const VARYING: &str = "\
plant.curvature_profile = [
    { depth_mm = 0.0, factor = 0.8 },
    { depth_mm = 50.0, factor = 1.2 },
    { depth_mm = 100.0, factor = 0.8 },
]
";

/// The Euler angles 0.05, 0.05 and 1 rad as a rotation vector.
const OFF: &str = "\
plant.start.offset_mm = [1.0, 1.0, 0.0]
plant.start.rotation_rad = [0.07075393, 0.02075977, 1.00081902]
";

const UNFILTERED: &str = "\
estimator.kind = 'raw'
sensors.position_std_mm = 0.2
";

/// Roll is unseen, and the filter doubts the curvature by 30 %.
const ROLL_UNSEEN: &str = "\
estimator.kind = 'filter'
sensors.roll_measured = false
sensors.position_std_mm = 0.01
sensors.tangent_std_rad = 0.0008726646
";

/// Keys of the filter and its sensors, before the keys given.
macro_rules! filtered {
    ($keys:literal) => {
        concat!(
            "estimator.kind = 'filter'\n",
            "sensors.roll_measured = false\n",
            "sensors.position_std_mm = 0.2\n",
            "sensors.tangent_std_rad = 0.01745329\n",
            $keys
        )
    };
}

const FILTERED: &str = filtered!("");
const FILTERED_LATE: &str = filtered!("sensors.delay_s = 0.1\n");
const FILTERED_WEAK: &str = filtered!("plant.curvature_factor = 0.8\n");

const fn exact(name: &'static str, path: &'static str, keys: &'static str) -> Case {
    Case {
        name,
        path,
        keys,
        runs: 1,
        along: false,
    }
}

const fn noisy(name: &'static str, keys: &'static str) -> Case {
    Case {
        runs: NOISY_RUNS,
        ..exact(name, CURVE, keys)
    }
}

const fn along(name: &'static str, path: &'static str) -> Case {
    Case {
        along: true,
        ..exact(name, path, BEHIND)
    }
}

/// Every case.
pub(super) const CASES: [Case; 17] = [
    exact("nominal", CURVE, ""),
    exact(
        "plant curvature -20 %",
        CURVE,
        "plant.curvature_factor = 0.8\n",
    ),
    exact(
        "plant curvature +20 %",
        CURVE,
        "plant.curvature_factor = 1.2\n",
    ),
    exact("plant curvature varies by 20 %", CURVE, VARYING),
    exact("path curvature 0.8", STRONGLY_BENT, ""),
    exact("straight path", LINE, ""),
    exact("start off the path", CURVE, OFF),
    exact(
        "torsional lag 0.1 s",
        CURVE,
        "plant.torsion = { kind = 'first_order', time_constant_s = 0.1 }\n",
    ),
    noisy("noise 0.2 mm, no filter", UNFILTERED),
    noisy("roll unmeasured", ROLL_UNSEEN),
    noisy("noise 0.2 mm and 1 deg, filter", FILTERED),
    noisy("the same, 100 ms late", FILTERED_LATE),
    noisy("the same, plant curvature -20 %", FILTERED_WEAK),
    exact("the paper's path", PAPER_BEVEL, ""),
    exact("the paper's path, start off", PAPER_BEVEL, OFF),
    along(
        "the paper's straight needle, 1 mm and 0.1 rad behind",
        PAPER_STRAIGHT,
    ),
    along("a straight needle, 1 mm and 0.1 rad behind", ROD),
];

impl Case {
    fn is_straight(&self) -> bool {
        [PAPER_STRAIGHT, ROD].contains(&self.path)
    }

    /// Why a controller is none for the case; `None` where it is one.
    pub(super) fn excludes(&self, controller: &str) -> Option<&'static str> {
        let straight = self.is_straight();
        match controller {
            "straight" if !straight => Some("the needle has a bevel"),
            "published" if straight => Some("its needle has a bevel"),
            "pid" | "sliding_mode" | "duty_cycled" if straight => {
                Some("a needle without bevel cannot be steered")
            }
            _ => None,
        }
    }

    /// The scenario of a controller on the case.
    pub(super) fn scenario(&self, controller: &str) -> String {
        let Self {
            name, path, keys, ..
        } = self;
        let by_inputs = BY_INPUTS.contains(&controller) && path.contains("'inputs'");
        let reconstructed = match by_inputs && !self.is_straight() {
            true => "reference.reconstructed = true\n",
            false => "",
        };
        format!("# {name}\ncontroller.name = '{controller}'\n{path}{reconstructed}{keys}")
    }
}
