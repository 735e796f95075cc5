//! The tuning study of the baselines: a grid over each law's gains on the benchmark path, best first.
//!
//! Score: mean RMS distance to the path over three cases: nominal; plant curvature 20 % low from a start that is off; positions
//! with 0.2 mm of unfiltered noise. The defaults are the winners; `docs/baselines.md` has the output.
#![allow(clippy::print_stdout, reason = "a study reports")]
#![allow(clippy::unwrap_used, reason = "constants of this file")]

#[path = "../tests/deviates/mod.rs"]
mod deviates;
#[path = "../tests/baselines_and_estimation/harness.rs"]
mod harness;

use deviates::Deviates;
use harness::{DT_S, Tracking, bent_path, drive, helix_path, needle, perturbed_start, plant};
use nalgebra::{Vector2, Vector6};
use needle_control::{
    BaselineSettings, Controller, DutyCycledGains, DutyCycledSteering, FeedForward, LateralGains,
    LawController, LqrWeights, Measurement, PidGains, SlidingMode, SlidingModeGains, SteeringPid,
    TimeVaryingLqr,
};
use needle_model::{Pose, ReferencePath};

fn study(path: &ReferencePath, mut make: impl FnMut() -> Box<dyn Controller>) -> Vec<Tracking> {
    let still = Pose::identity();
    let exact = |tip: &Pose, _, _| Measurement::of(*tip);
    vec![
        drive(&mut *make(), &plant(1.0), &still, path, exact),
        drive(&mut *make(), &plant(0.8), &perturbed_start(), path, exact),
        noisy(path, &mut make),
    ]
}

/// Mean over four draws of the noise: a single draw tunes the law to itself.
fn noisy(path: &ReferencePath, make: &mut impl FnMut() -> Box<dyn Controller>) -> Tracking {
    let mut runs = (0..4).map(|seed| {
        let mut noise = Deviates::seeded(seed);
        let sense = |tip: &Pose, _, _| {
            let mut seen = *tip;
            seen.position_mm += noise.normals() * 0.2;
            Measurement::of(seen)
        };
        drive(&mut *make(), &plant(1.0), &Pose::identity(), path, sense)
    });
    let first = runs.next().unwrap();
    let rms_mm = runs
        .map(|run| run.rms_mm)
        .fold(first.rms_mm, |sum, rms_mm| sum + rms_mm)
        / 4.0;
    Tracking { rms_mm, ..first }
}

fn report(law: &str, mut rows: Vec<(String, Vec<Tracking>)>) {
    let score = |t: &[Tracking]| t.iter().map(|t| t.rms_mm).sum::<f64>();
    rows.sort_by(|a, b| score(&a.1).total_cmp(&score(&b.1)));
    println!(
        "\n{law}: {} settings; RMS mm of each case | nominal: final mm, revolutions",
        rows.len()
    );
    for (name, t) in rows
        .iter()
        .take(3)
        .chain(rows.last().filter(|_| rows.len() > 1))
    {
        let rms: Vec<String> = t.iter().map(|t| format!("{:.3}", t.rms_mm)).collect();
        let rms = rms.join(" ");
        println!(
            "{name:<50} {rms} | {:.3} {:.1}",
            t[0].final_mm, t[0].revolutions
        );
    }
}

fn lateral(decay_mm: f64, integral_mm: f64, preview_mm: f64) -> LateralGains {
    LateralGains {
        decay_mm,
        integral_mm,
        preview_mm,
    }
}

