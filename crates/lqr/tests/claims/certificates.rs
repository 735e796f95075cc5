//! Certificates prove what is true for the stored numbers and refute what is not.

use crate::systems::{Source, System, apply, closed_loop};
use faer::{Mat, mat};
use lqr::{
    BackwardChain, Certificate, ChainClaim, Check, Constraints, Dare, Ellipsoid, Rigour, Stage,
    TerminalClaim, largest_volume_ellipsoid,
};
use proptest::prelude::*;

fn check<'a>(certificate: &'a Certificate, name: &str) -> &'a Check {
    certificate
        .checks
        .iter()
        .find(|check| check.name == name)
        .unwrap()
}

fn boxed(source: &mut Source, n: usize, m: usize) -> Constraints {
    let draw: Vec<f64> = (0..m).map(|_| 0.2 + source.uniform()).collect();
    let negative: Vec<f64> = draw.iter().map(|x| -x).collect();
    Constraints::new(n, m)
        .with_input_box(&negative, &draw)
        .unwrap()
        .with_rate_box(&negative, &draw)
        .unwrap()
        .with_state_half_space("f", &source.vector(n), 1.0)
        .unwrap()
}

/// The straight needle of the paper in metres and radians: A = I, B = 0.1 I, Q = 10 I, R = I.
fn straight_needle() -> System {
    System {
        a: Mat::identity(2, 2),
        b: mat![[0.1, 0.0], [0.0, 0.1]],
        q: mat![[10.0, 0.0], [0.0, 10.0]],
        r: Mat::identity(2, 2),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn every_sized_set_can_be_proved((n, m, radius, seed) in (1..=6_usize, 1..=3_usize, 0.3..1.4_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 1.0);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.condition < 1e6);
        let constraints = boxed(&mut source, n, m);
        let claim = TerminalClaim::largest(&system.dare(), &solution, constraints).unwrap();
        prop_assert!(claim.certify().holds(), "{}", claim.certify());
        let (proved, certificate) = claim.provable().map_err(|c| TestCaseError::fail(c.to_string()))?;
        prop_assert_eq!(certificate.rigour, Rigour::Exact);
        // What proof costs: rounding times |A_K|^2 (up to some hundred) times the sum of A_K'^j A_K^j, which a condition of 1e6 lets grow to 1e5.
        // 16,000 systems: worst 2e-7.
        let gap = (&proved.cost - &claim.cost).norm_l2() / claim.cost.norm_l2();
        prop_assert!(gap < 1e-6, "P was raised by {gap:e}");
        prop_assert!(proved.level > claim.level * (1.0 - 1e-6));
    }

    // 1e-5 is above the rounding of the level, so the truth is false: an exact checker that always says yes fails here.
    #[test]
    fn a_level_above_the_largest_is_refuted_with_a_state((n, m, radius, seed) in (1..=6_usize, 1..=3_usize, 0.3..1.4_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 1.0);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.condition < 1e6);
        let constraints = boxed(&mut source, n, m);
        let rows = constraints.under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref()).unwrap();
        let mut claim = TerminalClaim::largest(&system.dare(), &solution, constraints).unwrap();
        claim.level *= 1.0 + 1e-5;
        let certificate = claim.prove();
        let failure = certificate.failures().find(|c| c.witness.is_some() && rows.iter().any(|r| r.name == c.name)).unwrap();
        let witness = failure.witness.clone().unwrap();
        let row = rows.iter().find(|row| row.name == failure.name).unwrap();
        let value: f64 = row.row.iter().zip(&witness.state).map(|(f, x)| f * x).sum();
        prop_assert!(value > row.bound && witness.factor > 1.0);
        let set = Ellipsoid::with_level(claim.set.as_ref(), claim.level).unwrap();
        prop_assert!(set.value(&witness.state).unwrap() <= claim.level * (1.0 + 1e-9));
    }

    #[test]
    fn a_chain_can_be_proved_stage_by_stage((n, m, seed) in (1..=4_usize, 1..=2_usize, any::<u64>())) {
        let mut source = Source(seed);
        let systems: Vec<System> = (0..5).map(|_| System::random(&mut source, n, m, 1.1, 0.5)).collect();
        let stages: Vec<Stage<'_>> = systems.iter()
            .map(System::stage).collect();
        let chain = BackwardChain::solve(&stages, Mat::<f64>::identity(n, n).as_ref()).unwrap();
        let claim = ChainClaim::largest(&stages, &chain, boxed(&mut source, n, m), 1e3).unwrap();
        prop_assert!(claim.certify().holds(), "{}", claim.certify());
        let (_, certificate) = claim.provable().map_err(|c| TestCaseError::fail(c.to_string()))?;
        prop_assert!(certificate.holds());
        let mut wrong = claim.clone();
        wrong.p[2] = Mat::from_fn(n, n, |i, j| claim.p[2][(i, j)] * (1.0 - 1e-6));
        prop_assert!(!wrong.prove().holds() && !wrong.certify().holds());
    }
}

