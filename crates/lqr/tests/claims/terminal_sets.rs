//! Terminal sets keep what they promise: invariance, admissibility, tightness, and the most volume.

use crate::systems::{Source, System, apply, closed_loop};
use faer::{Mat, mat};
use lqr::{
    AdmissibleSet, ConstraintKind, Constraints, Determination, Ellipsoid, LevelReason,
    RateAugmented, TerminalSetError, chain_levels, largest_volume_ellipsoid,
};
use proptest::prelude::*;

/// Random limits on inputs, rates and two state directions.
fn limits(source: &mut Source, n: usize, m: usize) -> Constraints {
    let mut draw = |count: usize| {
        (0..count)
            .map(|_| 0.1 + source.uniform())
            .collect::<Vec<f64>>()
    };
    let (upper, lower, rate) = (draw(m), draw(m), draw(m));
    let negative = |v: &[f64]| v.iter().map(|x| -x).collect::<Vec<f64>>();
    let constraints = Constraints::new(n, m)
        .with_input_box(&negative(&lower), &upper)
        .unwrap()
        .with_rate_box(&negative(&rate), &rate)
        .unwrap();
    let (f, g) = (source.vector(n), source.vector(n));
    constraints
        .with_state_half_space("f", &f, 1.0)
        .unwrap()
        .with_state_half_space("g", &g, 0.7)
        .unwrap()
}

/// The largest (row value - bound) / bound over the constraints for states x, inputs u and changes du.
fn worst_excess(constraints: &Constraints, x: &[f64], u: &[f64], du: &[f64]) -> (f64, String) {
    let dot = |f: &[f64], v: &[f64]| f.iter().zip(v).map(|(f, v)| f * v).sum::<f64>();
    constraints
        .rows()
        .iter()
        .map(|c| {
            let value = dot(&c.on_x, x) + dot(&c.on_u, u) + dot(&c.on_rate, du);
            (value / c.bound - 1.0, c.name.clone())
        })
        .fold((f64::NEG_INFINITY, String::new()), |a, b| {
            if b.0 > a.0 { b } else { a }
        })
}

/// The point of the boundary in a direction of the state.
fn boundary_point(set: &Ellipsoid, direction: &[f64]) -> Vec<f64> {
    let scale = (set.level / set.value(direction).unwrap()).sqrt();
    direction.iter().map(|x| scale * x).collect()
}

fn difference(x: &[f64], y: &[f64]) -> Vec<f64> {
    x.iter().zip(y).map(|(x, y)| x - y).collect()
}

