//! A sample of the filter, with a punctual and with a late observation, and a step of each explicit law.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{SVector, Vector3};
use needle_control::{
    BaselineError, BaselineSettings, Belief, Controller, DutyCycledGains, DutyCycledSteering,
    FilterSettings, LawController, LqrWeights, Measurement, NeedleFilter, Observation, PidGains,
    SlidingMode, SlidingModeGains, SteeringLaw, SteeringPid, TimeVaryingLqr,
};
use needle_model::{Input, LaggedState, Needle, Pose, ReferencePath};
use std::hint::black_box;

const INPUT: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 1.0,
};

/// A figure of what was not run would be none: an error ends the run.
const VALID: &str = "the needle, the path and the default settings are valid";

fn filter_sample(c: &mut Criterion) {
    for late_samples in [0_u32, 1, 10] {
        let needle = Needle::new(1.0 / 150.0).expect(VALID);
        let state = LaggedState {
            pose: Pose::identity(),
            needle,
            lag_rad: 0.0,
        };
        let std = SVector::from([0.2, 0.2, 0.2, 0.02, 0.02, 0.1, 0.002, 0.01]);
        let belief = Belief::independent(state, &std);
        let mut filter = NeedleFilter::new(FilterSettings::default(), belief, 0.0).expect(VALID);
        let mut sample = 0_u32;
        c.bench_function(
            &format!("filter, position {late_samples} samples late"),
            |b| {
                b.iter(|| {
                    sample += 1;
                    let now_s = 0.1 * f64::from(sample);
                    filter.advance(black_box(Input::ZERO), now_s);
                    let seen = Observation::Position(Vector3::zeros());
                    filter.observe(seen, now_s - 0.1 * f64::from(late_samples))
                });
            },
        );
    }
}

fn law_step(c: &mut Criterion) {
    let needle = Needle::new(1.0 / 150.0).expect(VALID);
    let inputs = vec![INPUT; 200];
    let path = ReferencePath::from_inputs(needle, Pose::identity(), inputs, 0.1).expect(VALID);
    let lqr = TimeVaryingLqr::new(&path, needle, LqrWeights::default());
    timed(
        c,
        "PID",
        &path,
        needle,
        SteeringPid::new(PidGains::default()),
    );
    timed(
        c,
        "sliding mode",
        &path,
        needle,
        SlidingMode::new(SlidingModeGains::default()),
    );
    timed(
        c,
        "duty-cycled",
        &path,
        needle,
        DutyCycledSteering::new(DutyCycledGains::default()),
    );
    timed(c, "time-varying LQR", &path, needle, lqr);
}

fn timed<L: SteeringLaw>(
    c: &mut Criterion,
    name: &str,
    path: &ReferencePath,
    needle: Needle,
    law: Result<L, BaselineError>,
) {
    let settings = BaselineSettings::default();
    let made = law.and_then(|law| LawController::new(path.clone(), needle, law, settings));
    let mut controller = made.expect(VALID);
    let measurement = Measurement::of(path.poses()[3]);
    c.bench_function(name, |b| {
        b.iter(|| controller.step(black_box(&measurement), 0.0).input);
    });
}

criterion_group!(benches, filter_sample, law_step);
criterion_main!(benches);