#[test]
fn a_gain_with_one_wrong_sign_loses_its_decrease() {
    let system = straight_needle();
    let mut solution = system.dare().solve().unwrap();
    solution.k[(0, 0)] = -solution.k[(0, 0)];
    let claim =
        TerminalClaim::new(&system.dare(), &solution, 1e-6, Constraints::new(2, 2)).unwrap();
    for certificate in [claim.certify(), claim.prove()] {
        assert!(!check(&certificate, "decrease").holds && !check(&certificate, "invariance").holds);
        // The witness rises: V(x+) - V(x) + l(x) = value > 0 at the unit vector of the first state.
        let witness = check(&certificate, "decrease").witness.clone().unwrap();
        let next = apply(&closed_loop(&system, &solution), &witness.state);
        let v = |x: &[f64]| {
            Ellipsoid::with_level(solution.p.as_ref(), 1.0)
                .unwrap()
                .value(x)
                .unwrap()
        };
        assert!(v(&next) > v(&witness.state));
    }
}

#[test]
fn the_level_ten_of_the_paper_is_refuted_by_factors() {
    let system = straight_needle();
    let solution = system.dare().solve().unwrap();
    let degree = std::f64::consts::PI / 180.0;
    let constraints = Constraints::new(2, 2)
        .with_input_box(&[f64::NEG_INFINITY, -2.0 * degree], &[0.2, 2.0 * degree])
        .unwrap()
        .with_rate_box(&[-0.1, -0.1 * degree], &[0.3, 0.1 * degree])
        .unwrap();
    let claim = TerminalClaim::new(&system.dare(), &solution, 10.0, constraints).unwrap();
    let certificate = claim.prove();
    assert!(!certificate.holds());
    // sqrt(10 / 0.2029), sqrt(10 / 6.18e-3), sqrt(10 / 2.117e-4): levels of the closed form, three digits.
    for (prefix, factor) in [("u0 <=", 7.02), ("u1 <=", 40.2), ("du1 <=", 217.3)] {
        let failure = certificate
            .failures()
            .find(|c| c.name.starts_with(prefix))
            .unwrap();
        let found = failure.witness.as_ref().unwrap().factor;
        assert!((found / factor - 1.0).abs() < 2e-3, "{prefix}: {found}");
    }
    assert!(certificate.to_string().contains("FAILS"));
}

#[test]
fn a_riccati_solution_as_stored_is_refuted_or_proved_but_never_tolerated() {
    // In doubles P misses equality by rounding, so the exact decrease is a coin toss per system: both outcomes must occur.
    let mut source = Source(1);
    let verdicts: Vec<bool> = (0..30)
        .map(|_| {
            let system = System::random(&mut source, 1, 1, 0.9, 0.0);
            let solution = system.dare().solve().unwrap();
            let claim =
                TerminalClaim::new(&system.dare(), &solution, 1.0, Constraints::new(1, 1)).unwrap();
            check(&claim.prove(), "decrease").holds
        })
        .collect();
    assert!(
        verdicts.contains(&true) && verdicts.contains(&false),
        "{verdicts:?}"
    );
}

#[test]
fn a_fraction_of_the_decrease_is_provable_without_touching_p() {
    let system = System::random(&mut Source(4), 6, 2, 1.1, 1.0);
    let solution = system.dare().solve().unwrap();
    let mut claim =
        TerminalClaim::new(&system.dare(), &solution, 1.0, Constraints::new(6, 2)).unwrap();
    // Q > 0, so a billionth of the stage cost covers the rounding.
    claim.decrease_fraction = 1.0 - 1e-9;
    assert!(check(&claim.prove(), "decrease").holds);
}

#[test]
fn largest_volume_set_is_proved_with_the_riccati_cost() {
    let system = System::random(&mut Source(9), 4, 2, 1.1, 1.0);
    let solution = system.dare().solve().unwrap();
    let constraints = boxed(&mut Source(10), 4, 2);
    let rows = constraints
        .under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref())
        .unwrap();
    let set = largest_volume_ellipsoid(closed_loop(&system, &solution).as_ref(), &rows).unwrap();
    let claim = TerminalClaim::largest(&system.dare(), &solution, constraints)
        .unwrap()
        .with_set(&set)
        .unwrap();
    assert!(claim.provable().is_ok());
}

#[test]
fn certificate_survives_serialisation() {
    let system = straight_needle();
    let solution = system.dare().solve().unwrap();
    let constraints = Constraints::new(2, 2)
        .with_input_box(&[-1.0, -1.0], &[1.0, 1.0])
        .unwrap();
    let certificate = TerminalClaim::new(&system.dare(), &solution, 1e4, constraints)
        .unwrap()
        .certify();
    let text = serde_json::to_string(&certificate).unwrap();
    let back: Certificate = serde_json::from_str(&text).unwrap();
    assert_eq!(back.checks.len(), certificate.checks.len());
    // A limit of zero has a margin of minus infinity.
    let zero = Constraints::new(2, 2)
        .with_input_box(&[0.0, -1.0], &[1.0, 1.0])
        .unwrap();
    let certificate_of_zero = TerminalClaim::new(&system.dare(), &solution, 1.0, zero)
        .unwrap()
        .certify();
    let margin = |certificate: &Certificate| check(certificate, "u0 >= 0").margin;
    assert_eq!(margin(&certificate_of_zero), f64::NEG_INFINITY);
    let text = serde_json::to_string(&certificate_of_zero).unwrap();
    let read: Certificate = serde_json::from_str(&text).unwrap();
    assert_eq!(margin(&read), f64::NEG_INFINITY);
    assert!(!back.holds());
    assert_eq!(
        check(&back, "u0 <= 1").witness.is_some(),
        check(&certificate, "u0 <= 1").witness.is_some()
    );
}