/// The system with its last input as a state and this weight on rates, and the solution of its Riccati equation.
fn rate_augmented(system: &System, r_rate: &Mat<f64>) -> (RateAugmented, lqr::DareSolution) {
    let augmented = RateAugmented::new(
        system.a.as_ref(),
        system.b.as_ref(),
        system.q.as_ref(),
        system.r.as_ref(),
        r_rate.as_ref(),
    )
    .unwrap();
    let solution = lqr::Dare::new(
        augmented.a.as_ref(),
        augmented.b.as_ref(),
        augmented.q.as_ref(),
        augmented.r.as_ref(),
    )
    .with_cross(augmented.s.as_ref())
    .solve()
    .unwrap();
    (augmented, solution)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(80))]

    // 1e-8: level and value of the set carry rounding times the condition of P, kept below 1e6 here.
    #[test]
    fn trajectories_stay_in_the_ellipsoid_and_within_every_limit(
        (n, m, radius, seed) in (1..=8_usize, 1..=3_usize, 0.3..1.5_f64, any::<u64>()), inside in 0.0..1.0_f64,
    ) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 1.0);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.condition < 1e6);
        let constraints = limits(&mut source, n, m);
        let rows = constraints.under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref()).unwrap();
        let set = Ellipsoid::largest(solution.p.as_ref(), &rows).unwrap();
        let step = closed_loop(&system, &solution);
        for shrink in [1.0, inside] {
            let mut x: Vec<f64> = boundary_point(&set, &source.vector(n)).iter().map(|v| v * shrink).collect();
            for k in 0..200 {
                let next = apply(&step, &x);
                let (u, after) = (apply(&solution.k, &x), apply(&solution.k, &next));
                let (excess, name) = worst_excess(&constraints, &x, &u, &difference(&after, &u));
                let level = set.value(&x).unwrap() / set.level - 1.0;
                prop_assert!(level < 1e-8, "step {k}: level exceeded by {level:e}");
                prop_assert!(excess < 1e-8, "step {k}: {name} exceeded by {excess:e}");
                x = next;
            }
        }
    }

    #[test]
    fn a_slightly_larger_ellipsoid_violates_the_active_constraint((n, m, radius, seed) in (1..=8_usize, 1..=3_usize, 0.3..1.5_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 1.0);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.condition < 1e6);
        let constraints = limits(&mut source, n, m);
        let rows = constraints.under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref()).unwrap();
        let set = Ellipsoid::largest(solution.p.as_ref(), &rows).unwrap();
        let LevelReason::Active { name, .. } = &set.reason else { panic!("{:?}", set.reason) };
        let row = rows.iter().find(|row| &row.name == name).unwrap();
        let larger = Ellipsoid::with_level(solution.p.as_ref(), set.level * (1.0 + 1e-6)).unwrap();
        let x = larger.extreme_point(&row.row).unwrap();
        let value: f64 = row.row.iter().zip(&x).map(|(f, x)| f * x).sum();
        // sqrt(1 + 1e-6) - 1 = 5e-7, far above the rounding of a P of condition 1e6.
        prop_assert!(value > row.bound * (1.0 + 4e-7), "{value} against {}", row.bound);
    }

    // The set is sized with the last input as a state, so the *first* change after any admissible past is within its limit too.
    #[test]
    fn augmented_set_bounds_the_first_change_after_an_outside_input((n, m, radius, seed) in (1..=4_usize, 1..=2_usize, 0.3..1.3_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 0.5);
        let (augmented, solution) = rate_augmented(&system, &Mat::identity(m, m));
        prop_assume!(solution.condition < 1e6);
        let original = limits(&mut source, n, m);
        let rows = RateAugmented::constraints(&original)
            .under_law(augmented.a.as_ref(), augmented.b.as_ref(), solution.k.as_ref()).unwrap();
        let set = Ellipsoid::largest(solution.p.as_ref(), &rows).unwrap();
        let mut z = boundary_point(&set, &source.vector(n + m));
        for k in 0..100 {
            let (x, last) = z.split_at(n);
            let du = apply(&solution.k, &z);
            let u: Vec<f64> = last.iter().zip(&du).map(|(u, d)| u + d).collect();
            let (excess, name) = worst_excess(&original, x, &u, &du);
            prop_assert!(excess < 1e-8, "step {k}: {name} exceeded by {excess:e}");
            // The plant as the caller has it, without the augmented matrices.
            let ax = apply(&system.a, x);
            let bu = apply(&system.b, &u);
            z = ax.iter().zip(&bu).map(|(a, b)| a + b).chain(u).collect();
        }
    }

    #[test]
    fn largest_volume_ellipsoid_is_invariant_admissible_and_no_smaller((n, m, radius, seed) in (1..=5_usize, 1..=2_usize, 0.3..1.3_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 1.0);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.condition < 1e5 && solution.spectral_radius < 0.98);
        let constraints = limits(&mut source, n, m);
        let rows = constraints.under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref()).unwrap();
        let step = closed_loop(&system, &solution);
        let riccati = Ellipsoid::largest(solution.p.as_ref(), &rows).unwrap();
        let best = largest_volume_ellipsoid(step.as_ref(), &rows).unwrap();
        // The Riccati set is a feasible point of the program, which is solved to 1e-6 in 2 log(volume).
        prop_assert!(best.log_volume() > riccati.log_volume() - 1e-6, "{} {}", best.log_volume(), riccati.log_volume());
        for row in &rows {
            prop_assert!(best.support(&row.row).unwrap() <= row.bound * (1.0 + 1e-9));
        }
        for _ in 0..20 {
            let x = boundary_point(&best, &source.vector(n));
            prop_assert!(best.value(&apply(&step, &x)).unwrap() <= 1.0 + 1e-9);
        }
    }

    #[test]
    fn admissible_polytope_is_invariant_and_holds_the_ellipsoid((n, m, radius, seed) in (1..=3_usize, 1..=2_usize, 0.3..1.3_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 1.0);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.condition < 1e5 && solution.spectral_radius < 0.9);
        let constraints = limits(&mut source, n, m);
        let rows = constraints.under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref()).unwrap();
        let step = closed_loop(&system, &solution);
        let set = AdmissibleSet::maximal(step.as_ref(), &rows, 200).unwrap();
        let determined = matches!(set.determination, Determination::Determined { .. });
        prop_assert!(determined);
        // Invariance without the method's own programs' order: the support of every row moved one step on.
        for row in &set.rows {
            let ahead = apply(&step.transpose().to_owned(), &row.row);
            prop_assert!(set.support(&ahead).unwrap().unwrap() <= row.bound + 1e-8 * (1.0 + row.bound));
        }
        let ellipsoid = Ellipsoid::largest(solution.p.as_ref(), &rows).unwrap();
        for row in &set.rows {
            prop_assert!(ellipsoid.support(&row.row).unwrap() <= row.bound + 1e-8 * (1.0 + row.bound));
        }
        // Maximal: what is outside violates a limit within its own trajectory.
        let mut outside = boundary_point(&ellipsoid, &source.vector(n));
        while set.violation(&outside).unwrap() < 1e-3 {
            outside = outside.iter().map(|x| 1.2 * x).collect();
        }
        let mut worst = f64::NEG_INFINITY;
        for _ in 0..300 {
            for row in &rows {
                worst = worst.max(row.row.iter().zip(&outside).map(|(f, x)| f * x).sum::<f64>() - row.bound);
            }
            outside = apply(&step, &outside);
        }
        prop_assert!(worst > 0.0);
    }

    #[test]
    fn chain_of_sets_maps_each_into_the_next((n, m, seed) in (1..=5_usize, 1..=2_usize, any::<u64>())) {
        let mut source = Source(seed);
        let systems: Vec<System> = (0..6).map(|_| System::random(&mut source, n, m, 1.1, 0.5)).collect();
        let stages: Vec<lqr::Stage<'_>> = systems.iter()
            .map(System::stage).collect();
        let chain = lqr::BackwardChain::solve(&stages, Mat::<f64>::identity(n, n).as_ref()).unwrap();
        let limit = limits(&mut source, n, m);
        let mut rows: Vec<_> = (0..6).map(|i| limit.under_law(systems[i].a.as_ref(), systems[i].b.as_ref(), chain.k[i].as_ref()).unwrap()).collect();
        rows.push(Vec::new());
        let sets = chain_levels(&chain.p, &rows).unwrap();
        for i in 0..6 {
            prop_assert!(sets[i].level <= sets[i + 1].level);
            let x = boundary_point(&sets[i], &source.vector(n));
            let u = apply(&chain.k[i], &x);
            let next: Vec<f64> = apply(&systems[i].a, &x).iter().zip(apply(&systems[i].b, &u)).map(|(a, b)| a + b).collect();
            prop_assert!(sets[i + 1].value(&next).unwrap() <= sets[i].level * (1.0 + 1e-9));
        }
    }
}

