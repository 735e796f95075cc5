//! Chains with a cross term, and periods: what they solve, warn of and refuse.

use crate::systems::{Source, System, norm};
use faer::{Mat, mat};
use lqr::{BackwardChain, ChainError, NearLoss, PeriodicSolution, Stage};
use proptest::prelude::*;

/// Stages x'Qx + 2x'Su + u'Ru and, with u = v + Lx and S = -L'R, Q = Q0 + L'RL, the same ones as x'Q0x + v'Rv on A + BL.
struct Crossed {
    with: System,
    s: Mat<f64>,
    without: System,
    l: Mat<f64>,
}

impl Crossed {
    fn random(source: &mut Source, n: usize, m: usize, radius: f64) -> Self {
        let plain = System::random(source, n, m, radius, 1.0);
        let l = source.matrix(m, n);
        let q = &plain.q + l.transpose() * &plain.r * &l;
        Self {
            s: l.transpose() * &plain.r * -1.0,
            without: System {
                a: &plain.a + &plain.b * &l,
                ..plain.clone()
            },
            with: System {
                q: Mat::from_fn(n, n, |i, j| 0.5 * (q[(i, j)] + q[(j, i)])),
                ..plain
            },
            l,
        }
    }
}

fn crossed_stages(all: &[Crossed]) -> (Vec<Stage<'_>>, Vec<Stage<'_>>) {
    all.iter()
        .map(|c| (c.with.stage().with_cross(c.s.as_ref()), c.without.stage()))
        .unzip()
}

/// The largest relative difference of the P, and of the gains once v = Kx is u = (K + L)x again.
fn gap(
    all: &[Crossed],
    with: (&[Mat<f64>], &[Mat<f64>]),
    without: (&[Mat<f64>], &[Mat<f64>]),
) -> f64 {
    let costs = with.0.iter().zip(without.0);
    let gains = with.1.iter().zip(without.1).zip(all);
    costs
        .map(|(x, y)| norm(&(x - y)) / norm(y))
        .chain(gains.map(|((x, y), c)| norm(&(x - (y + &c.l))) / (1.0 + norm(x))))
        .fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    // 1e-9: Q0 + L'RL is larger than Q0 by up to a hundred, and each stage multiplies by |A + BL|^2.
    #[test]
    fn cross_term_of_a_chain_equals_the_substituted_input((n, m, horizon, seed) in (1..=5_usize, 1..=3_usize, 1..8_usize, any::<u64>())) {
        let mut source = Source(seed);
        let all: Vec<Crossed> = (0..horizon).map(|_| Crossed::random(&mut source, n, m, 1.1)).collect();
        let (with, without) = crossed_stages(&all);
        let terminal = source.weight(n, 1.0);
        let x = BackwardChain::solve(&with, terminal.as_ref()).unwrap();
        let y = BackwardChain::solve(&without, terminal.as_ref()).unwrap();
        let gap = gap(&all, (&x.p, &x.k), (&y.p, &y.k));
        prop_assert!(gap < 1e-9, "{gap:e}");
    }

    #[test]
    fn cross_term_of_a_period_equals_the_substituted_input((n, m, period, seed) in (1..=5_usize, 1..=3_usize, 1..5_usize, any::<u64>())) {
        let mut source = Source(seed);
        let all: Vec<Crossed> = (0..period).map(|_| Crossed::random(&mut source, n, m, 1.1)).collect();
        let (with, without) = crossed_stages(&all);
        let x = PeriodicSolution::solve(&with).unwrap();
        let y = PeriodicSolution::solve(&without).unwrap();
        prop_assume!(y.condition < 1e8);
        let gap = gap(&all, (&x.p, &x.k), (&y.p, &y.k));
        prop_assert!(gap < 1e-7, "{gap:e}");
        // Figures of the same solution in the same coordinates.
        prop_assert!((x.condition / y.condition - 1.0).abs() < 1e-4);
    }
}

