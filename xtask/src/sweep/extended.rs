//! The paper's sweeps with controllers that are right: `corrected/` on the paper's own path from its start, `perturbed/` with what a
//! robot meets. Weights and horizons are the paper's, put into millimetres.

use super::SweepError;
use super::pictures;
use crate::say;
use needle_sim::output::{make_folder, write_whole};
use needle_sim::scenario::Document;
use needle_sim::{Experiment, RunError, RunLog, ScenarioError};
use std::path::Path;

/// Why an extended run cannot be made.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ExtendedError {
    #[error("its scenario")]
    Scenario(#[from] ScenarioError),
    #[error("its closed loop")]
    Run(#[from] RunError),
}

/// The paper's path, needle and limits; the speed's least value is a needle's.
const CORRECTED: &str = "\
seed = 1
needle.curvature_per_mm = 0.006666666666666667
reference.kind = 'paper_bevel'
[limits]
v_min_mm_s = 0.0
v_max_mm_s = 200.0
omega_max_rad_s = 0.03490658503988659
v_rate_max_mm_s2 = 1000.0
omega_rate_max_rad_s2 = 0.017453292519943295
";

/// The same path from a start that is off by 1 mm and 10 degrees with a curvature that is off by 10 %, seen through noise by the
/// filter, within the limits of the clinical preset but for the speed: 20 mm/s in
/// place of 10, twice the path's, so that a controller can catch up.
const PERTURBED: &str = "\
seed = 1
needle.curvature_per_mm = 0.006666666666666667
reference.kind = 'paper_bevel'
[limits]
v_min_mm_s = 0.0
v_max_mm_s = 20.0
omega_max_rad_s = 12.566370614359172
v_rate_max_mm_s2 = 100.0
omega_rate_max_rad_s2 = 50.0
[plant]
curvature_factor = 1.1
start.offset_mm = [0.7, 0.7, 0.0]
start.rotation_rad = [0.0, 0.0, 0.17453292519943295]
[sensors]
position_std_mm = 0.2
tangent_std_rad = 0.017453292519943295
roll_measured = false
[estimator]
kind = 'filter'
entry.position_std_mm = 0.7
entry.roll_std_rad = 0.2
";

/// One kind of plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Family {
    Corrected,
    Perturbed,
}

impl Family {
    pub(super) const ALL: [Self; 2] = [Self::Corrected, Self::Perturbed];

    pub(super) fn folder(self) -> &'static str {
        match self {
            Self::Corrected => "corrected",
            Self::Perturbed => "perturbed",
        }
    }

    fn base(self) -> &'static str {
        match self {
            Self::Corrected => CORRECTED,
            Self::Perturbed => PERTURBED,
        }
    }
}

/// The paper's choice in its own units: q for x in mm, y and z in cm and the angles; r for v in m/s and omega in rad/s.
#[derive(Debug, Clone, Copy)]
struct Weights {
    q: [f64; 6],
    r: [f64; 2],
    horizon: i64,
}

const OUR: Weights = Weights {
    q: [0.01, 0.1, 0.1, 0.1, 0.1, 0.1],
    r: [100.0, 10.0],
    horizon: 8,
};

impl Weights {
    /// Of squared errors in mm and rad: y and z count in squared centimetres.
    fn error(self) -> [f64; 6] {
        let [x, y, z, alpha, beta, gamma] = self.q;
        [x, y / 100.0, z / 100.0, alpha, beta, gamma]
    }

    /// Of squared deviations in mm/s and rad/s.
    fn input(self) -> [f64; 2] {
        [self.r[0] * 1e-6, self.r[1]]
    }
}

/// A sweep of one weight or of the horizon, the paper's figures 8 to 10; the horizon further than there.
fn sweep(letter: char) -> Vec<(String, Weights)> {
    let ours = ("ourQR".to_owned(), OUR);
    match letter {
        'q' => std::iter::once(ours)
            .chain([0.01, 0.1, 1.0, 10.0].map(|q| (format!("Q{q}"), Weights { q: [q; 6], ..OUR })))
            .collect(),
        'r' => std::iter::once(ours)
            .chain(
                [0.01, 0.1, 1.0, 10.0, 100.0]
                    .map(|r| (format!("R{r}"), Weights { r: [r; 2], ..OUR })),
            )
            .collect(),
        // The paper's R, which forbids to steer, and one that does not.
        _ => [("", 100.0), (" R0.01", 0.01)]
            .into_iter()
            .flat_map(|(suffix, r)| {
                [2, 4, 6, 8, 20, 50, 100].map(|horizon| {
                    let r = [r; 2];
                    (format!("N{horizon}{suffix}"), Weights { r, horizon, ..OUR })
                })
            })
            .collect(),
    }
}

