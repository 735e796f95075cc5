//! A path of constant curvature and torsion as a curve, a plant at half steps, and the distance to the path.

use crate::deviates::Deviates;
use nalgebra::{Vector3, Vector6};
use needle_control::{Controller, Measurement};
use needle_model::{Input, Needle, Pose, ReferencePath};

pub(crate) const DT_S: f64 = 0.1;
const SPEED_MM_S: f64 = 5.0;
const LENGTH_MM: f64 = 100.0;
pub(crate) const CURVATURE_PER_MM: f64 = 1.0 / 150.0;

/// The larger of the differences of speed (mm/s) and spin (rad/s).
pub(crate) fn apart(a: Input, b: Input) -> f64 {
    (a.v_mm_s - b.v_mm_s)
        .abs()
        .max((a.omega_rad_s - b.omega_rad_s).abs())
}

/// A case of the table.
pub(crate) struct Scene {
    pub(crate) model: Needle,
    pub(crate) plant_curvature_factor: f64,
    pub(crate) path_curvature_ratio: f64,
    pub(crate) torsion_rad_per_mm: f64,
    pub(crate) noise_mm: f64,
    pub(crate) start: Pose,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            model: Needle::new(CURVATURE_PER_MM).unwrap(),
            plant_curvature_factor: 1.0,
            path_curvature_ratio: 0.5,
            torsion_rad_per_mm: 0.01,
            noise_mm: 0.0,
            start: Pose::identity(),
        }
    }
}

/// How a closed loop went; distances after the first fifth of the path.
#[derive(Debug)]
pub(crate) struct Score {
    pub(crate) rms_mm: f64,
    pub(crate) max_mm: f64,
    pub(crate) revolutions: f64,
}

impl Scene {
    fn pose_at(&self, s_mm: f64) -> Pose {
        let bend = CURVATURE_PER_MM * self.path_curvature_ratio;
        Pose::exp(&(Vector6::new(0.0, 0.0, 1.0, bend, 0.0, self.torsion_rad_per_mm) * s_mm))
    }

    /// The path as a curve: its frames are the curve's, not a needle's.
    pub(crate) fn path(&self) -> ReferencePath {
        let steps = (LENGTH_MM / (SPEED_MM_S * DT_S)).round() as usize;
        let poses = (0..=steps).map(|k| self.pose_at(k as f64 * SPEED_MM_S * DT_S));
        ReferencePath::from_poses(poses.collect(), DT_S).unwrap()
    }

    /// Distance of a point from the curve, mm: Newton steps from the arc length `near_mm`.
    fn distance_mm(&self, point_mm: &Vector3<f64>, near_mm: f64) -> f64 {
        let mut s_mm = near_mm;
        for _ in 0..20 {
            let pose = self.pose_at(s_mm);
            s_mm += (point_mm - pose.position_mm).dot(&pose.tangent());
        }
        (point_mm - self.pose_at(s_mm).position_mm).norm()
    }
}

/// Runs a controller to the end of the path.
pub(crate) fn run(controller: &mut impl Controller, scene: &Scene) -> Score {
    let plant = Needle::new(CURVATURE_PER_MM * scene.plant_curvature_factor).unwrap();
    let (mut pose, mut noise) = (scene.start, Deviates::seeded(1));
    let steps = (LENGTH_MM / (SPEED_MM_S * DT_S)).round() as usize;
    let (mut squares, mut count, mut max_mm, mut turned_rad) = (0.0, 0.0, 0.0_f64, 0.0);
    for step in 0..steps {
        let mut measured = pose;
        measured.position_mm += noise.normals() * scene.noise_mm;
        let input = controller
            .step(&Measurement::of(measured), step as f64 * DT_S)
            .input;
        for _ in 0..2 {
            pose = plant.step(&pose, input, 0.5 * DT_S).unwrap();
        }
        turned_rad += input.omega_rad_s.abs() * DT_S;
        if step >= steps / 5 {
            let distance = scene.distance_mm(&pose.position_mm, (step + 1) as f64 * 0.5);
            squares += distance * distance;
            count += 1.0;
            max_mm = max_mm.max(distance);
        }
    }
    Score {
        rms_mm: f64::sqrt(squares / count),
        max_mm,
        revolutions: turned_rad / std::f64::consts::TAU,
    }
}
