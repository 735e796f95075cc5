//! After every fault the loop comes back: the distance to the path is again what it is without one.

use crate::faulty_solver::{self, Fault, Switch};
use crate::linear::{HELIX, needle, path};
use crate::scene::{CURVATURE_PER_MM, DT_S};
use crate::survival::{inside, laws};
use mpc_qp::SolveStatus;
use nalgebra::{Vector3, Vector6};
use needle_control::{
    Controller, LinearConfiguration, Measurement, NmpcConfiguration, StraightController, Survival,
    Tracking,
};
use needle_model::{Input, Needle, Pose, ReferencePath};
use std::time::Duration;

/// What goes wrong, sample by sample; the defaults are a sound loop.
#[derive(Clone, Copy)]
struct Disturbance {
    name: &'static str,
    /// What is measured of a tip.
    seen: fn(usize, Pose) -> Option<Pose>,
    /// True time until the next sample, s.
    period_s: fn(usize) -> f64,
    /// What the clock shows for the true time, s.
    clock_s: fn(f64) -> f64,
    /// What the solver does.
    fault: fn(usize) -> Option<Fault>,
}

const SOUND: Disturbance = Disturbance {
    name: "sound",
    seen: |_, tip| Some(tip),
    period_s: |_| DT_S,
    clock_s: |true_s| true_s,
    fault: |_| None,
};

/// Samples in which something is wrong, for what lasts.
fn at_work(step: usize) -> bool {
    (80..88).contains(&step)
}

fn moved(tip: Pose, by_mm: f64) -> Pose {
    Pose {
        position_mm: tip.position_mm + Vector3::x() * by_mm,
        ..tip
    }
}

/// Longer than [`DEADLINE`].
const LATE: Fault = Fault::Late(Duration::from_millis(220));
const DEADLINE: Duration = Duration::from_millis(200);

const DISTURBANCES: [Disturbance; 14] = [
    Disturbance {
        name: "positions that are no numbers",
        seen: |step, tip| {
            Some(if at_work(step) {
                moved(tip, f64::NAN)
            } else {
                tip
            })
        },
        ..SOUND
    },
    Disturbance {
        name: "infinite positions",
        seen: |step, tip| {
            Some(if at_work(step) {
                moved(tip, f64::INFINITY)
            } else {
                tip
            })
        },
        ..SOUND
    },
    Disturbance {
        name: "outliers of 100 mm",
        seen: |step, tip| {
            Some(if step % 9 == 4 {
                moved(tip, 100.0)
            } else {
                tip
            })
        },
        ..SOUND
    },
    Disturbance {
        name: "100 mm off for 0.4 s",
        seen: |step, tip| {
            Some(if (80..84).contains(&step) {
                moved(tip, 100.0)
            } else {
                tip
            })
        },
        ..SOUND
    },
    Disturbance {
        name: "a gap of 2 s",
        seen: |step, tip| (!(80..100).contains(&step)).then_some(tip),
        ..SOUND
    },
    Disturbance {
        name: "tilted beyond a right angle for three samples",
        seen: |step, tip| {
            let beyond = Vector6::new(0.0, 0.0, 0.0, 0.0, 2.0, 0.0);
            Some(if (80..83).contains(&step) {
                tip.perturbed(&beyond)
            } else {
                tip
            })
        },
        ..SOUND
    },
    Disturbance {
        name: "a clock set back by 7 s",
        clock_s: |true_s| if true_s > 8.05 { true_s - 7.0 } else { true_s },
        ..SOUND
    },
    Disturbance {
        name: "a clock that stands still for 0.5 s",
        clock_s: |true_s| {
            if (8.05..8.55).contains(&true_s) {
                8.0
            } else {
                true_s
            }
        },
        ..SOUND
    },
    Disturbance {
        name: "jitter of 50 %",
        // The fractional parts of multiples of the golden ratio.
        period_s: |step| DT_S * (0.5 + (step as f64 * 0.618_033_988_7).fract()),
        ..SOUND
    },
    Disturbance {
        name: "infeasible programs",
        fault: |step| at_work(step).then(faulty_solver::infeasible),
        ..SOUND
    },
    Disturbance {
        name: "programs out of iterations",
        fault: |step| at_work(step).then_some(Fault::Status(SolveStatus::IterationLimit)),
        ..SOUND
    },
    Disturbance {
        name: "a solver in trouble for longer than a plan lasts",
        fault: |step| {
            (80..95)
                .contains(&step)
                .then_some(Fault::Status(SolveStatus::NumericalTrouble))
        },
        ..SOUND
    },
    Disturbance {
        name: "a solver that answers with an error",
        fault: |step| at_work(step).then_some(Fault::Error),
        ..SOUND
    },
    Disturbance {
        name: "programs past the deadline",
        fault: |step| at_work(step).then_some(LATE),
        ..SOUND
    },
];

