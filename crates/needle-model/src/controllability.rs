//! Which tip errors a needle can correct, to first order, near a reference input or along a window of
//! inputs.
//!
//! Around a constant input the left-invariant error obeys a time-invariant pair: in continuous time
//! (-ad_V, [V1 V2]). Its controllability matrix is judged by singular values after scaling lengths by
//! L = |v| / |w| and times by T = 1 / |w|, |w| = hypot(kappa v, omega): then only the angle between
//! kappa v and omega is left, and the answer does not depend on units. Along a window the columns are
//! those of the discrete controllability matrix, whose squares are the Gramian. Not covered: input
//! limits, and sampling that hits a multiple of half a turn.

use nalgebra::{DMatrix, Matrix6, Vector6};
use thiserror::Error;

use crate::error_direction::{ErrorDirection, sparse_basis};
use crate::needle::{Input, Needle, StepError, check_step};
use crate::se3::ad;

/// Iterations granted to the singular value decomposition of a 6x6 matrix, which takes some 20.
const SVD_ITERATIONS: usize = 1000;

/// Singular values below this fraction of the largest do not count towards the dimension. Rounding
/// leaves some 1e-16; the weakest direction of a nearly planar helix is about |omega| / (kappa v).
pub const RANK_TOLERANCE: f64 = 1e-9;

/// Distance of the rate ratio from 0 and 1 below which the report warns.
const RATIO_MARGIN: f64 = 0.1;

/// Smallest counted singular value, as a fraction of the largest, below which the report warns.
const WEAK_FRACTION: f64 = 1e-2;

/// Why a reference that is controllable in exact arithmetic may not be controllable in practice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ControllabilityWarning {
    /// |omega| is small against kappa v: nearly a planar arc, whose in-plane errors cannot be
    /// corrected. A Riccati solution exists and is huge.
    NearPlanarArc {
        /// Largest |omega| / (kappa |v|).
        rate_ratio: f64,
    },
    /// |omega| is close to kappa v, where one dimension is lost.
    NearEqualRates {
        /// |omega| / (kappa |v|) farthest from 1.
        rate_ratio: f64,
    },
    /// The weakest controllable direction is far weaker than the strongest.
    Weak {
        /// Smallest counted singular value divided by the largest.
        fraction: f64,
    },
}

/// Why there is no report.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ControllabilityError {
    /// A window needs at least one input.
    #[error("a controllability window needs at least one input")]
    EmptyWindow,
    /// An input of the window cannot be stepped.
    #[error("stage {stage}: {source}")]
    Stage {
        /// Index of the stage.
        stage: usize,
        /// What is wrong with it.
        source: StepError,
    },
    /// The inputs are so large or so unequal that scaling them overflows.
    #[error("the inputs cannot be scaled within double precision")]
    Scaling,
}

/// Which errors can be corrected.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllabilityReport {
    /// Dimension of the controllable subspace, 0 to 6.
    pub dimension: usize,
    /// Singular values of the scaled controllability matrix, largest first.
    pub singular_values: Vector6<f64>,
    /// Basis of the directions that no input can correct.
    pub uncontrollable: Vec<ErrorDirection>,
    /// The direction of the smallest singular value that counts; the costliest to correct. `None`
    /// when nothing is controllable.
    pub weakest: Option<ErrorDirection>,
    /// Warnings; empty when the reference is well controllable.
    pub warnings: Vec<ControllabilityWarning>,
    /// Length L by which the linear errors were divided, mm.
    pub length_scale_mm: f64,
}

impl ControllabilityReport {
    /// Report for a constant reference input.
    ///
    /// # Errors
    /// [`ControllabilityError`] when the input is not finite or too extreme to scale.
    pub fn of_reference_input(needle: Needle, input: Input) -> Result<Self, ControllabilityError> {
        check_step(true, input, 0.0)
            .map_err(|source| ControllabilityError::Stage { stage: 0, source })?;
        let scale = Scale::of(needle, &[input]);
        // In the new units the twist is (v T / L, w T), and -ad of it drives the error.
        let mut twist = needle.twist(input) * scale.time_s;
        twist[2] /= scale.length_mm;
        let drift = -ad(&twist);
        let mut columns = DMatrix::zeros(12, 6);
        let v1 = Vector6::new(
            0.0,
            0.0,
            1.0,
            needle.curvature_per_mm() * scale.length_mm,
            0.0,
            0.0,
        );
        let mut powers = [v1, Vector6::ith(5, 1.0)];
        for row in (0..12).step_by(2) {
            for (i, power) in powers.iter_mut().enumerate() {
                columns.set_row(row + i, &power.transpose());
                *power = drift * *power;
            }
        }
        Self::from_rows(columns, scale, rate_warning(needle, &[input]))
    }

