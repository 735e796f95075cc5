//! The cases: a path, a plant that is not the model, and what the controller gets to see.
//!
//! Unless a case says otherwise: 100 mm at 5 mm/s, dt = 0.1 s, a model that bends by 1/150 per mm, a path of half of that with a
//! torsion of 0.01 rad/mm, the pose measured exactly.

use nalgebra::Vector6;
use needle_control::{NeedleFilter, ReconstructionError};
use needle_model::{
    CurvatureProfile, CurvatureProfileError, EulerState, InvalidCurvature, InvalidTorsion, Needle,
    PhysicalNeedle, Pose, PositionPathError, ReferencePath, ReferencePathError, Torsion,
    TorsionalLag, paper_bevel_inputs,
};

/// Curvature of the model, 1/mm.
pub(super) const CURVATURE_PER_MM: f64 = 1.0 / 150.0;

/// Sample time, s.
pub(super) const DT_S: f64 = 0.1;

/// Length of the curves, mm, and speed along them.
const LENGTH_MM: f64 = 100.0;
pub(super) const SPEED_MM_S: f64 = 5.0;

/// Why a case cannot be set up or run.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CaseError {
    #[error(transparent)]
    Curvature(#[from] InvalidCurvature),
    #[error(transparent)]
    Profile(#[from] CurvatureProfileError),
    #[error(transparent)]
    Torsion(#[from] InvalidTorsion),
    #[error(transparent)]
    Path(#[from] ReferencePathError),
    #[error(transparent)]
    Positions(#[from] PositionPathError),
    #[error(transparent)]
    Curve(#[from] needle_model::PositionCurveError),
    #[error(transparent)]
    Reconstruction(#[from] ReconstructionError),
    #[error(transparent)]
    Step(#[from] needle_model::StepError),
    #[error(transparent)]
    Filter(#[from] needle_control::FilterError),
    #[error(transparent)]
    Predictive(#[from] needle_control::ConfigurationError),
    #[error(transparent)]
    Explicit(#[from] needle_control::BaselineError),
}

/// What reaches the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Sensing {
    /// The pose, with this noise on each coordinate of the position.
    Pose { noise_mm: f64 },
    /// Position and tangent with noise, late by some samples, through the filter: roll is unseen, curvature is doubted.
    Filter {
        noise_mm: f64,
        noise_rad: f64,
        late_samples: usize,
    },
}

/// One row of cases.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) path: ReferencePath,
    /// Whether the model's needle executes the path as it stands.
    pub(super) executable: bool,
    pub(super) plant: PhysicalNeedle,
    pub(super) start: Pose,
    pub(super) sensing: Sensing,
}

/// A curve of constant curvature, as a fraction of the needle's, and torsion.
fn curve(ratio: f64, torsion_rad_per_mm: f64) -> Result<ReferencePath, CaseError> {
    let twist = Vector6::new(
        0.0,
        0.0,
        1.0,
        ratio * CURVATURE_PER_MM,
        0.0,
        torsion_rad_per_mm,
    );
    let step_mm = SPEED_MM_S * DT_S;
    let samples = (LENGTH_MM / step_mm).round() as usize;
    let poses = (0..=samples).map(|k| Pose::exp(&(twist * (k as f64 * step_mm))));
    Ok(ReferencePath::from_poses(poses.collect(), DT_S)?)
}

fn bending(factor: f64) -> Result<PhysicalNeedle, CaseError> {
    Ok(Needle::new(factor * CURVATURE_PER_MM)?.into())
}

/// Every case.
pub(super) fn all() -> Result<Vec<Case>, CaseError> {
    let nominal = Case {
        name: "nominal",
        path: curve(0.5, 0.01)?,
        executable: false,
        plant: bending(1.0)?,
        start: Pose::identity(),
        sensing: Sensing::Pose { noise_mm: 0.0 },
    };
    let like = |name| Case {
        name,
        ..nominal.clone()
    };
    let filtered = |noise_mm, noise_rad: f64, late_samples| Sensing::Filter {
        noise_mm,
        noise_rad: noise_rad.to_radians(),
        late_samples,
    };
    let varying = CurvatureProfile::new(&[
        (0.0, 0.8 * CURVATURE_PER_MM),
        (50.0, 1.2 * CURVATURE_PER_MM),
        (100.0, 0.8 * CURVATURE_PER_MM),
    ])?;
    let off = EulerState {
        x_mm: 1.0,
        y_mm: 1.0,
        z_mm: 0.0,
        alpha_rad: 0.05,
        beta_rad: 0.05,
        gamma_rad: 1.0,
    };
    let paper = ReferencePath::from_inputs(
        Needle::new(CURVATURE_PER_MM)?,
        Pose::identity(),
        paper_bevel_inputs(),
        DT_S,
    )?;
    Ok(vec![
        Case {
            plant: bending(0.8)?,
            ..like("plant curvature -20 %")
        },
        Case {
            plant: bending(1.2)?,
            ..like("plant curvature +20 %")
        },
        Case {
            plant: PhysicalNeedle {
                curvature: varying,
                ..bending(1.0)?
            },
            ..like("plant curvature varies by 20 %")
        },
        Case {
            path: curve(0.8, 0.01)?,
            ..like("path curvature 0.8")
        },
        Case {
            path: curve(0.0, 0.0)?,
            ..like("straight path")
        },
        Case {
            start: off.to_pose(),
            ..like("start off the path")
        },
        Case {
            plant: PhysicalNeedle {
                torsion: Torsion::FirstOrder(TorsionalLag::new(0.1)?),
                ..bending(1.0)?
            },
            ..like("torsional lag 0.1 s")
        },
        Case {
            sensing: Sensing::Pose { noise_mm: 0.2 },
            ..like("noise 0.2 mm, no filter")
        },
        Case {
            sensing: filtered(0.01, 0.05, 0),
            ..like("roll unmeasured")
        },
        Case {
            sensing: filtered(0.2, 1.0, 0),
            ..like("noise 0.2 mm and 1 deg, filter")
        },
        Case {
            sensing: filtered(0.2, 1.0, 1),
            ..like("the same, 100 ms late")
        },
        Case {
            sensing: filtered(0.2, 1.0, 0),
            plant: bending(0.8)?,
            ..like("the same, plant curvature -20 %")
        },
        Case {
            path: paper,
            executable: true,
            ..like("the paper's path")
        },
        nominal,
    ])
}

/// The filter of a case, as one knows the needle at entry: 0.2 mm, 0.02 rad, 0.1 rad of roll, curvature to 30 %.
pub(super) fn filter(noise_mm: f64, noise_rad: f64) -> Result<NeedleFilter, CaseError> {
    let state = needle_model::LaggedState {
        pose: Pose::identity(),
        needle: Needle::new(CURVATURE_PER_MM)?,
        lag_rad: 0.0,
    };
    let std = [0.2, 0.2, 0.2, 0.02, 0.02, 0.1, 0.3 * CURVATURE_PER_MM, 0.01];
    let settings = needle_control::FilterSettings {
        position_std_mm: noise_mm,
        tangent_std_rad: noise_rad,
        ..needle_control::FilterSettings::default()
    };
    let belief = needle_control::Belief::independent(state, &nalgebra::SVector::from(std));
    Ok(NeedleFilter::new(settings, belief, 0.0)?)
}
