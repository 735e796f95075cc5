//! What a run leaves behind: a row a step for pictures, one flat row for campaigns. Plain numbers, for JSON and tables.

use lqr::Certificate;
use nalgebra::{Quaternion, UnitQuaternion};
use needle_control::{Origin, StopReason, TerminalRegion};
use needle_model::{Input, Pose};
use serde::{Deserialize, Serialize};

/// A pose in plain numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseRecord {
    /// Position in the world frame, mm.
    pub position_mm: [f64; 3],
    /// Rotation from body to world as a unit quaternion (w, x, y, z). Body z is the tangent, body -y the bevel's side.
    pub quaternion_wxyz: [f64; 4],
}

/// An input in plain numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct InputRecord {
    /// Insertion speed, mm/s.
    pub v_mm_s: f64,
    /// Spin of the base, rad/s.
    pub omega_rad_s: f64,
}

/// A reading of the sensors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReadingRecord {
    /// When it was taken, s.
    pub taken_at_s: f64,
    /// Position of the tip, mm.
    pub position_mm: [f64; 3],
    /// Direction of the tip, where it is measured.
    pub tangent: Option<[f64; 3]>,
}

/// Where an input came from, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OriginRecord {
    /// First input of an optimal plan.
    Optimal,
    /// An explicit law.
    Law,
    /// An optimal plan that violates soft constraints.
    Degraded,
    /// An earlier plan, shifted.
    ShiftedPlan,
    /// A stop at the end of the path.
    StopPathEnd,
    /// A stop after the path's time, short of its end.
    StopOutOfTime,
    /// A stop for want of a plan.
    StopNoPlan,
    /// A stop for want of a measurement.
    StopNoMeasurement,
}

/// One sample of the loop: the needle as it is, what the controller saw, and what it decided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Samples since the start.
    pub step: usize,
    /// Time since the start, s.
    pub time_s: f64,
    /// The visible tip as it is.
    pub tip: PoseRecord,
    /// The newest reading that arrived at this sample; `None` where none did.
    pub measured: Option<ReadingRecord>,
    /// The pose that the controller was given; `None` where it had to do without.
    pub estimated: Option<PoseRecord>,
    /// Curvature that the controller was given, 1/mm.
    pub estimated_curvature_per_mm: Option<f64>,
    /// Nearest point of the path, orientation of the sample before it.
    pub reference: PoseRecord,
    /// Input that the controller decided on, held until the next sample.
    pub input: InputRecord,
    /// What the driver made of it; differs from `input` by the driver's noise.
    pub base_input: InputRecord,
    /// Where the input came from.
    pub origin: OriginRecord,
    /// Distance of the tip to the path, mm.
    pub distance_mm: f64,
    /// Arc length of the nearest point of the path, mm.
    pub progress_mm: f64,
    /// Solver iterations.
    pub iterations: usize,
    /// Wall time of the controller's step, us.
    pub step_us: f64,
    /// Positions that the controller expects from now on, the present one first, one a sample; empty without a prediction.
    pub predicted_mm: Vec<[f64; 3]>,
    /// Where the controller's terminal set wants the tip at the end of that prediction; `None` without a set or a prediction.
    #[serde(default)]
    pub terminal: Option<EllipsoidRecord>,
}

/// An ellipsoid { centre + a d_1 + b d_2 + c d_3 : |d| <= 1 } of positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EllipsoidRecord {
    /// Centre in the world frame, mm.
    pub centre_mm: [f64; 3],
    /// Half-axes a, b, c in the world frame, mm.
    pub half_axes_mm: [[f64; 3]; 3],
}

