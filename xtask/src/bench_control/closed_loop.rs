//! One closed loop: the plant at ten steps a sample, the controller once, and what the run is judged by.

use super::cases::{self, Case, CaseError, DT_S, Sensing};
use nalgebra::{Vector3, Vector6};
use needle_control::{Controller, Measurement, NeedleFilter, Observation};
use needle_model::{Input, Pose, ReferencePath};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Steps of the plant in a sample.
const SUBSTEPS: usize = 10;

/// Seed of the sensors' noise.
const SEED: u64 = 3;

/// Judgement of a run; distances from the path after its first fifth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Score {
    pub(super) rms_mm: f64,
    pub(super) max_mm: f64,
    /// Distance of the tip from the end of the path when the run is over.
    pub(super) final_mm: f64,
    pub(super) rotation_rev: f64,
    /// Integral of |omega|, rad.
    pub(super) turned_rad: f64,
    pub(super) median_step: Duration,
    pub(super) worst_step: Duration,
}

/// What the controller is told.
struct Senses {
    sensing: Sensing,
    filter: Option<NeedleFilter>,
    images: VecDeque<(f64, Vector3<f64>, Vector3<f64>)>,
    normal: Normal,
}

impl Senses {
    fn new(sensing: Sensing) -> Result<Self, CaseError> {
        let filter = match sensing {
            Sensing::Pose { .. } => None,
            Sensing::Filter {
                noise_mm,
                noise_rad,
                ..
            } => Some(cases::filter(noise_mm, noise_rad)?),
        };
        Ok(Self {
            sensing,
            filter,
            images: VecDeque::new(),
            normal: Normal(SEED),
        })
    }

    /// What is known at `time_s` of a tip, after `held` was applied.
    fn measure(&mut self, tip: &Pose, held: Input, time_s: f64) -> Measurement {
        let normal = &mut self.normal;
        match (self.sensing, &mut self.filter) {
            (
                Sensing::Filter {
                    noise_mm,
                    noise_rad,
                    late_samples,
                },
                Some(filter),
            ) => {
                if time_s > 0.0 {
                    filter.advance(held, time_s);
                }
                let seen_mm = tip.position_mm + normal.vector() * noise_mm;
                let turn = normal.vector() * noise_rad;
                let turned = tip.perturbed(&Vector6::new(0.0, 0.0, 0.0, turn.x, turn.y, 0.0));
                self.images.push_back((time_s, seen_mm, turned.tangent()));
                while self.images.len() > late_samples {
                    if let Some((taken_at_s, seen_mm, tangent)) = self.images.pop_front() {
                        filter.observe(Observation::Position(seen_mm), taken_at_s);
                        filter.observe(Observation::Tangent(tangent), taken_at_s);
                    }
                }
                filter.measurement()
            }
            (Sensing::Pose { noise_mm }, _) => Measurement::of(Pose {
                position_mm: tip.position_mm + normal.vector() * noise_mm,
                ..*tip
            }),
            (Sensing::Filter { .. }, None) => Measurement::default(),
        }
    }
}

/// Runs for 1.3 times the duration of the path, so that a late controller comes to its end.
pub(super) fn run(case: &Case, controller: &mut dyn Controller) -> Result<Score, CaseError> {
    let mut senses = Senses::new(case.sensing)?;
    let mut state = case.plant.at_entry(&case.start);
    let (path, mut held) = (&case.path, Input::ZERO);
    let length_mm = path.arc_length_mm()[path.inputs().len()];
    let (mut squares, mut count, mut max_mm, mut turned_rad) = (0.0, 0.0, 0.0_f64, 0.0);
    let samples = path.inputs().len() * 13 / 10;
    let mut times = Vec::with_capacity(samples);
    for sample in 0..samples {
        let time_s = sample as f64 * DT_S;
        let measurement = senses.measure(&case.plant.tip(&state), held, time_s);
        let started = Instant::now();
        held = controller.step(&measurement, time_s).input;
        times.push(started.elapsed());
        for _ in 0..SUBSTEPS {
            state = case.plant.step(&state, held, DT_S / SUBSTEPS as f64)?;
        }
        turned_rad += held.omega_rad_s.abs() * DT_S;
        if state.inserted_mm > 0.2 * length_mm && held.v_mm_s > 0.0 {
            let distance_mm = distance_mm(path, &case.plant.tip(&state).position_mm);
            squares += distance_mm * distance_mm;
            count += 1.0;
            max_mm = max_mm.max(distance_mm);
        }
    }
    times.sort();
    let end_mm = path.poses()[path.inputs().len()].position_mm;
    Ok(Score {
        rms_mm: (squares / f64::max(count, 1.0)).sqrt(),
        max_mm,
        final_mm: (case.plant.tip(&state).position_mm - end_mm).norm(),
        rotation_rev: turned_rad / std::f64::consts::TAU,
        turned_rad,
        median_step: times.get(times.len() / 2).copied().unwrap_or_default(),
        worst_step: times.last().copied().unwrap_or_default(),
    })
}

/// Distance of a point from the path's curve: from the arcs between its samples, not their chords.
fn distance_mm(path: &ReferencePath, point_mm: &Vector3<f64>) -> f64 {
    let poses = path.poses();
    let nearest = (0..poses.len())
        .min_by(|&a, &b| {
            let to = |k: usize| (poses[k].position_mm - point_mm).norm_squared();
            to(a).total_cmp(&to(b))
        })
        .unwrap_or(0);
    let mut time_s = nearest as f64 * path.dt_s();
    let speed_mm_s = path
        .inputs()
        .get(nearest.min(path.inputs().len().saturating_sub(1)))
        .map_or(1.0, |u| u.v_mm_s.abs().max(1e-3));
    for _ in 0..5 {
        let pose = path.pose_at_time(time_s);
        let ahead_mm = (point_mm - pose.position_mm).dot(&pose.tangent());
        // Within the neighbouring samples: near its end a path slows down, and a slow path is no measure of time.
        let correction_s = (ahead_mm / speed_mm_s).clamp(-path.dt_s(), path.dt_s());
        time_s = (time_s + correction_s).clamp(0.0, path.duration_s());
    }
    (point_mm - path.pose_at_time(time_s).position_mm).norm()
}

/// Deterministic normal deviates: SplitMix64 and the Box-Muller transform.
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| {
            let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
            radius * (std::f64::consts::TAU * self.uniform()).cos()
        })
    }
}