#[test]
fn a_limit_of_zero_leaves_the_origin_and_says_why() {
    let constraints = Constraints::new(1, 1)
        .with_input_box(&[0.0], &[1.0])
        .unwrap();
    let rows = constraints
        .under_law(
            mat![[1.0]].as_ref(),
            mat![[1.0]].as_ref(),
            mat![[-0.5]].as_ref(),
        )
        .unwrap();
    let set = Ellipsoid::largest(mat![[2.0]].as_ref(), &rows).unwrap();
    assert_eq!(set.level, 0.0);
    assert_eq!(
        set.reason,
        LevelReason::ZeroLimit {
            name: "u0 >= 0".to_owned(),
            kind: ConstraintKind::Input
        }
    );
}

#[test]
fn an_input_that_the_law_does_not_use_is_no_constraint() {
    let constraints = Constraints::new(1, 2)
        .with_input_box(&[-1.0, 0.0], &[1.0, 0.0])
        .unwrap();
    let (a, b, k) = (mat![[1.0]], mat![[1.0, 1.0]], mat![[-0.5], [0.0]]);
    let rows = constraints
        .under_law(a.as_ref(), b.as_ref(), k.as_ref())
        .unwrap();
    let set = Ellipsoid::largest(mat![[1.0]].as_ref(), &rows).unwrap();
    assert!((set.level - 4.0).abs() < 1e-15);
}

