//! The plant of a scenario: the needle on SE(3) with the effects of a real one, integrated finer than the loop, disturbed.
//!
//! It shares no object with the controller. Disturbances of the tissue are random walks along the inserted length; the driver's
//! noise is drawn once a sample.

use crate::random::{Purpose, Stream};
use crate::scenario::{Disturbances, PlantTorsion, Scenario, StartOffset};
use nalgebra::{Vector3, Vector6};
use needle_model::{
    BevelOffset, CurvatureProfile, CurvatureProfileError, Input, InvalidTorsion, PhysicalNeedle,
    PhysicalState, Pose, StaticWindUp, StepError, Torsion, TorsionalLag,
};

/// Why a scenario has no plant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// The curvature along the needle.
    #[error(transparent)]
    Curvature(#[from] CurvatureProfileError),
    /// The torsion of the shaft.
    #[error(transparent)]
    Torsion(#[from] InvalidTorsion),
}

/// Least curvature of a run whose curvature is drawn at random, as a fraction of the mean: none bends the other way.
const LEAST_CURVATURE: f64 = 0.0;

/// The needle of one run.
#[derive(Debug)]
pub(crate) struct SimulatedNeedle {
    needle: PhysicalNeedle,
    state: PhysicalState,
    disturbances: Disturbances,
    substeps: u64,
    substep_s: f64,
    tissue: Stream,
    driver: Stream,
}

impl SimulatedNeedle {
    /// At the entry: `start` is the first pose of the path.
    pub(crate) fn new(
        scenario: &Scenario,
        run_index: u64,
        start: &Pose,
    ) -> Result<Self, PlantError> {
        let stream = |purpose| Stream::new(scenario.seed, run_index, purpose);
        let plant = &scenario.plant;
        let scatter =
            plant.disturbances.curvature_std_fraction * stream(Purpose::Curvature).normal();
        let curvature_per_mm = scenario.curvature_per_mm
            * plant.curvature_factor
            * (1.0 + scatter).max(LEAST_CURVATURE);
        let mut knots: Vec<(f64, f64)> = plant
            .curvature_profile
            .iter()
            .map(|knot| (knot.depth_mm, knot.factor * curvature_per_mm))
            .collect();
        if knots.is_empty() {
            knots.push((0.0, curvature_per_mm));
        }
        let needle = PhysicalNeedle {
            curvature: CurvatureProfile::new(&knots)?,
            torsion: torsion(plant.torsion)?,
            bevel_offset: BevelOffset {
                offset_mm: plant.bevel_offset_mm,
            },
        };
        let tip = displaced(start, &plant.start, &mut stream(Purpose::Start));
        Ok(Self {
            state: needle.at_entry(&tip),
            needle,
            disturbances: plant.disturbances,
            substeps: plant.substeps,
            substep_s: scenario.dt_s / plant.substeps as f64,
            tissue: stream(Purpose::Tissue),
            driver: stream(Purpose::Driver),
        })
    }

    /// The visible tip.
    pub(crate) fn tip(&self) -> Pose {
        self.needle.tip(&self.state)
    }

    /// What the driver makes of a command.
    pub(crate) fn driven(&mut self, command: Input) -> Input {
        let (v, omega) = (self.driver.normal(), self.driver.normal());
        Input {
            v_mm_s: command.v_mm_s * (1.0 + self.disturbances.v_std_fraction * v),
            omega_rad_s: command.omega_rad_s * (1.0 + self.disturbances.omega_std_fraction * omega),
        }
    }

    /// Holds `input` for one sample; `seen` is called with the tip after each integration step, counted from 1.
    pub(crate) fn hold(
        &mut self,
        input: Input,
        mut seen: impl FnMut(&Pose, u64),
    ) -> Result<(), StepError> {
        for substep in 1..=self.substeps {
            self.state = self.needle.step(&self.state, input, self.substep_s)?;
            self.disturb(input.v_mm_s.abs() * self.substep_s);
            seen(&self.tip(), substep);
        }
        Ok(())
    }

    fn disturb(&mut self, inserted_mm: f64) {
        let Disturbances {
            position_std_mm_per_sqrt_mm: position,
            heading_std_rad_per_sqrt_mm: heading,
            roll_std_rad_per_sqrt_mm: roll,
            ..
        } = self.disturbances;
        if position == 0.0 && heading == 0.0 && roll == 0.0 {
            return;
        }
        let scale = inserted_mm.sqrt();
        let linear = self.tissue.normals() * (scale * position);
        let angular = self
            .tissue
            .normals()
            .component_mul(&Vector3::new(heading, heading, roll));
        self.state.frame = self.state.frame.perturbed(&twist(linear, angular * scale));
    }
}

fn torsion(choice: PlantTorsion) -> Result<Torsion, InvalidTorsion> {
    Ok(match choice {
        PlantTorsion::Rigid => Torsion::Rigid,
        PlantTorsion::FirstOrder { time_constant_s } => {
            Torsion::FirstOrder(TorsionalLag::new(time_constant_s)?)
        }
        PlantTorsion::WindUp {
            angle_rad,
            depth_mm,
        } => Torsion::WindUp(StaticWindUp::at_depth(angle_rad, depth_mm)?),
    })
}

/// The pose moved by the start's offset, its fixed part first.
fn displaced(pose: &Pose, start: &StartOffset, stream: &mut Stream) -> Pose {
    let linear = Vector3::from(start.offset_mm) + stream.normals() * start.offset_std_mm;
    let (tilt, roll) = (start.tilt_std_rad, start.roll_std_rad);
    let random = stream
        .normals()
        .component_mul(&Vector3::new(tilt, tilt, roll));
    let angular = Vector3::from(start.rotation_rad) + random;
    // Position and rotation apart: an offset stays what the scenario says, whatever the rotation.
    let turned = pose.perturbed(&twist(Vector3::zeros(), angular));
    Pose {
        position_mm: pose.position_mm + pose.rotation * linear,
        ..turned
    }
}

fn twist(linear: Vector3<f64>, angular: Vector3<f64>) -> Vector6<f64> {
    let mut twist = Vector6::zeros();
    twist.fixed_rows_mut::<3>(0).copy_from(&linear);
    twist.fixed_rows_mut::<3>(3).copy_from(&angular);
    twist
}
