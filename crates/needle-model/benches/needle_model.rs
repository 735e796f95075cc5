//! Cost of what a controller calls every period: a step, a linearisation, a residual with its
//! Jacobians, the stages of a horizon, and the nearest point of a long path.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector6;
use needle_model::{Input, Needle, PathProgress, Pose, ReferencePath};

const INPUT: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 1.3,
};

fn kinematics(c: &mut Criterion) {
    let needle = Needle::new(1.0 / 150.0).expect("valid curvature");
    let pose = Pose::exp(&Vector6::new(10.0, -3.0, 40.0, 0.3, -0.2, 1.0));
    let target = pose.perturbed(&Vector6::new(0.1, 0.2, 0.5, 0.01, 0.02, 0.1));
    c.bench_function("step", |b| {
        b.iter(|| needle.step(black_box(&pose), black_box(INPUT), 0.1));
    });
    c.bench_function("linearise", |b| {
        b.iter(|| needle.linearise(black_box(INPUT), 0.1));
    });
    c.bench_function("step residual with Jacobians", |b| {
        b.iter(|| needle.step_residual(black_box(&pose), black_box(INPUT), &target, 0.1));
    });
    c.bench_function("linearise 20 stages", |b| {
        let inputs = [INPUT; 20];
        b.iter(|| black_box(inputs).map(|input| needle.linearise(input, 0.1)));
    });
}

fn progress(c: &mut Criterion) {
    let needle = Needle::new(1.0 / 150.0).expect("valid curvature");
    let path = ReferencePath::from_inputs(needle, Pose::identity(), vec![INPUT; 100_000], 1e-3)
        .expect("finite path");
    c.bench_function("advance along 1e5 points, lookahead 20", |b| {
        let mut progress = PathProgress::from_start(20);
        let mut i = 0;
        b.iter(|| {
            // A closed loop: every query a few samples further, back at the start after the end.
            i += 7;
            if i >= 100_000 {
                i = 0;
                progress = PathProgress::from_start(20);
            }
            progress.advance(&path, black_box(&path.poses()[i].position_mm))
        });
    });
    c.bench_function("acquire among 1e5 points", |b| {
        let position = path.poses()[77_777].position_mm;
        b.iter(|| PathProgress::acquired(&path, black_box(&position), 20));
    });
}

criterion_group!(benches, kinematics, progress);
criterion_main!(benches);