#[test]
fn a_cross_term_that_outweighs_the_weights_is_refused_at_its_stage() {
    let eye = mat![[1.0]];
    let (fair, wrong) = (mat![[0.9]], mat![[1.1]]);
    let plain = Stage::new(eye.as_ref(), eye.as_ref(), eye.as_ref(), eye.as_ref());
    let stages = [
        plain.with_cross(fair.as_ref()),
        plain.with_cross(wrong.as_ref()),
    ];
    assert!(PeriodicSolution::solve(&stages[..1]).is_ok());
    for error in [
        PeriodicSolution::solve(&stages).unwrap_err(),
        BackwardChain::solve(&stages, eye.as_ref()).unwrap_err(),
    ] {
        // The eigenvalues of [1 1.1; 1.1 1] are 1 +- 1.1.
        assert!(
            matches!(error, ChainError::IndefiniteWeight { stage: 1, name: "[Q S; S' R]", eigenvalue }
                if (eigenvalue + 0.1).abs() < 1e-15),
            "{error}"
        );
    }
}

#[test]
fn a_period_has_the_condition_and_the_warnings_of_its_stationary_equal() {
    // a = 1.2 through a gain of 1e-8 beside a state that costs nothing to hold.
    let system = System {
        a: mat![[1.2, 0.0], [0.0, 1.1]],
        b: mat![[1e-8], [1.0]],
        q: Mat::identity(2, 2),
        r: Mat::identity(1, 1),
    };
    let stationary = system.dare().solve().unwrap();
    let periodic = PeriodicSolution::solve(&[system.stage()]).unwrap();
    // Rounding times the condition of 1e14.
    assert!((periodic.condition / stationary.condition - 1.0).abs() < 1e-2);
    assert!(stationary.warning.is_some());
    assert_eq!(
        periodic.warning.unwrap().losses,
        [NearLoss::WeakInput, NearLoss::IllConditionedP]
    );
    // Nothing is nearly lost here: the condition of diag(p, 10 p) is ten.
    let mild = System {
        a: mat![[0.5, 0.0], [0.0, 0.5]],
        b: Mat::identity(2, 2),
        q: mat![[1.0, 0.0], [0.0, 10.0]],
        r: mat![[1.0, 0.0], [0.0, 10.0]],
    };
    let mild = PeriodicSolution::solve(&[mild.stage(), mild.stage()]).unwrap();
    assert!((mild.condition - 10.0).abs() < 1e-12 && mild.warning.is_none());
}

#[test]
fn a_slow_period_names_its_weakest_mode() {
    // One mode at 0.99999 that next to no weight moves, reached in the second stage only.
    let (a, q, r) = (mat![[0.99999]], mat![[1e-12]], mat![[1.0]]);
    let (idle, b) = (mat![[0.0]], mat![[1.0]]);
    let stages = [
        Stage::new(a.as_ref(), idle.as_ref(), q.as_ref(), r.as_ref()),
        Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref()),
    ];
    let warning = PeriodicSolution::solve(&stages).unwrap().warning.unwrap();
    assert_eq!(warning.losses, [NearLoss::SlowClosedLoop]);
    assert!(warning.weakest_mode.is_some());
}

#[test]
fn free_multiplier_on_the_circle_is_refused_for_a_singular_input_weight() {
    for zero in [1.0, -1.0] {
        // As for the stationary equation: the output (2 zero - 1, -1) x vanishes along zero^k, and R = 0.
        let c = [2.0 * zero - 1.0, -1.0];
        let (a, b, r) = (
            mat![[0.5, 0.5], [0.5, 1.2]],
            mat![[0.0], [1.0]],
            mat![[0.0]],
        );
        let q = Mat::from_fn(2, 2, |i, j| 0.25 * c[i] * c[j]);
        // The second stage sees the same trajectory through an input in other units.
        let other = mat![[0.0], [3.0]];
        let stages = [
            Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref()),
            Stage::new(a.as_ref(), other.as_ref(), q.as_ref(), r.as_ref()),
        ];
        for period in 1..=2 {
            let error = PeriodicSolution::solve(&stages[..period]).unwrap_err();
            let multiplier = f64::powi(zero, period as i32);
            assert!(
                matches!(&error, ChainError::UnobservableOnCircle { mode } if (mode.eigenvalue.re - multiplier).abs() < 1e-6),
                "{zero} {period}: {error}"
            );
        }
    }
}

