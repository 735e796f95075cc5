//! A Gaussian belief on SE(3) x curvature x lag: prediction and correction.
//!
//! The error is x = (log(g^-1 g_true), kappa_true - kappa, lag_true - lag). It is left-invariant, so the prediction
//! P+ = A P A' + Q dt is exact in its pose block whatever the pose (A from [`LaggedState::linearise`]); a correction
//! x^ is put into the state by g exp(x^) and the covariance follows the new origin through J_r(x^). Source of the
//! method: J. Sola, "Quaternion kinematics for the error-state Kalman filter", 2017, with the SE(3) operators of
//! [`needle_model::se3`].

use crate::estimator::observation::Innovation;
use crate::estimator::settings::{FilterError, FilterSettings};
use nalgebra::{SMatrix, SVector, Vector6};
use needle_model::{Input, LaggedState, Needle, Pose, StepError, TorsionalLag, se3};

/// Size of the error: pose 6, curvature, lag.
pub const ERROR_DIMENSION: usize = 8;
/// Index of the roll in the error.
pub const ROLL: usize = 5;
/// Index of the curvature in the error.
pub const CURVATURE: usize = 6;
/// Index of the lag in the error.
pub const LAG: usize = 7;

type Error = SVector<f64, ERROR_DIMENSION>;
type Square = SMatrix<f64, ERROR_DIMENSION, ERROR_DIMENSION>;

/// Linearisations of one observation; the third moves the mean by less than 1e-3 of its standard deviation at entry.
const GAUSS_NEWTON_ROUNDS: usize = 3;
/// Longest step over which process noise is added at once, s.
const NOISE_STEP_S: f64 = 0.1;
/// A gap is predicted in at most this many steps.
const MAX_NOISE_STEPS: f64 = 32.0;

/// Mean and covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief {
    /// The estimate.
    pub state: LaggedState,
    /// Covariance of the error (linear mm, angular rad, curvature 1/mm, lag rad), 8x8.
    pub covariance: SMatrix<f64, ERROR_DIMENSION, ERROR_DIMENSION>,
}

/// What a correction did.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Correction {
    pub(crate) nis: f64,
    pub(crate) accepted: bool,
    /// Logarithm of the innovation's density, up to a constant.
    pub(crate) log_likelihood: f64,
}

impl Belief {
    /// A belief with independent errors of these standard deviations, in the order of the error.
    #[must_use]
    pub fn independent(state: LaggedState, std: &SVector<f64, ERROR_DIMENSION>) -> Self {
        Self {
            state,
            covariance: SMatrix::from_diagonal(&std.component_mul(std)),
        }
    }

    pub(crate) fn validate(&self) -> Result<(), FilterError> {
        let p = &self.covariance;
        if !(self.state.pose.is_finite() && self.state.lag_rad.is_finite()) {
            return Err(FilterError::NonFiniteBelief);
        }
        let symmetric = (p - p.transpose()).amax() <= 1e-9 * p.amax();
        match symmetric && p.sum().is_finite() && p.cholesky().is_some() {
            true => Ok(()),
            false => Err(FilterError::Covariance),
        }
    }

    /// Normalised error squared of a true state: chi-square distributed with 8 degrees of freedom when the belief is
    /// consistent. `None` where the covariance is singular.
    #[must_use]
    pub fn nees(&self, truth: &LaggedState) -> Option<f64> {
        let mut error = Error::zeros();
        let pose_error = truth.pose.error_from(&self.state.pose);
        error.fixed_rows_mut::<6>(0).copy_from(&pose_error);
        error[CURVATURE] = truth.needle.curvature_per_mm() - self.state.needle.curvature_per_mm();
        error[LAG] = truth.lag_rad - self.state.lag_rad;
        let factor = self.covariance.cholesky()?;
        Some(error.dot(&factor.solve(&error)))
    }

    /// After `input`, given at the base, is held for `dt_s`.
    pub(crate) fn predict(
        &mut self,
        settings: &FilterSettings,
        torsion: TorsionalLag,
        input: Input,
        dt_s: f64,
    ) -> Result<(), StepError> {
        if dt_s <= 0.0 {
            return Ok(());
        }
        let steps = (dt_s / NOISE_STEP_S - 1e-6)
            .ceil()
            .clamp(1.0, MAX_NOISE_STEPS);
        let step_s = dt_s / steps;
        let noise = process_variance(settings) * step_s;
        for _ in 0..steps as usize {
            let a = self.state.linearise(torsion, input, step_s)?.a;
            self.state = self.state.step(torsion, input, step_s)?;
            self.covariance = a * self.covariance * a.transpose();
            self.covariance += SMatrix::from_diagonal(&noise);
        }
        self.symmetrise();
        Ok(())
    }

