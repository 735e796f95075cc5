//! Nothing is allocated in a sample, late observations included.

use crate::harness::{DT_S, bent_path, needle};
use crate::watching::{filter, input_at};
use nalgebra::Vector3;
use needle_control::{
    BaselineSettings, Controller, DutyCycledGains, DutyCycledSteering, FilterSettings,
    LawController, Observation,
};

#[test]
fn a_sample_of_filter_and_law_allocates_nothing() {
    let mut filter = filter(FilterSettings::default());
    let law = DutyCycledSteering::new(DutyCycledGains::default()).unwrap();
    let settings = BaselineSettings::default();
    let mut controller = LawController::new(bent_path(0.5), needle(), law, settings).unwrap();
    let counted = allocation_counter::measure(|| {
        for step in 1..200 {
            let time_s = step as f64 * DT_S;
            filter.advance(input_at(step), time_s);
            let seen = Vector3::new(0.0, 0.0, 0.5 * step as f64);
            filter.observe(Observation::Position(seen), time_s - 0.25);
            filter.observe(Observation::Tangent(Vector3::z()), time_s);
            controller.step(&filter.measurement(), time_s);
        }
    });
    assert_eq!(counted.count_total, 0);
}
