//! A plant integrated ten times finer than the loop, the path of the benchmark and the distance to it.
#![allow(
    dead_code,
    reason = "shared by tests and by the tuning study, which use different parts"
)]

use nalgebra::{Vector3, Vector6};
use needle_control::{Controller, InputLimits, Measurement};
use needle_model::{CurvatureProfile, Input, Needle, PhysicalNeedle, Pose, ReferencePath};

pub(crate) const DT_S: f64 = 0.1;
pub(crate) const KAPPA_PER_MM: f64 = 1.0 / 150.0;
const SUBSTEPS: usize = 10;

pub(crate) fn needle() -> Needle {
    Needle::new(KAPPA_PER_MM).unwrap()
}

/// A plant whose curvature is `factor` times the model's.
pub(crate) fn plant(factor: f64) -> PhysicalNeedle {
    PhysicalNeedle {
        curvature: CurvatureProfile::constant(Needle::new(factor * KAPPA_PER_MM).unwrap()),
        ..needle().into()
    }
}

/// 100 mm at 5 mm/s with curvature `share * kappa` and torsion 0.01 rad/mm: a path, not an executable reference.
pub(crate) fn bent_path(share: f64) -> ReferencePath {
    let follower = Needle::new(share * KAPPA_PER_MM).unwrap();
    rolled_out(follower, 0.05)
}

/// 100 mm at 5 mm/s that the needle itself executes while it spins at `omega_rad_s`.
pub(crate) fn helix_path(omega_rad_s: f64) -> ReferencePath {
    rolled_out(needle(), omega_rad_s)
}

fn rolled_out(needle: Needle, omega_rad_s: f64) -> ReferencePath {
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s,
    };
    ReferencePath::from_inputs(needle, Pose::identity(), vec![input; 200], DT_S).unwrap()
}

/// What a run is judged by; distances to the path after its first fifth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tracking {
    pub(crate) rms_mm: f64,
    /// As `rms_mm`, over the second half of the path.
    pub(crate) late_rms_mm: f64,
    pub(crate) max_mm: f64,
    pub(crate) final_mm: f64,
    pub(crate) revolutions: f64,
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, x: f64) {
        self.sum += x;
        self.count += 1.0;
    }

    fn root(&self) -> f64 {
        (self.sum / f64::max(self.count, 1.0)).sqrt()
    }
}

/// Runs the loop for 1.3 times the path's duration. `sense` makes the measurement from the true tip, the input held
/// before and the time.
pub(crate) fn drive(
    controller: &mut dyn Controller,
    plant: &PhysicalNeedle,
    start: &Pose,
    path: &ReferencePath,
    mut sense: impl FnMut(&Pose, Input, f64) -> Measurement,
) -> Tracking {
    let mut state = plant.at_entry(start);
    let mut held = Input::ZERO;
    let (mut early, mut late) = (Mean::default(), Mean::default());
    let (mut max_mm, mut turned_rad) = (0.0_f64, 0.0);
    let length_mm = path.arc_length_mm()[path.inputs().len()];
    let limits = InputLimits::default();
    for step in 0..(path.inputs().len() * 13 / 10) {
        let time_s = step as f64 * DT_S;
        let measurement = sense(&plant.tip(&state), held, time_s);
        let input = controller.step(&measurement, time_s).input;
        assert_inside(&limits, held, input, DT_S);
        for _ in 0..SUBSTEPS {
            state = plant.step(&state, input, DT_S / SUBSTEPS as f64).unwrap();
        }
        held = input;
        turned_rad += input.omega_rad_s.abs() * DT_S;
        if state.inserted_mm > 0.2 * length_mm {
            let distance_mm = distance_mm(path, &plant.tip(&state).position_mm);
            early.add(distance_mm * distance_mm);
            if state.inserted_mm > 0.5 * length_mm {
                late.add(distance_mm * distance_mm);
            }
            max_mm = max_mm.max(distance_mm);
        }
    }
    let end = path.poses()[path.inputs().len()].position_mm;
    Tracking {
        rms_mm: early.root(),
        late_rms_mm: late.root(),
        max_mm,
        final_mm: (plant.tip(&state).position_mm - end).norm(),
        revolutions: turned_rad / std::f64::consts::TAU,
    }
}

/// Box and rates, with room for rounding only.
pub(crate) fn assert_inside(limits: &InputLimits, held: Input, input: Input, dt_s: f64) {
    let rounding = 1e-9;
    assert!(input.v_mm_s >= limits.v_min_mm_s - rounding, "{input:?}");
    assert!(input.v_mm_s <= limits.v_max_mm_s + rounding, "{input:?}");
    assert!(
        input.omega_rad_s.abs() <= limits.omega_max_rad_s + rounding,
        "{input:?}"
    );
    let dv = (input.v_mm_s - held.v_mm_s).abs();
    let domega = (input.omega_rad_s - held.omega_rad_s).abs();
    assert!(
        dv <= limits.v_rate_max_mm_s2 * dt_s + rounding,
        "{held:?} {input:?}"
    );
    assert!(
        domega <= limits.omega_rate_max_rad_s2 * dt_s + rounding,
        "{held:?} {input:?}"
    );
}

fn distance_mm(path: &ReferencePath, point: &Vector3<f64>) -> f64 {
    let mut least = f64::INFINITY;
    for pair in path.poses().windows(2) {
        let (from, along) = (
            pair[0].position_mm,
            pair[1].position_mm - pair[0].position_mm,
        );
        let squared = along.norm_squared();
        let share = if squared > 0.0 {
            ((point - from).dot(&along) / squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        least = least.min((from + along * share - point).norm());
    }
    least
}

/// Off by 0.5 mm, 0.5 mm, 0.02 rad, 0.02 rad and half a radian of roll.
pub(crate) fn perturbed_start() -> Pose {
    Pose::exp(&Vector6::new(0.5, 0.5, 0.0, 0.02, 0.02, 0.5))
}
