//! No controller allocates after its first step.

use crate::scene::{CURVATURE_PER_MM, DT_S, Scene};
use nalgebra::Vector6;
use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    StraightController,
};
use needle_model::{Input, Needle, Pose, ReferencePath};

/// Allocations of 60 steps after the first, gaps and an outlier among them.
fn allocations(controller: &mut impl Controller, needle: Needle) -> u64 {
    let mut pose = Pose::exp(&Vector6::new(0.1, -0.2, 0.1, 0.01, 0.01, 0.2));
    let mut input = controller.step(&Measurement::of(pose), 0.0).input;
    let counted = allocation_counter::measure(|| {
        for step in 1..=60 {
            pose = needle.step(&pose, input, DT_S).unwrap();
            let measurement = match step {
                20..=35 => Measurement::default(),
                // From here on the curvature is told to be another.
                10..=19 => Measurement {
                    curvature_per_mm: Some(0.9 * needle.curvature_per_mm()),
                    ..Measurement::of(pose)
                },
                40 => {
                    Measurement::of(pose.perturbed(&Vector6::new(100.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
                }
                _ => Measurement::of(pose),
            };
            input = controller.step(&measurement, step as f64 * DT_S).input;
        }
    });
    counted.count_total
}

#[test]
fn nonlinear_steps_do_not_allocate() {
    let scene = Scene::default();
    let mut controller =
        NmpcController::new(scene.model, scene.path(), NmpcConfiguration::default()).unwrap();
    assert_eq!(allocations(&mut controller, scene.model), 0);
}

#[test]
fn linear_steps_do_not_allocate() {
    for (curvature, straight) in [(CURVATURE_PER_MM, false), (0.0, true)] {
        let needle = Needle::new(curvature).unwrap();
        let helix = Input {
            v_mm_s: 5.0,
            omega_rad_s: 1.0,
        };
        let path =
            ReferencePath::from_inputs(needle, Pose::identity(), vec![helix; 300], DT_S).unwrap();
        let configuration = LinearConfiguration::default();
        let count = if straight {
            allocations(
                &mut StraightController::new(needle, path, configuration).unwrap(),
                needle,
            )
        } else {
            allocations(
                &mut LtvController::new(needle, path, configuration).unwrap(),
                needle,
            )
        };
        assert_eq!(count, 0, "straight: {straight}");
    }
}
