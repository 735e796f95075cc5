//! Whole control steps in closed loop: linearise, assemble, solve.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::Vector6;
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    StraightController,
};
use needle_model::{Input, Needle, Pose, ReferencePath};

const DT_S: f64 = 0.1;
const STEPS: usize = 50;

/// Measurements of a closed loop, and the controller warmed up by its first step.
fn benchmark<C: Controller + Clone>(
    criterion: &mut Criterion,
    name: &str,
    needle: Needle,
    mut controller: C,
) {
    let mut pose = Pose::exp(&Vector6::new(0.1, -0.1, 0.0, 0.01, 0.0, 0.1));
    let mut input = controller.step(&Measurement::of(pose), 0.0).input;
    let warm = controller.clone();
    let mut measurements = Vec::new();
    for step in 1..=STEPS {
        pose = needle.step(&pose, input, DT_S).unwrap_or(pose);
        measurements.push(Measurement::of(pose));
        input = controller
            .step(&measurements[step - 1], step as f64 * DT_S)
            .input;
    }
    criterion.bench_function(&format!("{STEPS} steps of {name}"), |bencher| {
        bencher.iter_batched_ref(
            || warm.clone(),
            |controller| {
                for (step, measurement) in measurements.iter().enumerate() {
                    std::hint::black_box(
                        controller.step(measurement, (step + 1) as f64 * DT_S).input,
                    );
                }
            },
            BatchSize::SmallInput,
        );
    });
}

fn control_steps(criterion: &mut Criterion) {
    let (needle, straight) = (Needle::new(1.0 / 150.0), Needle::new(0.0));
    let (Ok(needle), Ok(straight)) = (needle, straight) else {
        return;
    };
    let helix = Input {
        v_mm_s: 5.0,
        omega_rad_s: 1.0,
    };
    let path =
        |needle| ReferencePath::from_inputs(needle, Pose::identity(), vec![helix; 400], DT_S);
    let bend = Vector6::new(0.0, 0.0, 0.5, 0.5 / 300.0, 0.0, 0.005);
    let curve = ReferencePath::from_poses(
        (0..=200)
            .map(|k| Pose::exp(&(bend * f64::from(k))))
            .collect(),
        DT_S,
    );
    let (Ok(path), Ok(line), Ok(curve)) = (path(needle), path(straight), curve) else {
        return;
    };
    let linear = |horizon| LinearConfiguration {
        horizon,
        ..LinearConfiguration::default()
    };
    if let Ok(controller) = StraightController::new(straight, line, linear(20)) {
        benchmark(criterion, "straight, N = 20", straight, controller);
    }
    for horizon in [8, 20, 50, 100] {
        if let Ok(controller) = LtvController::new(needle, path.clone(), linear(horizon)) {
            benchmark(
                criterion,
                &format!("ltv, N = {horizon}"),
                needle,
                controller,
            );
        }
    }
    for horizon in [20, 40] {
        let configuration = NmpcConfiguration {
            horizon,
            ..NmpcConfiguration::default()
        };
        if let Ok(controller) = NmpcController::new(needle, curve.clone(), configuration) {
            benchmark(
                criterion,
                &format!("nmpc, N = {horizon}"),
                needle,
                controller,
            );
        }
    }
}

criterion_group!(benches, control_steps);
criterion_main!(benches);