#[test]
fn largest_volume_in_a_box_is_the_ball_for_a_contraction() {
    // A_K = 0.5 I maps everything inside; the largest ellipsoid in |x_i| <= h_i has the h_i as half-axes.
    let constraints = Constraints::new(2, 1)
        .with_state_half_space("right", &[1.0, 0.0], 3.0)
        .and_then(|c| c.with_state_half_space("up", &[0.0, 1.0], 0.2))
        .unwrap();
    let a = mat![[0.5, 0.0], [0.0, 0.5]];
    let rows = constraints
        .under_law(
            a.as_ref(),
            mat![[0.0], [0.0]].as_ref(),
            mat![[0.0, 0.0]].as_ref(),
        )
        .unwrap();
    let set = largest_volume_ellipsoid(a.as_ref(), &rows).unwrap();
    for row in &rows {
        assert!(set.support(&row.row).unwrap() <= row.bound * (1.0 + 1e-9));
    }
    // No other ellipsoid in the box has this volume; the program is solved to 1e-6 in 2 log(volume).
    let gap = set.log_volume() - 0.6_f64.ln();
    assert!(gap.abs() < 1e-6, "{gap:e}");
}

#[test]
fn one_sided_limit_keeps_the_half_line_as_a_polytope_where_the_ellipsoid_is_a_point() {
    // u = -x/2 in x+ = x + u with 0 <= u <= 1: the states -2 <= x <= 0, exactly.
    let constraints = Constraints::new(1, 1)
        .with_input_box(&[0.0], &[1.0])
        .unwrap();
    let rows = constraints
        .under_law(
            mat![[1.0]].as_ref(),
            mat![[1.0]].as_ref(),
            mat![[-0.5]].as_ref(),
        )
        .unwrap();
    let set = AdmissibleSet::maximal(mat![[0.5]].as_ref(), &rows, 10).unwrap();
    let error = largest_volume_ellipsoid(mat![[0.5]].as_ref(), &rows).unwrap_err();
    assert!(
        matches!(&error, TerminalSetError::NoInterior { name, .. } if name == "u0 >= 0"),
        "{error}"
    );
    assert_eq!(set.determination, Determination::Determined { index: 0 });
    assert_eq!(set.support(&[1.0]), Ok(Some(0.0)));
    assert_eq!(set.support(&[-1.0]), Ok(Some(2.0)));
    assert!(set.support(&[1.0, 0.0]).is_err() && set.support(&[f64::NAN]).is_err());
}

