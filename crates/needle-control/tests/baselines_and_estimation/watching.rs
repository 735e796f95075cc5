//! A filter that watches a plant: what the tests of the estimator share.

use crate::deviates::Deviates;
use crate::harness::{DT_S, KAPPA_PER_MM, needle};
use nalgebra::{SVector, Vector3};
use needle_control::{Belief, FilterSettings, NeedleFilter};
use needle_model::{Input, LaggedState, PhysicalNeedle, PhysicalState, Pose};

pub(crate) fn prior_at(pose: Pose, roll_std_rad: f64) -> Belief {
    let state = LaggedState {
        pose,
        needle: needle(),
        lag_rad: 0.0,
    };
    let curvature_std = 0.3 * KAPPA_PER_MM;
    let std = [0.5, 0.5, 0.5, 0.05, 0.05, roll_std_rad, curvature_std, 0.05];
    Belief::independent(state, &SVector::from(std))
}

pub(crate) fn filter(settings: FilterSettings) -> NeedleFilter {
    NeedleFilter::new(settings, prior_at(Pose::identity(), 0.3), 0.0).unwrap()
}

pub(crate) fn input_at(step: usize) -> Input {
    Input {
        v_mm_s: 5.0,
        omega_rad_s: 0.3 + 0.2 * (0.2 * step as f64).sin(),
    }
}

fn stepped(plant: &PhysicalNeedle, state: &PhysicalState, input: Input) -> PhysicalState {
    let mut state = *state;
    for _ in 0..10 {
        state = plant.step(&state, input, 0.1 * DT_S).unwrap();
    }
    state
}

/// Sees the tip with noise in each sample for `steps` samples; returns the last true state.
pub(crate) fn watch(
    plant: &PhysicalNeedle,
    start: &Pose,
    steps: usize,
    seed: u64,
    mut each: impl FnMut(usize, Input, Vector3<f64>, &PhysicalState),
) -> PhysicalState {
    let mut deviates = Deviates::seeded(seed);
    let mut state = plant.at_entry(start);
    for step in 1..=steps {
        let input = input_at(step);
        state = stepped(plant, &state, input);
        let seen = plant.tip(&state).position_mm + deviates.normals() * 0.2;
        each(step, input, seen, &state);
    }
    state
}
