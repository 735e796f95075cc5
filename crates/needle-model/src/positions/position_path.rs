//! Reference states from positions alone: the question that the paper leaves open. Given positions,
//! which poses and inputs of this needle come closest to them?
//!
//! Posed as a least-squares problem over poses g_0 .. g_N and inputs u_0 .. u_{N-1} (multiple shooting):
//!   minimise  sum |p_k - y_k|^2 / sigma_p^2 + sum |v_k - v_ref|^2 / sigma_v^2
//!                                            + sum |omega_k - omega_guess_k|^2 / sigma_omega^2
//!   subject to  log(g_{k+1}^-1 g_k exp(V(u_k) dt)) = 0,  v and omega within limits, and their changes within rates.
//! The targets y_k lie on a smooth curve at equal arc length. This file gives residuals, Jacobians,
//! initial guess and limits; the solve belongs to a crate with a solver.

use nalgebra::{SMatrix, SVector, Vector3};
use thiserror::Error;

use crate::geometry::pose::Pose;
use crate::linearisation::residual::{PointResidual, StepResidual, position_residual};
use crate::plant::needle::{Input, Needle, StepError};
use crate::positions::position_curve::{PositionCurve, PositionCurveError};
use crate::positions::position_path_settings::PositionPathSettings;
use crate::positions::spin_guess::{SpinLimits, spun_poses};
use crate::reference::reference_path::{ReferencePath, ReferencePathError};

/// More steps than any insertion has; beyond it the speed is a mistake, not a plan.
const MAX_STEPS: f64 = 1e6;

/// Fraction by which the guess may bend more than the needle: the ends of splines do.
const GUESS_MARGIN: f64 = 0.02;

/// Fraction of a step that is rounding of a length.
const ROUNDED_STEPS: f64 = 1e-6;

/// How far the guess may leave the targets, as a fraction of the curve's length: the closest path of a
/// needle does leave a curve that is too sharp, but a guess at a distance is no guess.
const GUESS_DEVIATION: f64 = 0.05;

/// Factor between the smoothing lengths that are tried.
const SMOOTHING_GROWTH: f64 = 1.25;

/// Why positions make no problem.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PositionPathError {
    /// The positions make no curve.
    #[error(transparent)]
    Curve(#[from] PositionCurveError),
    /// A setting that must be positive and finite is not, or the speed is outside its limits.
    #[error("setting {setting} is out of range: {value}")]
    Setting {
        /// Name of the field.
        setting: &'static str,
        /// Value found.
        value: f64,
    },
    /// The initial guess is not a path.
    #[error(transparent)]
    Path(#[from] ReferencePathError),
}

/// Terms of one stage at an iterate, derivatives by the right perturbation of its pose and by its input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionStage {
    /// Defect of the step to the next pose of the iterate: an equality constraint.
    pub step: StepResidual,
    /// Weighted residuals: position (3), speed, rotation speed.
    pub residual: SVector<f64, 5>,
    /// 5x6, by the pose.
    pub by_pose: SMatrix<f64, 5, 6>,
    /// 5x2, by (v in mm/s, omega in rad/s).
    pub by_input: SMatrix<f64, 5, 2>,
}

/// The least-squares problem above.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionPathProblem {
    needle: Needle,
    settings: PositionPathSettings,
    curve: PositionCurve,
    targets_mm: Vec<Vector3<f64>>,
    guess: ReferencePath,
}

impl PositionPathProblem {
    /// Poses the problem of following `curve` with `needle`.
    ///
    /// The targets divide the curve into whole steps at the wanted speed or a little less; where
    /// `v_min_mm_s` forbids less, a little more; and where the speed is fixed, they stop short of the
    /// curve's end by less than a step, so that every target can be reached.
    ///
    /// # Errors
    /// [`PositionPathError`] naming the setting that is out of range: `v_min_mm_s` when the curve is
    /// shorter than one step at that speed.
    pub fn new(
        needle: Needle,
        curve: PositionCurve,
        settings: PositionPathSettings,
    ) -> Result<Self, PositionPathError> {
        settings.check()?;
        let (steps, spacing_mm) = equal_steps(curve.length_mm(), &settings)?;
        let covered = steps as f64 * spacing_mm / curve.length_mm();
        let samples = |curve: &PositionCurve| -> Vec<_> {
            let spacing_mm = curve.length_mm() * covered / steps as f64;
            (0..=steps)
                .map(|k| curve.at(k as f64 * spacing_mm))
                .collect()
        };
        let targets_mm: Vec<_> = samples(&curve).iter().map(|p| p.position_mm).collect();
        let points = match gentler_curve(needle, &curve, &targets_mm) {
            Some(gentler) => samples(&gentler),
            None => samples(&curve),
        };
        let poses = spun_poses(
            &points,
            SpinLimits {
                needle_curvature_per_mm: needle.curvature_per_mm(),
                dt_s: settings.dt_s,
                omega_max_rad_s: settings.omega_max_rad_s,
            },
        );
        let rotations = ReferencePath::from_poses(poses.clone(), settings.dt_s)?;
        let inputs = rotations
            .inputs()
            .iter()
            .map(|u| {
                settings.within_limits(Input {
                    v_mm_s: spacing_mm / settings.dt_s,
                    omega_rad_s: u.omega_rad_s,
                })
            })
            .collect();
        Ok(Self {
            needle,
            settings,
            curve,
            targets_mm,
            guess: ReferencePath::from_samples(poses, inputs, settings.dt_s)?,
        })
    }

    /// The needle.
    #[must_use]
    pub fn needle(&self) -> Needle {
        self.needle
    }