#[test]
fn slow_rotation_meets_the_cap_and_says_so() {
    let (c, s) = (0.999 * 0.1_f64.cos(), 0.999 * 0.1_f64.sin());
    let a = mat![[c, -s], [s, c]];
    let constraints = Constraints::new(2, 1)
        .with_state_half_space("right", &[1.0, 0.0], 1.0)
        .unwrap();
    let rows = constraints
        .under_law(
            a.as_ref(),
            mat![[0.0], [0.0]].as_ref(),
            mat![[0.0, 0.0]].as_ref(),
        )
        .unwrap();
    let capped = AdmissibleSet::maximal(a.as_ref(), &rows, 5).unwrap();
    assert_eq!(capped.determination, Determination::CapMet { steps: 5 });
    let full = AdmissibleSet::maximal(a.as_ref(), &rows, 500).unwrap();
    assert!(matches!(full.determination, Determination::Determined { index } if index > 5));
}

#[test]
fn augmented_constraints_take_the_values_of_the_original_ones() {
    let mut source = Source(17);
    let (n, m) = (3, 2);
    let original = limits(&mut source, n, m);
    let augmented = RateAugmented::constraints(&original);
    let (x, last, du) = (source.vector(n), source.vector(m), source.vector(m));
    let z: Vec<f64> = x.iter().chain(&last).copied().collect();
    let u: Vec<f64> = last.iter().zip(&du).map(|(u, d)| u + d).collect();
    let dot = |f: &[f64], v: &[f64]| f.iter().zip(v).map(|(f, v)| f * v).sum::<f64>();
    for (old, new) in original.rows().iter().zip(augmented.rows()) {
        let value = dot(&old.on_x, &x) + dot(&old.on_u, &u) + dot(&old.on_rate, &du);
        let found = dot(&new.on_x, &z) + dot(&new.on_u, &du) + dot(&new.on_rate, &du);
        // Sums of eight terms of order one.
        assert!((value - found).abs() < 1e-14, "{}", old.name);
    }
}

#[test]
fn a_row_that_a_later_one_implies_is_dropped() {
    // x <= 2 comes first and is needed until x <= 1 is seen.
    let constraints = Constraints::new(1, 1)
        .with_state_half_space("wide", &[1.0], 2.0)
        .and_then(|c| c.with_state_half_space("narrow", &[1.0], 1.0))
        .and_then(|c| c.with_state_half_space("lower", &[-1.0], 1.0))
        .unwrap();
    let (a, b, k) = (mat![[0.5]], mat![[1.0]], mat![[0.0]]);
    let rows = constraints
        .under_law(a.as_ref(), b.as_ref(), k.as_ref())
        .unwrap();
    let set = AdmissibleSet::maximal(a.as_ref(), &rows, 10).unwrap();
    let names: Vec<&str> = set.rows.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(names, ["narrow", "lower"]);
}

#[test]
fn an_unbounded_set_has_no_boundary_and_no_nan() {
    let set = Ellipsoid::largest(mat![[2.0, 0.0], [0.0, 1.0]].as_ref(), &[]).unwrap();
    assert!(set.extreme_point(&[1.0, 0.0]).is_err());
    assert_eq!(set.extreme_point(&[0.0, 0.0]), Ok(vec![0.0, 0.0]));
    assert_eq!(set.support(&[0.0, 0.0]), Ok(0.0));
    assert_eq!(set.support(&[1.0, 0.0]), Ok(f64::INFINITY));
}

#[test]
fn a_bound_that_is_none_is_refused() {
    let row = |bound| lqr::LawRow {
        name: "row".to_owned(),
        kind: ConstraintKind::State,
        row: vec![1e100],
        bound,
    };
    let sized = |bound| Ellipsoid::largest(mat![[1.0]].as_ref(), &[row(bound)]);
    for bound in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(sized(bound).is_err(), "{bound}");
        let polytope = AdmissibleSet::maximal(mat![[0.5]].as_ref(), &[row(bound)], 5);
        assert!(polytope.is_err(), "{bound}");
    }
    // The square of the bound overflows; the level is 1e200.
    assert!((sized(1e200).unwrap().level / 1e200 - 1.0).abs() < 1e-14);
}