fn main() {
    let settings = BaselineSettings {
        dt_s: DT_S,
        ..BaselineSettings::default()
    };
    let path = bent_path(0.5);

    let mut rows = Vec::new();
    for decay_mm in [3.0, 4.0, 6.0, 8.0] {
        for integral_mm in [6.0, 8.0, 10.0, 20.0] {
            for turn_gain_per_s in [5.0, 10.0] {
                for slack in [0.5, 1.0, 2.0, 4.0] {
                    let gains = PidGains {
                        lateral: lateral(decay_mm, integral_mm, 2.0),
                        turn_gain_per_s,
                        slack,
                    };
                    let runs = study(&path, || {
                        let law = SteeringPid::new(gains).unwrap();
                        Box::new(LawController::new(path.clone(), needle(), law, settings).unwrap())
                    });
                    rows.push((format!("decay {decay_mm} integral {integral_mm} turn {turn_gain_per_s} slack {slack}"), runs));
                }
            }
        }
    }
    report("PID on the steering angle", rows);

    let mut rows = Vec::new();
    for lookahead_mm in [4.0, 6.0, 7.0, 8.0, 10.0, 15.0] {
        for spin_fraction in [0.5, 1.0] {
            for boundary_rad in [0.5, 1.0, 1.5, 2.0] {
                let gains = SlidingModeGains {
                    lookahead_mm,
                    spin_fraction,
                    boundary_rad,
                };
                let runs = study(&path, || {
                    let law = SlidingMode::new(gains).unwrap();
                    Box::new(LawController::new(path.clone(), needle(), law, settings).unwrap())
                });
                rows.push((
                    format!(
                        "lookahead {lookahead_mm} spin {spin_fraction} boundary {boundary_rad}"
                    ),
                    runs,
                ));
            }
        }
    }
    report("sliding mode", rows);

    let mut rows = Vec::new();
    for decay_mm in [3.0, 4.5, 6.0, 8.0] {
        for integral_mm in [6.0, 8.0, 10.0, 20.0] {
            for turn_gain_per_s in [2.0, 5.0, 10.0] {
                for spin_fraction in [0.5, 1.0] {
                    let gains = DutyCycledGains {
                        lateral: lateral(decay_mm, integral_mm, 5.0),
                        turn_gain_per_s,
                        spin_fraction,
                    };
                    let runs = study(&path, || {
                        let law = DutyCycledSteering::new(gains).unwrap();
                        Box::new(LawController::new(path.clone(), needle(), law, settings).unwrap())
                    });
                    rows.push((format!("decay {decay_mm} integral {integral_mm} turn {turn_gain_per_s} spin {spin_fraction}"), runs));
                }
            }
        }
    }
    report("duty-cycled", rows);

    let helices = [helix_path(0.5), helix_path(2.0)];
    let mut rows = Vec::new();
    for heading in [10.0, 100.0, 1000.0] {
        for roll in [0.1, 1.0] {
            for v in [0.1, 1.0, 10.0] {
                for omega in [0.01, 0.03, 0.1] {
                    let weights = LqrWeights {
                        error: Vector6::new(1.0, 1.0, 1.0, heading, heading, roll),
                        input: Vector2::new(v, omega),
                        terminal: 10.0,
                    };
                    let mut runs = Vec::new();
                    for path in &helices {
                        runs.extend(study(path, || {
                            let law = TimeVaryingLqr::new(path, needle(), weights).unwrap();
                            let path = path.clone();
                            Box::new(LawController::new(path, needle(), law, settings).unwrap())
                        }));
                    }
                    let name = format!("heading {heading} roll {roll} v {v} omega {omega}");
                    rows.push((name, runs));
                }
            }
        }
    }
    report("time-varying LQR on helices of 0.5 and 2 rad/s", rows);

    for (name, path) in [
        ("the benchmark path", &path),
        ("the helix of 0.5 rad/s", &helices[0]),
    ] {
        let lqr = study(path, || {
            let law = TimeVaryingLqr::new(path, needle(), LqrWeights::default()).unwrap();
            Box::new(LawController::new(path.clone(), needle(), law, settings).unwrap())
        });
        report(
            &format!("time-varying LQR, defaults, on {name}"),
            vec![(String::new(), lqr)],
        );
        let replayed = study(path, || {
            Box::new(FeedForward::new(path.clone(), settings).unwrap())
        });
        report(
            &format!("feed-forward on {name}"),
            vec![(String::new(), replayed)],
        );
    }

    println!("\ndefaults on the benchmark's cases: RMS mm, maximum mm, final mm, revolutions");
    let cases: [(&str, ReferencePath, f64, Pose, f64); 7] = [
        ("nominal", bent_path(0.5), 1.0, Pose::identity(), 0.0),
        (
            "plant curvature -20 %",
            bent_path(0.5),
            0.8,
            Pose::identity(),
            0.0,
        ),
        (
            "plant curvature +20 %",
            bent_path(0.5),
            1.2,
            Pose::identity(),
            0.0,
        ),
        (
            "path curvature 0.8 kappa",
            bent_path(0.8),
            1.0,
            Pose::identity(),
            0.0,
        ),
        ("straight path", bent_path(0.0), 1.0, Pose::identity(), 0.0),
        (
            "noise 0.2 mm, unfiltered",
            bent_path(0.5),
            1.0,
            Pose::identity(),
            0.2,
        ),
        (
            "start off by 1 mm, 0.05, 1 rad",
            bent_path(0.5),
            1.0,
            far_start(),
            0.0,
        ),
    ];
    for (case, path, factor, start, noise_mm) in cases {
        let pid = SteeringPid::new(PidGains::default()).unwrap();
        let sliding = SlidingMode::new(SlidingModeGains::default()).unwrap();
        let duty = DutyCycledSteering::new(DutyCycledGains::default()).unwrap();
        let mut laws: [(&str, Box<dyn Controller>); 3] = [
            (
                "PID",
                Box::new(LawController::new(path.clone(), needle(), pid, settings).unwrap()),
            ),
            (
                "sliding",
                Box::new(LawController::new(path.clone(), needle(), sliding, settings).unwrap()),
            ),
            (
                "duty",
                Box::new(LawController::new(path.clone(), needle(), duty, settings).unwrap()),
            ),
        ];
        for (law, controller) in &mut laws {
            let mut noise = Deviates::seeded(2);
            let t = drive(
                controller.as_mut(),
                &plant(factor),
                &start,
                &path,
                |tip, _, _| {
                    let mut seen = *tip;
                    seen.position_mm += noise.normals() * noise_mm;
                    Measurement::of(seen)
                },
            );
            println!(
                "{case:<32} {law:<8} {:.3} {:.3} {:.3} {:.1}",
                t.rms_mm, t.max_mm, t.final_mm, t.revolutions
            );
        }
    }
}

/// The benchmark's start: off by 1 mm, 1 mm, 0.05 rad, 0.05 rad and 1 rad of roll.
fn far_start() -> Pose {
    Pose::exp(&Vector6::new(1.0, 1.0, 0.0, 0.05, 0.05, 1.0))
}