/// One row of a campaign. All of it but the two times is a function of the scenario and the run's index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunSummary {
    /// Index of the run.
    pub run_index: u64,
    /// Seed of the scenario.
    pub seed: u64,
    /// Samples of the loop.
    pub steps: u64,
    /// How the run ended: `finished` at the end of the path, `duration_over`, `plant_failed`.
    pub status: String,
    /// Whether the last tip is within 1 mm of the path's end, at rest or not, and every one after the first fifth within 1 mm of the path.
    pub success: bool,
    /// Root mean square distance to the path after its first fifth, mm; `None` where the tip never got there.
    pub rms_mm: Option<f64>,
    /// Distance that 95 % of the samples after the first fifth stay below, mm.
    pub p95_mm: Option<f64>,
    /// Largest distance after the first fifth, mm.
    pub max_mm: Option<f64>,
    /// Distance of the last tip to the end of the path, mm.
    pub final_mm: f64,
    /// Arc length of the path that was covered, mm.
    pub progress_mm: f64,
    /// Rotation of the base, either way, in revolutions.
    pub rotation_rev: f64,
    /// The same as the integral of |omega| over time, rad.
    pub omega_integral_rad: f64,
    /// Samples answered by a plan that violates soft constraints.
    pub degraded_steps: u64,
    /// Samples answered by an earlier plan.
    pub shifted_plan_steps: u64,
    /// Samples of a stop for want of a plan.
    pub no_plan_steps: u64,
    /// Samples of a stop for want of a measurement.
    pub no_measurement_steps: u64,
    /// Solver iterations, all samples.
    pub iterations: u64,
    /// Median wall time of the controller's step, us. Depends on the machine.
    pub step_median_us: f64,
    /// Longest wall time of the controller's step, us. Depends on the machine.
    pub step_worst_us: f64,
}

/// The path of a run in plain numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceRecord {
    /// Time between two poses, s.
    pub dt_s: f64,
    /// Poses.
    pub poses: Vec<PoseRecord>,
    /// Inputs, one fewer.
    pub inputs: Vec<InputRecord>,
}

/// A whole run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The scenario as TOML with every key written out; [`crate::Scenario::parse`] reads it.
    pub scenario_toml: String,
    /// Index of the run.
    pub run_index: u64,
    /// The path.
    pub reference: ReferenceRecord,
    /// One row a sample.
    pub steps: Vec<StepRecord>,
    /// The run in one row.
    pub summary: RunSummary,
    /// What is claimed of the controller's terminal ingredients, check by check.
    pub certificate: Option<Certificate>,
}

impl From<&Pose> for PoseRecord {
    fn from(pose: &Pose) -> Self {
        let q = pose.rotation.quaternion();
        Self {
            position_mm: pose.position_mm.into(),
            quaternion_wxyz: [q.w, q.i, q.j, q.k],
        }
    }
}

impl From<TerminalRegion> for EllipsoidRecord {
    fn from(region: TerminalRegion) -> Self {
        Self {
            centre_mm: region.centre_mm.into(),
            half_axes_mm: region.half_axes_mm.into(),
        }
    }
}

impl From<Input> for InputRecord {
    fn from(input: Input) -> Self {
        Self {
            v_mm_s: input.v_mm_s,
            omega_rad_s: input.omega_rad_s,
        }
    }
}

impl OriginRecord {
    /// The word of the data files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Optimal => "optimal",
            Self::Law => "law",
            Self::Degraded => "degraded",
            Self::ShiftedPlan => "shifted_plan",
            Self::StopPathEnd => "stop_path_end",
            Self::StopOutOfTime => "stop_out_of_time",
            Self::StopNoPlan => "stop_no_plan",
            Self::StopNoMeasurement => "stop_no_measurement",
        }
    }
}

impl PoseRecord {
    /// The pose.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let [w, x, y, z] = self.quaternion_wxyz;
        Pose {
            position_mm: self.position_mm.into(),
            rotation: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        }
    }
}

impl From<&Origin> for OriginRecord {
    fn from(origin: &Origin) -> Self {
        match origin {
            Origin::Optimal => Self::Optimal,
            Origin::Law => Self::Law,
            Origin::Degraded { .. } => Self::Degraded,
            Origin::ShiftedPlan { .. } => Self::ShiftedPlan,
            Origin::Stop { reason } => match reason {
                StopReason::PathEnd => Self::StopPathEnd,
                StopReason::OutOfTime => Self::StopOutOfTime,
                StopReason::NoPlan => Self::StopNoPlan,
                StopReason::NoMeasurement => Self::StopNoMeasurement,
            },
        }
    }
}