/// The scenario of one run; `controller` is `ltv` or `nmpc`.
fn scenario(family: Family, controller: &str, weights: Weights) -> Result<Document, ScenarioError> {
    let mut document = Document::parse(family.base())?;
    document.set("controller.name", controller)?;
    document.set("controller.horizon", weights.horizon)?;
    let (error, [v, omega]) = (weights.error(), weights.input());
    document.set("controller.weights.v", v)?;
    document.set("controller.weights.omega", omega)?;
    if controller == "ltv" {
        document.set("controller.weights.error", error.to_vec())?;
        // The paper does not weigh changes. The controller must, for its terminal set to be bounded: a thousandth.
        document.set("controller.weights.v_change", 1e-3 * v)?;
        document.set("controller.weights.omega_change", 1e-3 * omega)?;
        return Ok(document);
    }
    // One weight for the three directions: the paper's of the two that the path spans.
    document.set("controller.spin_target", "reference")?;
    for (key, weight) in [
        ("position", error[1]),
        ("tangent", error[3]),
        ("roll", error[5]),
    ] {
        document.set(&format!("controller.weights.{key}"), weight)?;
        document.set(&format!("controller.weights.end_{key}"), weight)?;
    }
    Ok(document)
}

/// Controllers with weights of their own, for contrast: the paper's weights are made for its own program.
const OWN_WEIGHTS: [(&str, &[(&str, &str)]); 2] = [
    (
        "nmpc own weights",
        &[("name", "nmpc"), ("convergence", "full")],
    ),
    ("pid", &[("name", "pid")]),
];

fn with_own_weights(family: Family, keys: &[(&str, &str)]) -> Result<Document, ScenarioError> {
    let mut document = Document::parse(family.base())?;
    for (key, value) in keys {
        document.set(&format!("controller.{key}"), *value)?;
    }
    Ok(document)
}

/// One data file: all runs of a sweep, the reference first.
#[derive(Debug)]
pub(super) struct ExtendedFile {
    pub(super) family: Family,
    pub(super) stem: &'static str,
    pub(super) logs: Vec<RunLog>,
}

/// Computes both families.
pub(super) fn compute() -> Result<Vec<ExtendedFile>, SweepError> {
    let mut files = Vec::new();
    for family in Family::ALL {
        for (letter, stem) in [
            ('q', "fig08_q_sweep"),
            ('r', "fig09_r_sweep"),
            ('n', "fig10_n_sweep"),
        ] {
            let mut logs = Vec::new();
            for (run, document) in documents(family, letter) {
                let recorded = document.map_err(ExtendedError::from).and_then(recorded);
                let record = recorded.map_err(|source| SweepError::Extended {
                    run: format!("{}/{run}", family.folder()),
                    source: Box::new(source),
                })?;
                if logs.is_empty() {
                    logs.push(record.reference.log());
                }
                logs.push(record.log(&run));
            }
            files.push(ExtendedFile { family, stem, logs });
        }
        say(&format!("computed {}", family.folder()));
    }
    Ok(files)
}

/// The runs of a file: the sweep with both controllers, and for contrast those with weights of their own.
fn documents(family: Family, letter: char) -> Vec<(String, Result<Document, ScenarioError>)> {
    let swept = ["ltv", "nmpc"].into_iter().flat_map(|controller| {
        sweep(letter).into_iter().map(move |(name, weights)| {
            (
                format!("{controller} {name}"),
                scenario(family, controller, weights),
            )
        })
    });
    let own = OWN_WEIGHTS.map(|(name, keys)| (name.to_owned(), with_own_weights(family, keys)));
    swept.chain(own).collect()
}

fn recorded(document: Document) -> Result<needle_sim::RunRecord, ExtendedError> {
    Ok(Experiment::new(&document.scenario()?)?.record(0)?)
}

/// Writes data and pictures of both families below `out`.
pub(super) fn write(out: &Path, files: &[ExtendedFile]) -> Result<(), SweepError> {
    for family in Family::ALL {
        let folder = out.join(family.folder());
        make_folder(&folder)?;
        for file in files.iter().filter(|file| file.family == family) {
            let data = super::dataset::encode(&file.logs)?;
            write_whole(&folder.join(format!("{}.csv", file.stem)), &data)?;
            let name = format!("{}.svg", file.stem);
            let title = format!("{}, {}", file.stem, family.folder());
            let picture =
                pictures::positions(&title, &file.logs).map_err(|source| SweepError::Picture {
                    file: name.clone(),
                    source,
                })?;
            write_whole(&folder.join(name), picture.as_bytes())?;
        }
        write_whole(&folder.join("summary.csv"), &summary(family, files)?)?;
    }
    Ok(())
}

/// `summary.csv` of a family.
pub(super) fn summary(
    family: Family,
    files: &[ExtendedFile],
) -> Result<Vec<u8>, super::dataset::DatasetError> {
    let of_family = files.iter().filter(|file| file.family == family);
    let rows = of_family.flat_map(|file| {
        let metrics = file
            .logs
            .iter()
            .map(|log| (log.run.as_str(), log.metrics()));
        metrics.map(|(run, metrics)| (file.stem, run, metrics))
    });
    super::dataset::table("file,run", &needle_sim::RunMetrics::default(), rows)
}