/// A controller with its plant: not quite its model, so that what is not corrected grows.
struct Subject {
    name: &'static str,
    plant: Needle,
    reference: ReferencePath,
    controller: Box<dyn Controller>,
    /// What it is told of the plant's curvature.
    told_per_mm: Option<f64>,
    /// Whether the tip is to be at a place at a time; otherwise only on the path.
    timed: bool,
}

/// Half of the needle's curvature, turning by 0.01 rad/mm.
fn curve(steps: usize) -> ReferencePath {
    let bend = Needle::new(0.5 * CURVATURE_PER_MM).unwrap();
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 0.05,
    };
    path(bend, input, steps)
}

fn subjects(switch: &Switch) -> Vec<Subject> {
    // Two that follow a path's own inputs, others that follow its curve.
    let (executed, curve) = (path(needle(), HELIX, 320), curve(320));
    let survival = Survival {
        deadline: Some(DEADLINE),
        ..Survival::default()
    };
    let linear = LinearConfiguration {
        survival,
        ..LinearConfiguration::default()
    };
    let nonlinear = |tracking| NmpcConfiguration {
        survival,
        tracking,
        ..NmpcConfiguration::default()
    };
    let by = |tracking| -> Box<dyn Controller> {
        let configuration = nonlinear(tracking);
        Box::new(faulty_solver::nmpc(
            needle(),
            curve.clone(),
            configuration,
            switch,
        ))
    };
    let weak = Needle::new(0.9 * CURVATURE_PER_MM).unwrap();
    let subject = |reference: &ReferencePath, name, controller| Subject {
        name,
        plant: weak,
        reference: reference.clone(),
        controller,
        told_per_mm: None,
        timed: false,
    };
    let mut subjects: Vec<_> = laws(&curve)
        .into_iter()
        .filter(|(name, _)| *name != "lqr")
        .map(|(name, law)| subject(&curve, name, law))
        .collect();
    subjects.push(subject(&curve, "nonlinear", by(Tracking::Time)));
    subjects.push(subject(
        &curve,
        "nonlinear, progress",
        by(Tracking::Progress),
    ));
    let lqr = laws(&executed).pop().unwrap().1;
    subjects.push(subject(&executed, "lqr", lqr));
    let ltv = faulty_solver::ltv(needle(), executed.clone(), linear.clone(), switch);
    subjects.push(subject(&executed, "time-varying", Box::new(ltv)));
    let ltv = faulty_solver::ltv(needle(), executed.clone(), linear.clone(), switch);
    subjects.push(Subject {
        told_per_mm: Some(weak.curvature_per_mm()),
        timed: true,
        ..subject(&executed, "time-varying, told", Box::new(ltv))
    });
    let straight = Needle::new(0.0).unwrap();
    let reference = path(straight, HELIX, 320);
    let controller = StraightController::with_solver(straight, reference.clone(), linear, |p| {
        faulty_solver::Faulty::new(p, switch)
    });
    subjects.push(Subject {
        name: "straight",
        plant: straight,
        reference,
        controller: Box::new(controller.unwrap()),
        told_per_mm: None,
        timed: true,
    });
    subjects
}

