//! The paper's Euler chart of SE(3): R = Rx(alpha) Ry(beta) Rz(gamma), equation (1), and the
//! conversions to and from [`Pose`]. Singular at beta = +-pi/2; SE(3) is the truth, this is a view.

use std::f64::consts::{PI, TAU};

use nalgebra::{UnitQuaternion, Vector3, Vector6};
use thiserror::Error;

use crate::geometry::pose::Pose;
use crate::plant::needle::StepError;

/// Below this |cos beta| the chart is refused: about 0.06 degrees from the singularity, where an
/// angle rate of the chart is a thousand times the physical one.
pub const CHART_MARGIN: f64 = 1e-3;

/// State of the paper, equation (1): tip position and Euler angles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EulerState {
    /// Tip position, x, mm.
    pub x_mm: f64,
    /// Tip position, y, mm.
    pub y_mm: f64,
    /// Tip position, z, mm.
    pub z_mm: f64,
    /// Rotation about the world's x, rad.
    pub alpha_rad: f64,
    /// Rotation about the once rotated y, rad.
    pub beta_rad: f64,
    /// Rotation about the needle's axis, rad.
    pub gamma_rad: f64,
}

/// Why the chart refused a state.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ChartError {
    /// beta is too near +-pi/2, where alpha and gamma are not defined.
    #[error(
        "Euler chart is singular near beta = pi/2: beta = {beta_rad} rad, |cos beta| < {CHART_MARGIN}"
    )]
    NearSingularity {
        /// The angle found, rad.
        beta_rad: f64,
    },
    /// The step itself was refused.
    #[error(transparent)]
    Step(#[from] StepError),
}

impl EulerState {
    /// From the order of the paper: (x, y, z, alpha, beta, gamma), mm and rad.
    #[must_use]
    pub fn from_vector(v: &Vector6<f64>) -> Self {
        Self {
            x_mm: v[0],
            y_mm: v[1],
            z_mm: v[2],
            alpha_rad: v[3],
            beta_rad: v[4],
            gamma_rad: v[5],
        }
    }

    /// In the order of the paper: (x, y, z, alpha, beta, gamma), mm and rad.
    #[must_use]
    pub fn to_vector(self) -> Vector6<f64> {
        Vector6::new(
            self.x_mm,
            self.y_mm,
            self.z_mm,
            self.alpha_rad,
            self.beta_rad,
            self.gamma_rad,
        )
    }

    /// The pose that this chart point names; defined at the singularity, too.
    #[must_use]
    pub fn to_pose(self) -> Pose {
        let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        Pose {
            rotation: about(Vector3::x_axis(), self.alpha_rad)
                * about(Vector3::y_axis(), self.beta_rad)
                * about(Vector3::z_axis(), self.gamma_rad),
            position_mm: Vector3::new(self.x_mm, self.y_mm, self.z_mm),
        }
    }

    /// Chart point of a pose with beta in (-pi/2, pi/2), alpha and gamma in (-pi, pi].
    ///
    /// # Errors
    /// [`ChartError::NearSingularity`], and [`StepError::NonFiniteState`] for NaN or infinity.
    pub fn from_pose(pose: &Pose) -> Result<Self, ChartError> {
        if !pose.is_finite() {
            return Err(StepError::NonFiniteState.into());
        }
        let r = pose.rotation_matrix();
        // hypot keeps beta accurate near +-pi/2, where asin would lose half the digits.
        let cos_beta = r[(1, 2)].hypot(r[(2, 2)]);
        let beta_rad = r[(0, 2)].atan2(cos_beta);
        if cos_beta < CHART_MARGIN {
            return Err(ChartError::NearSingularity { beta_rad });
        }
        Ok(Self {
            x_mm: pose.position_mm.x,
            y_mm: pose.position_mm.y,
            z_mm: pose.position_mm.z,
            alpha_rad: (-r[(1, 2)]).atan2(r[(2, 2)]),
            beta_rad,
            gamma_rad: (-r[(0, 1)]).atan2(r[(0, 0)]),
        })
    }

    /// Chart point of a pose nearest to `previous`: whole turns are added, and the other of the two
    /// triples of a rotation is taken, so that a sampled trajectory stays continuous.
    ///
    /// # Errors
    /// As [`EulerState::from_pose`], and [`StepError::NonFiniteState`] when `previous` is not finite.
    pub fn from_pose_near(pose: &Pose, previous: &Self) -> Result<Self, ChartError> {
        if !previous.to_vector().sum().is_finite() {
            return Err(StepError::NonFiniteState.into());
        }
        let principal = Self::from_pose(pose)?;
        let flipped = Self {
            alpha_rad: principal.alpha_rad + PI,
            beta_rad: PI - principal.beta_rad,
            gamma_rad: principal.gamma_rad + PI,
            ..principal
        };
        let (a, b) = (principal.unwrapped(previous), flipped.unwrapped(previous));
        let closer = a.angular_distance(previous) <= b.angular_distance(previous);
        Ok(if closer { a } else { b })
    }

    /// Checks that the state is finite and away from the singularity.
    pub(crate) fn check(&self) -> Result<(), ChartError> {
        if !self.to_vector().sum().is_finite() {
            Err(StepError::NonFiniteState.into())
        } else if self.beta_rad.cos().abs() < CHART_MARGIN {
            Err(ChartError::NearSingularity {
                beta_rad: self.beta_rad,
            })
        } else {
            Ok(())
        }
    }

    fn unwrapped(self, previous: &Self) -> Self {
        let near = |angle: f64, target: f64| angle + TAU * ((target - angle) / TAU).round();
        Self {
            alpha_rad: near(self.alpha_rad, previous.alpha_rad),
            beta_rad: near(self.beta_rad, previous.beta_rad),
            gamma_rad: near(self.gamma_rad, previous.gamma_rad),
            ..self
        }
    }

    fn angular_distance(&self, other: &Self) -> f64 {
        (self.alpha_rad - other.alpha_rad).abs()
            + (self.beta_rad - other.beta_rad).abs()
            + (self.gamma_rad - other.gamma_rad).abs()
    }
}
