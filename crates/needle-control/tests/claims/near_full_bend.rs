//! Planar arcs that bend nearly as much as the needle can, from starts off them: there is little bend to spare for the way back, and it
//! takes several horizons.

use crate::deviates::Deviates;
use crate::scene::DT_S;
use nalgebra::Vector6;
use needle_control::{
    BaselineSettings, Controller, Convergence, LawController, Measurement, NmpcConfiguration,
    NmpcController, PidGains, SteeringPid,
};
use needle_model::{Input, Needle, Pose, ReferencePath};

const ARC: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 0.0,
};

fn needle(ratio: f64) -> Needle {
    Needle::new(ratio / 150.0).unwrap()
}

/// 100 mm that bend by `ratio` of the needle's curvature.
fn arc(ratio: f64) -> ReferencePath {
    ReferencePath::from_inputs(needle(ratio), Pose::identity(), vec![ARC; 200], DT_S).unwrap()
}

/// Largest and last distance across the path, mm.
fn distances_mm(controller: &mut impl Controller, path: &ReferencePath, start: Pose) -> (f64, f64) {
    let mut pose = start;
    let (mut largest, mut last) = (0.0_f64, 0.0);
    for step in 0..200 {
        let measured = Measurement::of(pose);
        let input = controller.step(&measured, step as f64 * DT_S).input;
        pose = needle(1.0).step(&pose, input, DT_S).unwrap();
        let reference = path.poses()[step + 1];
        let offset = pose.position_mm - reference.position_mm;
        last = offset.cross(&reference.tangent()).norm();
        largest = largest.max(last);
    }
    (largest, last)
}

fn by_nmpc(ratio: f64, start: Pose, convergence: Convergence) -> (f64, f64) {
    let configuration = NmpcConfiguration {
        convergence,
        ..NmpcConfiguration::default()
    };
    let path = arc(ratio);
    let mut controller = NmpcController::new(needle(1.0), path.clone(), configuration).unwrap();
    distances_mm(&mut controller, &path, start)
}

fn by_pid(ratio: f64, start: Pose) -> (f64, f64) {
    let (path, pid) = (arc(ratio), SteeringPid::new(PidGains::default()).unwrap());
    let settings = BaselineSettings::default();
    let mut controller = LawController::new(path.clone(), needle(1.0), pid, settings).unwrap();
    distances_mm(&mut controller, &path, start)
}

fn aside(x_mm: f64, y_mm: f64) -> Pose {
    Pose::exp(&Vector6::new(x_mm, y_mm, 0.0, 0.0, 0.0, 0.0))
}

#[test]
fn full_bend_is_held_from_a_start_outside_it() {
    // The needle bends toward -y and can bend no more: 1 mm outside can only shrink as the arc turns. Full steps alternate, lose
    // bend by it and end 1.4 mm off. A hundredth for what is lost while the plan settles.
    let (largest, _) = by_nmpc(1.0, aside(0.0, 1.0), Convergence::RealTime);
    assert!(largest < 1.01, "{largest}");
}

/// A millimetre off to every side; the second round turned about the tangent as well.
fn to_every_side() -> Vec<Pose> {
    let mut draw = Deviates::seeded(11);
    let start = |eighth: u32| {
        let angle = f64::from(eighth) * std::f64::consts::FRAC_PI_4;
        let roll_rad = match eighth < 8 {
            true => 0.0,
            false => draw.uniform() - 0.5,
        };
        Pose::exp(&Vector6::new(
            angle.cos(),
            angle.sin(),
            0.0,
            0.0,
            0.0,
            roll_rad,
        ))
    };
    (0..16).map(start).collect()
}

#[test]
fn a_millimetre_off_an_arc_one_iteration_ends_no_farther_than_pid() {
    for ratio in [0.8, 0.9, 1.0] {
        for start in to_every_side() {
            let (_, pid) = by_pid(ratio, start);
            let (_, nmpc) = by_nmpc(ratio, start, Convergence::RealTime);
            // A tenth, and the tracking error of a spinning needle.
            assert!(
                nmpc <= 1.1 * pid + 0.01,
                "{ratio}, {start:?}: {nmpc} mm, {pid} mm by PID"
            );
        }
    }
}

#[test]
fn a_millimetre_off_an_arc_of_0_95_one_iteration_ends_nearer_than_pid_but_outside_the_arc() {
    let (mut nmpc, mut pid) = (Vec::new(), Vec::new());
    for start in to_every_side() {
        pid.push(by_pid(0.95, start).1);
        nmpc.push(by_nmpc(0.95, start, Convergence::RealTime).1);
    }
    // From outside PID ends at 0.03 mm, this at 0.11; beside that at 0.09, this at 0.006; from the other sides 1 to 4 mm off, this within
    // 0.03, from one turned start 0.65.
    let mean = |ends: &[f64]| ends.iter().sum::<f64>() / ends.len() as f64;
    let farthest = |ends: &[f64]| ends.iter().copied().fold(0.0, f64::max);
    assert!(
        mean(&nmpc) < 0.1 * mean(&pid) && farthest(&nmpc) < 0.25 * farthest(&pid),
        "{nmpc:?} mm, {pid:?} mm by PID"
    );
}

#[test]
fn a_millimetre_off_an_arc_one_iteration_ends_as_near_as_many() {
    let converged = Convergence::Full {
        tolerance: 1e-6,
        max_iterations: 15,
    };
    for (ratio, x_mm, y_mm) in [(0.9, 0.0, -1.0), (1.0, 1.0, 0.0)] {
        let start = aside(x_mm, y_mm);
        let (_, many) = by_nmpc(ratio, start, converged);
        let (_, one) = by_nmpc(ratio, start, Convergence::RealTime);
        assert!(
            one <= 1.1 * many + 0.02,
            "{ratio}: {one} mm, {many} mm converged"
        );
    }
}

#[test]
fn three_millimetres_off_an_arc_of_eight_tenths_come_back() {
    // The way back takes 60 mm of the 100: PID ends 3.9 mm off from the worst side.
    for (x_mm, y_mm) in [(3.0, 0.0), (-3.0, 0.0), (0.0, 3.0), (0.0, -3.0)] {
        let (_, last) = by_nmpc(0.8, aside(x_mm, y_mm), Convergence::RealTime);
        assert!(last < 0.02, "{x_mm}, {y_mm}: {last}");
    }
}