    /// Takes in what `observed` says, unless the normalised square of its innovation is beyond `gate`. The innovation is
    /// linearised again at the corrected mean (Gauss-Newton on the posterior): position and roll are both uncertain at
    /// entry, and the product of their errors would otherwise pass for information.
    pub(crate) fn correct<const D: usize>(
        &mut self,
        observed: impl Fn(&Pose) -> Innovation<D>,
        gate: f64,
    ) -> Correction {
        let mut error = Error::zeros();
        let mut refused = Correction {
            nis: f64::INFINITY,
            accepted: false,
            log_likelihood: -0.5 * gate,
        };
        let mut accepted = None;
        for round in 0..GAUSS_NEWTON_ROUNDS {
            let xi = error.fixed_rows::<6>(0).into_owned();
            let local = observed(&self.state.pose.perturbed(&xi));
            let h = local.h * right_jacobian(&xi);
            let noise = SMatrix::<f64, D, D>::identity() * local.variance;
            let ph = self.covariance * h.transpose();
            let Some(factor) = (h * ph + noise).cholesky() else {
                return refused;
            };
            if round == 0 {
                refused.nis = local.residual.dot(&factor.solve(&local.residual));
                let diagonal = factor.l_dirty().diagonal();
                let log_determinant: f64 = diagonal.iter().map(|d| d.ln()).sum();
                // The gate bounds what one outlier can say against a hypothesis.
                refused.log_likelihood = -0.5 * refused.nis.min(gate) - log_determinant;
                if refused.nis > gate || refused.nis.is_nan() {
                    return refused;
                }
            }
            let gain = factor.solve(&ph.transpose()).transpose();
            error = gain * (local.residual + h * error);
            let left = Square::identity() - gain * h;
            let covariance = left * self.covariance * left.transpose()
                + gain * gain.transpose() * local.variance;
            accepted = Some(covariance);
        }
        let mut corrected = *self;
        if let Some(covariance) = accepted {
            corrected.covariance = covariance;
            corrected.inject(&error);
        }
        if !corrected.is_sound() {
            return refused;
        }
        *self = corrected;
        Correction {
            accepted: true,
            ..refused
        }
    }

    /// Moves the mean by an error and the covariance to its new origin.
    fn inject(&mut self, error: &Error) {
        let xi = error.fixed_rows::<6>(0).into_owned();
        let curvature = self.state.needle.curvature_per_mm() + error[CURVATURE];
        self.state = LaggedState {
            pose: self.state.pose.perturbed(&xi),
            needle: Needle::new(curvature.max(0.0)).unwrap_or(self.state.needle),
            lag_rad: self.state.lag_rad + error[LAG],
        };
        let reset = right_jacobian(&xi);
        self.covariance = reset * self.covariance * reset.transpose();
        self.symmetrise();
    }

    /// Widens position, heading and roll, so that an observation this far off becomes credible.
    pub(crate) fn widen(&mut self, distance_mm: f64, angle_rad: f64) {
        for i in 0..3 {
            self.covariance[(i, i)] += distance_mm * distance_mm;
            self.covariance[(i + 3, i + 3)] += angle_rad * angle_rad;
        }
    }

    /// Whether mean and covariance are finite and no variance is negative.
    pub(crate) fn is_sound(&self) -> bool {
        let p = &self.covariance;
        self.state.pose.is_finite()
            && self.state.lag_rad.is_finite()
            && p.sum().is_finite()
            && p.diagonal().iter().all(|&variance| variance >= 0.0)
    }

    fn symmetrise(&mut self) {
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }
}

/// J_r of the pose block, one for curvature and lag: 8x8.
fn right_jacobian(xi: &Vector6<f64>) -> Square {
    let mut jacobian = Square::identity();
    jacobian
        .fixed_view_mut::<6, 6>(0, 0)
        .copy_from(&se3::right_jacobian(xi));
    jacobian
}

/// Variances added in one second, in the order of the error.
fn process_variance(settings: &FilterSettings) -> Error {
    let n = &settings.process;
    let std = [
        n.position_mm,
        n.position_mm,
        n.position_mm,
        n.heading_rad,
        n.heading_rad,
        n.roll_rad,
        n.curvature_per_mm,
        n.lag_rad,
    ];
    SVector::from(std.map(|s| s * s))
}
