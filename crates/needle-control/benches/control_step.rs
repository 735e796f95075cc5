//! Whole control steps in closed loop: linearise, assemble, solve. The needle bends 10 % less than the model and is seen with noise, so that
//! no warm start is the answer already.

#[path = "../tests/deviates/mod.rs"]
mod deviates;

use criterion::{BatchSize, Criterion};
use deviates::Deviates;
use nalgebra::Vector6;
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    StraightController,
};
use needle_model::{Input, Needle, Pose, ReferencePath};
use std::error::Error;
use std::hint::black_box;
use std::time::Duration;

const DT_S: f64 = 0.1;
const STEPS: usize = 50;
const NOISE_MM: f64 = 0.05;
/// Now and then a plan touches it.
const CORRIDOR_MM: f64 = 0.2;

/// Times a closed loop that is warm from its first step on: the measurements are those of one run.
fn benchmark<C: Controller + Clone>(
    criterion: &mut Criterion,
    name: &str,
    model: Needle,
    told: bool,
    mut controller: C,
) -> Result<(), Box<dyn Error>> {
    let needle = Needle::new(0.9 * model.curvature_per_mm())?;
    let mut noise = Deviates::seeded(1);
    let mut seen = |pose: Pose| Measurement {
        pose: Some(Pose {
            position_mm: pose.position_mm + noise.normals() * NOISE_MM,
            ..pose
        }),
        curvature_per_mm: told.then_some(needle.curvature_per_mm()),
    };
    let mut pose = Pose::exp(&Vector6::new(0.1, -0.1, 0.0, 0.01, 0.0, 0.1));
    let mut input = controller.step(&seen(pose), 0.0).input;
    let warm = controller.clone();
    let mut measurements = Vec::new();
    for step in 1..=STEPS {
        pose = needle.step(&pose, input, DT_S)?;
        let measurement = seen(pose);
        measurements.push(measurement);
        input = controller.step(&measurement, step as f64 * DT_S).input;
    }
    criterion.bench_function(&format!("{STEPS} steps of {name}"), |bencher| {
        bencher.iter_batched_ref(
            || warm.clone(),
            |controller| {
                for (step, measurement) in measurements.iter().enumerate() {
                    black_box(controller.step(measurement, (step + 1) as f64 * DT_S).input);
                }
            },
            BatchSize::SmallInput,
        );
    });
    Ok(())
}

fn control_steps(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    let (needle, straight) = (Needle::new(1.0 / 150.0)?, Needle::new(0.0)?);
    let helix = Input {
        v_mm_s: 5.0,
        omega_rad_s: 1.0,
    };
    let path =
        |needle| ReferencePath::from_inputs(needle, Pose::identity(), vec![helix; 400], DT_S);
    let bend = Vector6::new(0.0, 0.0, 0.5, 0.5 / 300.0, 0.0, 0.005);
    let curve = (0..=200).map(|k| Pose::exp(&(bend * f64::from(k))));
    let curve = ReferencePath::from_poses(curve.collect(), DT_S)?;
    for horizon in [8, 20, 50, 100] {
        let linear = LinearConfiguration {
            horizon,
            ..LinearConfiguration::default()
        };
        let lti = StraightController::new(straight, path(straight)?, linear.clone())?;
        benchmark(
            criterion,
            &format!("straight, N = {horizon}"),
            straight,
            false,
            lti,
        )?;
        let ltv = LtvController::new(needle, path(needle)?, linear)?;
        let name = format!("ltv, N = {horizon}");
        if horizon == 20 {
            let name = format!("{name}, told the curvature");
            benchmark(criterion, &name, needle, true, ltv.clone())?;
        }
        benchmark(criterion, &name, needle, false, ltv)?;
    }
    let kept = LinearConfiguration {
        corridor_mm: Some(CORRIDOR_MM),
        ..LinearConfiguration::default()
    };
    let ltv = LtvController::new(needle, path(needle)?, kept)?;
    benchmark(criterion, "ltv, N = 20, in a corridor", needle, false, ltv)?;
    let kept = NmpcConfiguration {
        corridor_mm: Some(CORRIDOR_MM),
        ..NmpcConfiguration::default()
    };
    let nmpc = NmpcController::new(needle, curve.clone(), kept)?;
    benchmark(
        criterion,
        "nmpc, N = 20, in a corridor",
        needle,
        false,
        nmpc,
    )?;
    for horizon in [20, 40] {
        let configuration = NmpcConfiguration {
            horizon,
            ..NmpcConfiguration::default()
        };
        let nmpc = NmpcController::new(needle, curve.clone(), configuration)?;
        let name = format!("nmpc, N = {horizon}");
        benchmark(criterion, &name, needle, false, nmpc)?;
    }
    Ok(())
}

/// A controller that cannot be made ends the run with its reason.
fn main() -> Result<(), Box<dyn Error>> {
    // Thirteen programs of 3 + 10 s, and the analysis.
    let mut criterion = Criterion::default()
        .warm_up_time(Duration::from_secs(3))
        .measurement_time(Duration::from_secs(10))
        .configure_from_args();
    control_steps(&mut criterion)?;
    criterion.final_summary();
    Ok(())
}