    /// Limits and weights.
    #[must_use]
    pub fn settings(&self) -> &PositionPathSettings {
        &self.settings
    }

    /// The curve to follow; [`PositionCurve::curvature_excesses`] says where it bends too much.
    #[must_use]
    pub fn curve(&self) -> &PositionCurve {
        &self.curve
    }

    /// Positions to pass, N + 1, mm.
    #[must_use]
    pub fn targets_mm(&self) -> &[Vector3<f64>] {
        &self.targets_mm
    }

    /// Poses on the curve, turned so that the needle's bending follows it on average, and inputs
    /// within the limits. Its steps have small defects.
    #[must_use]
    pub fn initial_guess(&self) -> &ReferencePath {
        &self.guess
    }

    /// Terms of stage `k` at an iterate `(pose, input, next_pose)`; `None` beyond the last stage.
    ///
    /// # Errors
    /// [`StepError`] when the iterate is not finite.
    pub fn stage(
        &self,
        k: usize,
        pose: &Pose,
        input: Input,
        next_pose: &Pose,
    ) -> Result<Option<PositionStage>, StepError> {
        let Some(guess) = self.guess.inputs().get(k) else {
            return Ok(None);
        };
        let settings = &self.settings;
        let step = self
            .needle
            .step_residual(pose, input, next_pose, settings.dt_s)?;
        let position = position_residual(pose, &self.targets_mm[k]);
        let (w_p, w_v, w_omega) = settings.weights();
        let mut residual = SVector::<f64, 5>::zeros();
        residual
            .fixed_rows_mut::<3>(0)
            .copy_from(&(position.value * w_p));
        residual[3] = (input.v_mm_s - guess.v_mm_s) * w_v;
        residual[4] = (input.omega_rad_s - guess.omega_rad_s) * w_omega;
        let mut by_pose = SMatrix::<f64, 5, 6>::zeros();
        by_pose
            .fixed_view_mut::<3, 6>(0, 0)
            .copy_from(&(position.by_pose * w_p));
        let mut by_input = SMatrix::<f64, 5, 2>::zeros();
        by_input[(3, 0)] = w_v;
        by_input[(4, 1)] = w_omega;
        Ok(Some(PositionStage {
            step,
            residual,
            by_pose,
            by_input,
        }))
    }

    /// Weighted position residual of the last pose.
    #[must_use]
    pub fn terminal(&self, pose: &Pose) -> PointResidual {
        let last = self.targets_mm.len() - 1;
        let residual = position_residual(pose, &self.targets_mm[last]);
        let weight = self.settings.weights().0;
        PointResidual {
            value: residual.value * weight,
            by_pose: residual.by_pose * weight,
        }
    }
}

/// Number of steps along a curve of `length_mm`, and the distance between targets, mm.
fn equal_steps(
    length_mm: f64,
    settings: &PositionPathSettings,
) -> Result<(usize, f64), PositionPathError> {
    let refused = |setting, value| Err(PositionPathError::Setting { setting, value });
    let steps = length_mm / (settings.speed_mm_s * settings.dt_s);
    if steps.is_nan() || steps > MAX_STEPS {
        return refused("speed_mm_s", settings.speed_mm_s);
    }
    // A curve of 12 steps and a rounding error has 12 steps.
    let whole = (steps - ROUNDED_STEPS).ceil().max(1.0);
    let spacing_mm = length_mm / whole;
    let least_mm = settings.v_min_mm_s * settings.dt_s;
    if spacing_mm >= least_mm * (1.0 - ROUNDED_STEPS) {
        return Ok((whole as usize, spacing_mm));
    }
    let fewer = (length_mm / least_mm + ROUNDED_STEPS).floor();
    if fewer < 1.0 {
        return refused("v_min_mm_s", settings.v_min_mm_s);
    }
    let greatest_mm = settings.v_max_mm_s * settings.dt_s;
    Ok((fewer as usize, (length_mm / fewer).min(greatest_mm)))
}

/// The least smoothed version of a curve that the needle can follow, or else the gentlest, when the
/// curve itself bends too much: a guess near the closest feasible path, from which a local method need
/// not unwind spins.
fn gentler_curve(
    needle: Needle,
    curve: &PositionCurve,
    targets_mm: &[Vector3<f64>],
) -> Option<PositionCurve> {
    let excess_per_mm = |c: &PositionCurve| {
        let excesses = c.curvature_excesses(needle, GUESS_MARGIN);
        excesses.iter().map(|e| e.excess_per_mm).fold(0.0, f64::max)
    };
    let mut least_per_mm = excess_per_mm(curve);
    if needle.curvature_per_mm() == 0.0 || least_per_mm == 0.0 {
        return None;
    }
    let spacing_mm = |c: &PositionCurve| c.length_mm() / (targets_mm.len() - 1) as f64;
    let near_targets = |c: &PositionCurve| {
        let limit_mm = GUESS_DEVIATION * curve.length_mm();
        let mut pairs = targets_mm.iter().enumerate();
        pairs.all(|(k, y)| (c.at(k as f64 * spacing_mm(c)).position_mm - y).norm() < limit_mm)
    };
    let mut gentlest = None;
    let mut smoothing_mm = curve.length_mm() / targets_mm.len() as f64;
    while smoothing_mm < curve.length_mm() && least_per_mm > 0.0 {
        if let Ok(candidate) = PositionCurve::through(targets_mm, smoothing_mm) {
            let excess = excess_per_mm(&candidate);
            if excess < least_per_mm && near_targets(&candidate) {
                least_per_mm = excess;
                gentlest = Some(candidate);
            }
        }
        smoothing_mm *= SMOOTHING_GROWTH;
    }
    gentlest
}