#[test]
fn cross_term_enters_the_certificate() {
    let system = System::random(&mut Source(6), 3, 2, 1.1, 0.0);
    let s = mat![[0.1, 0.0], [0.0, 0.1], [0.05, 0.0]];
    let dare = Dare::new(
        system.a.as_ref(),
        system.b.as_ref(),
        system.q.as_ref(),
        system.r.as_ref(),
    )
    .with_cross(s.as_ref());
    let solution = dare.solve().unwrap();
    let claim = TerminalClaim::new(&dare, &solution, 1.0, Constraints::new(3, 2)).unwrap();
    assert!(claim.certify().holds(), "{}", claim.certify());
    let without =
        TerminalClaim::new(&system.dare(), &solution, 1.0, Constraints::new(3, 2)).unwrap();
    assert!(!without.certify().holds());
}

/// A chain of four stages under boxes, its last level at most `terminal_level`.
fn sized_chain(terminal_level: f64) -> ChainClaim {
    let mut source = Source(21);
    let systems: Vec<System> = (0..4)
        .map(|_| System::random(&mut source, 2, 1, 1.1, 0.5))
        .collect();
    let stages: Vec<Stage<'_>> = systems.iter().map(System::stage).collect();
    let chain = BackwardChain::solve(&stages, Mat::<f64>::identity(2, 2).as_ref()).unwrap();
    ChainClaim::largest(&stages, &chain, boxed(&mut source, 2, 1), terminal_level).unwrap()
}

#[test]
fn a_chain_whose_levels_shrink_is_refuted_at_that_stage() {
    let mut claim = sized_chain(1e3);
    // A smaller set violates no constraint: only the nesting is lost.
    claim.levels[1] = 0.5 * claim.levels[0];
    for certificate in [claim.certify(), claim.prove()] {
        assert!(!check(&certificate, "level 0 to 1").holds);
        assert!(check(&certificate, "level 1 to 2").holds);
    }
}

#[test]
fn the_terminal_level_bounds_every_level_of_the_chain() {
    let claim = sized_chain(1e-3);
    assert_eq!(claim.levels.last(), Some(&1e-3));
    assert!(claim.levels.iter().all(|&level| level <= 1e-3));
}

#[test]
fn numbers_that_make_no_claim_are_not_proved() {
    let system = straight_needle();
    let solution = system.dare().solve().unwrap();
    let good = TerminalClaim::new(&system.dare(), &solution, 1.0, Constraints::new(2, 2)).unwrap();
    let spoilt = |spoil: fn(&mut TerminalClaim)| {
        let mut claim = good.clone();
        spoil(&mut claim);
        claim
    };
    for claim in [
        spoilt(|c| c.level = -1.0),
        spoilt(|c| c.level = f64::INFINITY),
        spoilt(|c| c.decrease_fraction = 0.0),
        spoilt(|c| c.cost = Mat::identity(3, 3)),
        spoilt(|c| c.set[(0, 0)] = f64::NAN),
    ] {
        for certificate in [
            claim.certify(),
            claim.prove(),
            claim.provable().unwrap_err(),
        ] {
            assert!(!check(&certificate, "data").holds);
        }
    }
    for level in [-1.0, f64::INFINITY, f64::NAN] {
        let mut claim = sized_chain(1e3);
        claim.levels[4] = level;
        for certificate in [
            claim.certify(),
            claim.prove(),
            claim.provable().unwrap_err(),
        ] {
            assert!(!check(&certificate, "data").holds, "{level}");
        }
    }
}

#[test]
fn a_chain_of_other_shapes_is_refused() {
    let system = straight_needle();
    let stages = [system.stage(); 3];
    let chain = BackwardChain::solve(&stages, Mat::<f64>::identity(2, 2).as_ref()).unwrap();
    let sized = |chain: &BackwardChain, level| {
        ChainClaim::largest(&stages, chain, Constraints::new(2, 2), level)
    };
    assert!(sized(&chain, 1.0).is_ok());
    assert!(sized(&chain, -1.0).is_err() && sized(&chain, f64::NAN).is_err());
    let mut short = chain.clone();
    short.k.pop();
    assert!(sized(&short, 1.0).is_err());
    let mut other = chain.clone();
    other.p[3] = Mat::identity(3, 3);
    assert!(sized(&other, 1.0).is_err());
}