#[test]
fn a_singular_input_weight_that_leaves_nothing_on_the_circle_is_solved() {
    // Zero of the output at 0.5: deadbeat for it, and stable.
    let (a, b, r) = (
        mat![[0.5, 0.5], [0.5, 1.2]],
        mat![[0.0], [1.0]],
        mat![[0.0]],
    );
    let c = [0.0, 1.0];
    let q = Mat::from_fn(2, 2, |i, j| c[i] * c[j]);
    let stage = Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref());
    let solution = PeriodicSolution::solve(&[stage; 3]).unwrap();
    // x2 is driven to zero at once, so P = Q and x1 decays by 0.5 a stage.
    assert!(norm(&(&solution.p[0] - &q)) < 1e-13);
    assert!((solution.spectral_radius - 0.125).abs() < 1e-9);
}

#[test]
fn periodic_system_with_an_unreached_multiplier_is_refused() {
    let (a, b) = (mat![[1.1, 0.0], [0.3, 0.9]], mat![[0.0], [1.0]]);
    let (q, r) = (Mat::<f64>::identity(2, 2), Mat::<f64>::identity(1, 1));
    let stage = Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref());
    let error = PeriodicSolution::solve(&[stage; 3]).unwrap_err();
    match error {
        ChainError::NotStabilisable { mode } => {
            assert!((mode.eigenvalue.re - 1.1_f64.powi(3)).abs() < 1e-12);
        }
        other => panic!("{other}"),
    }
}

#[test]
fn periodic_multiplier_on_the_circle_without_weight_is_refused() {
    let (one, zero, effort) = (mat![[1.0]], mat![[0.0]], mat![[1e12]]);
    let stage = Stage::new(one.as_ref(), one.as_ref(), zero.as_ref(), effort.as_ref());
    for period in 1..4 {
        let error = PeriodicSolution::solve(&vec![stage; period]).unwrap_err();
        assert!(
            matches!(&error, ChainError::UnobservableOnCircle { mode } if mode.eigenvalue.re == 1.0),
            "{error}"
        );
    }
}

#[test]
fn a_period_that_overflows_is_an_error() {
    let (a, eye) = (mat![[1e120]], mat![[1.0]]);
    let stage = Stage::new(a.as_ref(), eye.as_ref(), eye.as_ref(), eye.as_ref());
    assert!(PeriodicSolution::solve(&[stage; 4]).is_err());
}

#[test]
fn a_negative_terminal_weight_in_small_units_is_refused() {
    let eye = Mat::<f64>::identity(2, 2);
    let stage = Stage::new(eye.as_ref(), eye.as_ref(), eye.as_ref(), eye.as_ref());
    let with = |least: f64| {
        let terminal = mat![[1e12, 0.0], [0.0, least]];
        BackwardChain::solve(&[stage; 2], terminal.as_ref())
    };
    let refused = with(-1.0);
    assert!(
        matches!(refused, Err(ChainError::IndefiniteWeight { stage: 2, name: "P", eigenvalue }) if (eigenvalue + 1.0).abs() < 1e-3),
        "{refused:?}"
    );
    // A tenth of an ulp of the largest entry is rounding.
    assert!(with(-1e-5).is_ok() && with(1.0).is_ok());
}

#[test]
fn a_period_of_a_day_in_minutes_is_solved() {
    // 1440 stages: as one stage with 1440 inputs the weights alone would take 1440^3 multiplications, and minutes.
    let phase = |i: usize| std::f64::consts::TAU * i as f64 / 1440.0;
    let a: Vec<Mat<f64>> = (0..1440)
        .map(|i| mat![[1.0, 0.1], [0.01 * phase(i).sin(), 1.0]])
        .collect();
    let (b, q, r) = (mat![[0.0], [0.1]], Mat::identity(2, 2), mat![[1.0]]);
    let stages: Vec<Stage<'_>> = a
        .iter()
        .map(|a| Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref()))
        .collect();
    let solution = PeriodicSolution::solve(&stages).unwrap();
    assert!(solution.relative_residual < 1e-12 && solution.spectral_radius < 1.0);
}