impl Subject {
    /// The loop under a disturbance: root mean square distance in the last 8 s, 12 s after the worst of it, mm.
    fn late_rms_mm(&mut self, disturbance: &Disturbance, switch: &Switch) -> f64 {
        self.controller.reset();
        let mut pose =
            self.reference.poses()[0].perturbed(&Vector6::new(0.2, -0.2, 0.0, 0.0, 0.0, 0.2));
        let (mut time_s, mut previous, mut last_s) = (0.0, Input::ZERO, None::<f64>);
        let (mut squares, mut count) = (0.0, 0.0);
        for step in 0..280 {
            switch.set((disturbance.fault)(step));
            let pose_seen = (disturbance.seen)(step, pose);
            let measurement = Measurement {
                pose: pose_seen,
                curvature_per_mm: self.told_per_mm,
            };
            let clock_s = (disturbance.clock_s)(time_s);
            let decided = self.controller.step(&measurement, clock_s);
            let (input, origin) = (decided.input, decided.origin);
            let elapsed_s = last_s.map_or(DT_S, |last| clock_s - last);
            assert!(
                inside(input, previous, elapsed_s),
                "{}, {}, step {step}: {input:?} after {previous:?}, {origin:?}",
                self.name,
                disturbance.name
            );
            (previous, last_s) = (input, Some(clock_s));
            if step >= 200 {
                squares += self.distance_mm(&pose, time_s).powi(2);
                count += 1.0;
            }
            let period_s = (disturbance.period_s)(step);
            pose = self.plant.step(&pose, input, period_s).unwrap();
            time_s += period_s;
        }
        f64::sqrt(squares / count)
    }

    fn distance_mm(&self, tip: &Pose, time_s: f64) -> f64 {
        let offset = |pose: &Pose| tip.position_mm - pose.position_mm;
        if self.timed {
            let wanted = self.reference.pose_at_time(time_s);
            return offset(&wanted).dot(&wanted.tangent()).abs();
        }
        let poses = self.reference.poses().iter();
        let nearest = poses
            .min_by(|a, b| {
                offset(a)
                    .norm_squared()
                    .total_cmp(&offset(b).norm_squared())
            })
            .unwrap();
        // Half a sample of the path along its tangent: a bend of 1/150 per mm leaves 0.2 um.
        offset(nearest).cross(&nearest.tangent()).norm()
    }
}

/// What the distance may be more besides, mm.
fn slack_mm(subject: &str, disturbance: &str) -> f64 {
    match (subject, disturbance) {
        // The slowest to come back: 0.045 mm after 12 s, of 0.030 mm without a fault.
        ("lqr", "tilted beyond a right angle for three samples") => 0.01,
        // Along the path, while the clock still jitters: 0.005 mm, a hundredth of a sample's way.
        ("time-varying, told", "jitter of 50 %") => 0.006,
        // A fifth of what the best loop keeps anyway, 0.014 mm.
        _ => 0.003,
    }
}

#[test]
fn after_every_fault_the_distance_is_again_the_sound_loops() {
    let switch = Switch::default();
    let mut lost = Vec::new();
    for subject in &mut subjects(&switch) {
        let sound_mm = subject.late_rms_mm(&SOUND, &switch);
        println!("{}: {sound_mm:.4} mm", subject.name);
        for disturbance in &DISTURBANCES {
            let after_mm = subject.late_rms_mm(disturbance, &switch);
            println!("{}, {}: {after_mm:.4} mm", subject.name, disturbance.name);
            if after_mm > 1.25 * sound_mm + slack_mm(subject.name, disturbance.name) {
                lost.push((subject.name, disturbance.name, sound_mm, after_mm));
            }
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}