#[test]
fn without_a_weight_on_the_rate_the_augmented_law_is_the_plain_one() {
    let system = System::random(&mut Source(12), 3, 2, 1.2, 0.5);
    let plain = system.dare().solve().unwrap();
    let (_, solution) = rate_augmented(&system, &Mat::zeros(2, 2));
    // P = diag(P_x, 0) and du = Kx - u_prev, up to rounding of a well-conditioned problem.
    let p = Mat::from_fn(
        5,
        5,
        |i, j| {
            if i < 3 && j < 3 { plain.p[(i, j)] } else { 0.0 }
        },
    );
    let k = Mat::from_fn(2, 5, |i, j| match j {
        0..3 => plain.k[(i, j)],
        _ if j == i + 3 => -1.0,
        _ => 0.0,
    });
    assert!((&solution.p - &p).norm_max() < 1e-12 * plain.p.norm_max());
    assert!((&solution.k - &k).norm_max() < 1e-12);
    assert!(
        solution
            .warning
            .unwrap()
            .losses
            .contains(&lqr::NearLoss::IllConditionedP)
    );
}

#[test]
fn without_a_weight_on_the_rate_there_is_no_level_set() {
    // What rounding leaves of the zeros of P may be positive: 1e-48 in one of these systems, a set of half-axes 1e24.
    for seed in 0..60 {
        let mut source = Source(seed);
        let (n, m) = (1 + seed as usize % 6, 1 + seed as usize % 3);
        let system = System::random(&mut source, n, m, 1.2, 0.5);
        // The last input's change has no weight, the others' may have one.
        let weight = |i: usize, j: usize| f64::from(i == j && i + 1 < m && seed % 2 == 0);
        let (_, solution) = rate_augmented(&system, &Mat::from_fn(m, m, weight));
        assert!(solution.condition.is_infinite(), "seed {seed}");
        assert_eq!(
            Ellipsoid::largest(solution.p.as_ref(), &[]).unwrap_err(),
            TerminalSetError::NotPositiveDefinite,
            "seed {seed}"
        );
    }
}

#[test]
fn the_largest_volume_is_strictly_more_where_the_riccati_set_is_lopsided() {
    // A_K = 0.5 I, so every ellipsoid is invariant: in the unit square the disc has the most area, pi. Of the level sets of
    // diag(1, 100) the largest has half-axes 1 and 0.1: a tenth.
    let rows: Vec<lqr::LawRow> = [[1.0, 0.0], [0.0, 1.0]]
        .iter()
        .map(|row| lqr::LawRow {
            name: "side".to_owned(),
            kind: ConstraintKind::State,
            row: row.to_vec(),
            bound: 1.0,
        })
        .collect();
    let riccati = Ellipsoid::largest(mat![[1.0, 0.0], [0.0, 100.0]].as_ref(), &rows).unwrap();
    let best = largest_volume_ellipsoid(mat![[0.5, 0.0], [0.0, 0.5]].as_ref(), &rows).unwrap();
    let gain = best.log_volume() - riccati.log_volume();
    assert!((gain - 10.0_f64.ln()).abs() < 1e-6, "{gain}");
}

#[test]
fn a_double_integrator_gains_volume_over_its_riccati_set() {
    let system = System {
        a: mat![[1.0, 0.1], [0.0, 1.0]],
        b: mat![[0.005], [0.1]],
        q: mat![[1.0, 0.0], [0.0, 0.1]],
        r: mat![[0.1]],
    };
    let solution = system.dare().solve().unwrap();
    let rows = Constraints::new(2, 1)
        .with_input_box(&[-1.0], &[1.0])
        .and_then(|c| c.with_state_half_space("speed", &[0.0, 1.0], 0.5))
        .unwrap()
        .under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref())
        .unwrap();
    let riccati = Ellipsoid::largest(solution.p.as_ref(), &rows).unwrap();
    let best = largest_volume_ellipsoid(closed_loop(&system, &solution).as_ref(), &rows).unwrap();
    let gain = best.log_volume() - riccati.log_volume();
    assert!(gain > 0.05, "{gain}");
}
