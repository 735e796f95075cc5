//! The covariance that the filter reports is that of its errors.

use crate::deviates::Deviates;
use crate::harness::{DT_S, KAPPA_PER_MM, needle};
use nalgebra::{SVector, Vector6};
use needle_control::{
    Belief, CURVATURE, ERROR_DIMENSION, FilterSettings, LAG, NeedleFilter, Observation,
    ProcessNoise, Verdict,
};
use needle_model::{Input, LaggedState, Needle, Pose, TorsionalLag};

const RUNS: u64 = 300;
const STEPS: usize = 150;

type Error = SVector<f64, ERROR_DIMENSION>;

fn settings() -> FilterSettings {
    FilterSettings {
        torsion: Some(TorsionalLag::new(0.3).unwrap()),
        ..FilterSettings::default()
    }
}

/// 0.5 mm, 0.05 rad of heading, 0.3 rad of roll, 20 % of curvature, 0.2 rad of lag.
fn prior() -> Belief {
    let state = LaggedState {
        pose: Pose::identity(),
        needle: needle(),
        lag_rad: 0.0,
    };
    let mut std = Error::from([0.5, 0.5, 0.5, 0.05, 0.05, 0.3, 0.0, 0.2]);
    std[CURVATURE] = 0.2 * KAPPA_PER_MM;
    Belief::independent(state, &std)
}

fn process_std(noise: &ProcessNoise) -> Error {
    let (p, h) = (noise.position_mm, noise.heading_rad);
    Error::from([
        p,
        p,
        p,
        h,
        h,
        noise.roll_rad,
        noise.curvature_per_mm,
        noise.lag_rad,
    ])
}

fn displaced(state: &LaggedState, error: &Error) -> LaggedState {
    let curvature = state.needle.curvature_per_mm() + error[CURVATURE];
    LaggedState {
        pose: state.pose.perturbed(&error.fixed_rows::<6>(0).into_owned()),
        needle: Needle::new(curvature.max(0.0)).unwrap(),
        lag_rad: state.lag_rad + error[LAG],
    }
}

fn draw(deviates: &mut Deviates, std: &Error) -> Error {
    std.map(|s| s * deviates.normal())
}

fn input_at(step: usize) -> Input {
    Input {
        v_mm_s: 5.0,
        omega_rad_s: 2.0 * (0.3 * step as f64 * DT_S).sin(),
    }
}

struct Averages {
    /// Mean NEES at a few samples.
    nees: Vec<f64>,
    position_nis: f64,
    tangent_nis: f64,
    refused: f64,
}

/// Truths drawn from the prior and the process noise that the filter believes in; tangents come at a third of the
/// positions' rate.
fn monte_carlo(settings: &FilterSettings) -> Averages {
    let torsion = settings.torsion.unwrap();
    let process = process_std(&settings.process) * DT_S.sqrt();
    let prior_std = prior().covariance.diagonal().map(f64::sqrt);
    let checked = [10, 50, 100, STEPS];
    let mut nees = vec![0.0; checked.len()];
    let (mut nis, mut count, mut refused) = ([0.0; 2], [0.0; 2], 0.0);
    for run in 0..RUNS {
        let mut deviates = Deviates::seeded(run);
        let mut truth = displaced(&prior().state, &draw(&mut deviates, &prior_std));
        let mut filter = NeedleFilter::new(*settings, prior(), 0.0).unwrap();
        for step in 1..=STEPS {
            let input = input_at(step);
            truth = truth.step(torsion, input, DT_S).unwrap();
            truth = displaced(&truth, &draw(&mut deviates, &process));
            let time_s = step as f64 * DT_S;
            filter.advance(input, time_s);
            let seen = truth.pose.position_mm + deviates.normals() * settings.position_std_mm;
            let turned = Vector6::new(0.0, 0.0, 0.0, deviates.normal(), deviates.normal(), 0.0);
            let tangent = truth
                .pose
                .perturbed(&(turned * settings.tangent_std_rad))
                .tangent();
            let mut verdicts = vec![(0, filter.observe(Observation::Position(seen), time_s))];
            if step % 3 == 0 {
                verdicts.push((1, filter.observe(Observation::Tangent(tangent), time_s)));
            }
            for (sensor, verdict) in verdicts {
                match verdict {
                    Verdict::Accepted { nis: value } | Verdict::Outlier { nis: value } => {
                        nis[sensor] += value;
                        count[sensor] += 1.0;
                        refused += f64::from(u8::from(matches!(verdict, Verdict::Outlier { .. })));
                    }
                    other => panic!("{other:?}"),
                }
            }
            if let Some(at) = checked.iter().position(|&s| s == step) {
                nees[at] += filter.belief().nees(&truth).unwrap() / RUNS as f64;
            }
        }
    }
    Averages {
        nees,
        position_nis: nis[0] / count[0],
        tangent_nis: nis[1] / count[1],
        refused: refused / (count[0] + count[1]),
    }
}

#[test]
fn errors_are_as_large_as_the_filter_says() {
    let averages = monte_carlo(&settings());
    // The mean of 300 chi-square variables of 8 degrees of freedom is 8 with a standard deviation of sqrt(16 / 300) =
    // 0.23: four of them.
    for (at, nees) in averages.nees.iter().enumerate() {
        assert!((nees - 8.0).abs() < 0.93, "NEES {at}: {:?}", averages.nees);
    }
    // 45,000 positions (std of the mean 0.012) and 15,000 tangents (0.016); innovations of one run are independent.
    // Five of them, and as much again for what linearisation leaves.
    assert!(
        (averages.position_nis - 3.0).abs() < 0.12,
        "{}",
        averages.position_nis
    );
    assert!(
        (averages.tangent_nis - 2.0).abs() < 0.16,
        "{}",
        averages.tangent_nis
    );
    // The gate refuses 1e-4 of good observations: 6 expected of 60,000, and fewer than 20 beyond doubt.
    assert!(averages.refused < 20.0 / 60_000.0, "{}", averages.refused);
}
