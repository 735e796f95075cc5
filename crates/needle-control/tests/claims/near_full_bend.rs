//! The real-time iteration where a path bends nearly as much as the needle can: full Gauss-Newton steps overshoot in roll there.

use crate::scene::DT_S;
use nalgebra::Vector6;
use needle_control::{Controller, Measurement, NmpcConfiguration, NmpcController};
use needle_model::{Input, Needle, Pose, ReferencePath};

const ARC: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 0.0,
};

/// Largest and last distance from an arc of `ratio` of the needle's curvature, mm, from a start displaced by (x, y).
fn distances_mm(ratio: f64, x_mm: f64, y_mm: f64) -> (f64, f64) {
    let needle = |ratio: f64| Needle::new(ratio / 150.0).unwrap();
    let path = ReferencePath::from_inputs(needle(ratio), Pose::identity(), vec![ARC; 200], DT_S);
    let path = path.unwrap();
    let mut controller =
        NmpcController::new(needle(1.0), path.clone(), NmpcConfiguration::default()).unwrap();
    let mut pose = Pose::exp(&Vector6::new(x_mm, y_mm, 0.0, 0.0, 0.0, 0.0));
    let (mut largest, mut last) = (0.0_f64, 0.0);
    for step in 0..200 {
        let input = controller
            .step(&Measurement::of(pose), step as f64 * DT_S)
            .input;
        pose = needle(1.0).step(&pose, input, DT_S).unwrap();
        last = (pose.position_mm - path.poses()[step + 1].position_mm).norm();
        largest = largest.max(last);
    }
    (largest, last)
}

#[test]
fn full_bend_is_held_from_a_start_outside_it() {
    // The needle bends toward -y and can bend no more: 1 mm outside can only shrink as the arc turns. Full steps alternate, lose
    // bend by it and end 1.4 mm off. A hundredth for what is lost while the plan settles.
    let (largest, _) = distances_mm(1.0, 0.0, 1.0);
    assert!(largest < 1.01, "{largest}");
}

#[test]
fn start_off_an_arc_of_nine_tenths_of_the_bend_is_corrected() {
    // Full steps end 2.3 mm off; what is left is the tracking error of a spinning needle.
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let (_, last) = distances_mm(0.9, diagonal, diagonal);
    assert!(last < 0.02, "{last}");
}