    /// Report for a window of inputs, each held for `dt_s`: what the inputs can do to the error at
    /// the window's end, in its body frame. The squared singular values are those of the Gramian.
    ///
    /// # Errors
    /// [`ControllabilityError`] when the window is empty, or an input is not finite or too extreme
    /// to scale.
    pub fn over_window(
        needle: Needle,
        inputs: &[Input],
        dt_s: f64,
    ) -> Result<Self, ControllabilityError> {
        if inputs.is_empty() {
            return Err(ControllabilityError::EmptyWindow);
        }
        for (stage, &input) in inputs.iter().enumerate() {
            check_step(true, input, dt_s)
                .map_err(|source| ControllabilityError::Stage { stage, source })?;
        }
        let scale = Scale::of(needle, inputs);
        let unit = scale.diagonal();
        let mut columns = DMatrix::zeros((2 * inputs.len()).max(6), 6);
        let mut to_end = Matrix6::identity();
        for (stage, &input) in inputs.iter().enumerate().rev() {
            let jacobians = needle
                .linearise(input, dt_s)
                .map_err(|source| ControllabilityError::Stage { stage, source })?;
            let b = unit * to_end * jacobians.b;
            let by_v = b.column(0) * (scale.length_mm / scale.time_s);
            let by_omega = b.column(1) / scale.time_s;
            columns.set_row(2 * stage, &by_v.transpose());
            columns.set_row(2 * stage + 1, &by_omega.transpose());
            to_end *= jacobians.a;
        }
        Self::from_rows(columns, scale, rate_warning(needle, inputs))
    }

    /// Judges the transposed controllability matrix (rows: one input at one stage).
    fn from_rows(
        rows: DMatrix<f64>,
        scale: Scale,
        rate: Option<ControllabilityWarning>,
    ) -> Result<Self, ControllabilityError> {
        if !rows.iter().all(|x| x.is_finite()) {
            return Err(ControllabilityError::Scaling);
        }
        // Only the triangular factor matters: it has the same right singular vectors.
        let triangular = rows.qr().r();
        let triangular: Matrix6<f64> = triangular.fixed_view::<6, 6>(0, 0).into_owned();
        let svd = triangular
            .try_svd(false, true, f64::EPSILON, SVD_ITERATIONS)
            .ok_or(ControllabilityError::Scaling)?;
        let directions = svd.v_t.unwrap_or_else(Matrix6::identity);
        let singular_values = svd.singular_values;
        let largest = singular_values[0];
        let dimension = singular_values
            .iter()
            .filter(|&&s| s > RANK_TOLERANCE * largest && s > 0.0)
            .count();
        let null: Vec<Vector6<f64>> = (dimension..6)
            .map(|i| directions.row(i).transpose())
            .collect();
        let length_mm = scale.length_mm;
        let uncontrollable = sparse_basis(null)
            .iter()
            .map(|v| ErrorDirection::from_scaled(v, length_mm))
            .collect();
        let mut warnings: Vec<_> = rate.into_iter().collect();
        let mut weakest = None;
        if dimension > 0 {
            let fraction = singular_values[dimension - 1] / largest;
            if fraction < WEAK_FRACTION {
                warnings.push(ControllabilityWarning::Weak { fraction });
            }
            let direction = directions.row(dimension - 1).transpose();
            weakest = Some(ErrorDirection::from_scaled(&direction, length_mm));
        }
        Ok(Self {
            dimension,
            singular_values,
            uncontrollable,
            weakest,
            warnings,
            length_scale_mm: length_mm,
        })
    }
}

/// Units in which the pair has entries of order one.
#[derive(Debug, Clone, Copy)]
struct Scale {
    length_mm: f64,
    time_s: f64,
}

impl Scale {
    fn of(needle: Needle, inputs: &[Input]) -> Self {
        let kappa = needle.curvature_per_mm();
        let count = inputs.len() as f64;
        let speed_mm_s = inputs.iter().map(|u| u.v_mm_s.abs()).sum::<f64>() / count;
        let turn_rad_s = inputs
            .iter()
            .map(|u| (kappa * u.v_mm_s).hypot(u.omega_rad_s))
            .sum::<f64>()
            / count;
        let length_mm = match (speed_mm_s > 0.0 && turn_rad_s > 0.0, kappa > 0.0) {
            (true, _) => speed_mm_s / turn_rad_s,
            (false, true) => 1.0 / kappa,
            (false, false) => 1.0,
        };
        let time_s = if turn_rad_s > 0.0 {
            1.0 / turn_rad_s
        } else if speed_mm_s > 0.0 {
            length_mm / speed_mm_s
        } else {
            1.0
        };
        Self { length_mm, time_s }
    }

    /// diag(1/L, 1/L, 1/L, 1, 1, 1).
    fn diagonal(self) -> Matrix6<f64> {
        let s = 1.0 / self.length_mm;
        Matrix6::from_diagonal(&Vector6::new(s, s, s, 1.0, 1.0, 1.0))
    }
}

/// Warning from the ratio |omega| / (kappa |v|) of every input, when all inputs share it.
fn rate_warning(needle: Needle, inputs: &[Input]) -> Option<ControllabilityWarning> {
    let ratios: Vec<f64> = inputs
        .iter()
        .map(|u| u.omega_rad_s.abs() / (needle.curvature_per_mm() * u.v_mm_s.abs()))
        // Neither a straight needle nor one at rest has a ratio.
        .filter(|ratio| ratio.is_finite())
        .collect();
    let largest = ratios.iter().copied().reduce(f64::max)?;
    if largest < RATIO_MARGIN {
        return Some(ControllabilityWarning::NearPlanarArc {
            rate_ratio: largest,
        });
    }
    let farthest = ratios.iter().copied().reduce(|a, b| {
        if (b - 1.0).abs() > (a - 1.0).abs() {
            b
        } else {
            a
        }
    })?;
    ((farthest - 1.0).abs() < RATIO_MARGIN).then_some(ControllabilityWarning::NearEqualRates {
        rate_ratio: farthest,
    })
}
