//! Polytopic terminal sets: caps, and proofs of invariance and admissibility.

use crate::systems::{Source, System, apply, closed_loop};
use faer::{Mat, mat};
use lqr::{AdmissibleSet, Caps, Constraints, Determination, PolytopeClaim, Rigour};
use proptest::prelude::*;

const CAPS: Caps = Caps {
    steps: 200,
    rows: 400,
};

fn asymmetric(source: &mut Source, n: usize, m: usize) -> Constraints {
    let mut draw = |sign: f64| {
        (0..m)
            .map(|_| sign * (0.1 + source.uniform()))
            .collect::<Vec<f64>>()
    };
    let (lower, upper) = (draw(-1.0), draw(1.0));
    let (f, g) = (source.vector(n), source.vector(n));
    Constraints::new(n, m)
        .with_input_box(&lower, &upper)
        .and_then(|c| c.with_state_half_space("f", &f, 1.0))
        .and_then(|c| c.with_state_half_space("g", &g, 0.7))
        .unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn a_maximal_polytope_can_be_proved((n, m, radius, seed) in (1..=4_usize, 1..=2_usize, 0.3..1.3_f64, any::<u64>())) {
        let mut source = Source(seed);
        let system = System::random(&mut source, n, m, radius, 0.5);
        let solution = system.dare().solve().unwrap();
        prop_assume!(solution.spectral_radius < 0.95);
        let constraints = asymmetric(&mut source, n, m);
        let claim = PolytopeClaim::maximal(&system.dare(), &solution, constraints, CAPS).unwrap();
        let determined = matches!(claim.set.determination, Determination::Determined { .. });
        prop_assert!(determined && claim.certify().holds(), "{}", claim.certify());
        let directions: Vec<Vec<f64>> = (0..6).map(|_| source.vector(n)).collect();
        let bounded = (0..n).all(|j| [1.0, -1.0].iter().all(|&sign| {
            let axis: Vec<f64> = (0..n).map(|i| if i == j { sign } else { 0.0 }).collect();
            claim.set.support(&axis).unwrap().is_some_and(f64::is_finite)
        }));
        prop_assume!(bounded);
        let (proved, certificate) = claim.provable(CAPS).map_err(|c| TestCaseError::fail(c.to_string()))?;
        prop_assert_eq!(certificate.rigour, Rigour::Exact);
        for direction in directions {
            let (all, kept) = (claim.set.support(&direction).unwrap().unwrap(), proved.set.support(&direction).unwrap().unwrap());
            // Margins of 1e-8 on the limits and on the law; the law's is amplified by the steps looked ahead.
            prop_assert!(kept <= all * (1.0 + 1e-8) && kept > all * (1.0 - 1e-5), "{kept} of {all}");
        }
        // Rows that are moved out leave some limit or the invariance violated: a proof never says more than that.
        let mut wrong = proved.clone();
        for row in &mut wrong.set.rows {
            row.bound *= 1.0 + 1e-4;
        }
        let refuted = wrong.prove();
        prop_assert!(!refuted.holds(), "{refuted}");
        let failure = refuted.failures().find(|check| check.witness.is_some()).unwrap();
        let witness = failure.witness.as_ref().unwrap();
        prop_assert!(wrong.set.violation(&witness.state).unwrap() < 1e-9 && witness.factor > 1.0);
    }
}

#[test]
fn a_polytope_whose_law_leaves_it_is_refuted_with_a_state_that_leaves() {
    let system = System::random(&mut Source(3), 2, 1, 1.1, 0.0);
    let solution = system.dare().solve().unwrap();
    let constraints = asymmetric(&mut Source(4), 2, 1)
        .with_state_half_space("left", &[-1.0, 0.0], 5.0)
        .and_then(|c| c.with_state_half_space("down", &[0.0, -1.0], 5.0))
        .unwrap();
    let caps = Caps { steps: 0, ..CAPS };
    let claim = PolytopeClaim::maximal(&system.dare(), &solution, constraints, caps).unwrap();
    assert_eq!(claim.set.determination, Determination::CapMet { steps: 0 });
    // Only the constraints of the present: all admissible, and not invariant.
    let floating = claim.certify();
    assert_eq!(floating.failures().count(), 1, "{floating}");
    for certificate in [floating, claim.prove()] {
        let failure = certificate.failures().next().unwrap();
        assert!(failure.name == "invariance" && failure.condition.contains("cap met"));
        let state = &failure.witness.as_ref().unwrap().state;
        assert!(claim.set.violation(state).unwrap() < 1e-12);
        let next = apply(&closed_loop(&system, &solution), state);
        assert!(claim.set.violation(&next).unwrap() > 1e-6);
    }
    assert!(claim.provable(caps).is_err());
}

#[test]
fn the_half_line_of_a_one_sided_limit_is_proved_as_it_is_stored() {
    // u = -x/2 in x+ = x + u with 0 <= u <= 1: P = 2, K = -1/2 for q = 1, r = 2, exact in doubles.
    let system = System {
        a: mat![[1.0]],
        b: mat![[1.0]],
        q: mat![[1.0]],
        r: mat![[2.0]],
    };
    let mut solution = system.dare().solve().unwrap();
    solution.k = mat![[-0.5]];
    let constraints = Constraints::new(1, 1)
        .with_input_box(&[0.0], &[1.0])
        .unwrap();
    let claim = PolytopeClaim::maximal(&system.dare(), &solution, constraints, CAPS).unwrap();
    assert!(claim.prove().holds(), "{}", claim.prove());
}

#[test]
fn one_sided_inputs_pass_their_own_certificate() {
    // 0 <= u0 <= 1 under random laws: the origin is on the boundary, and a zero limit has no size that rounding could be relative to.
    let mut determined = 0;
    for seed in 0..40 {
        let mut source = Source(seed);
        let n = 2 + (seed % 2) as usize;
        let system = System::random(&mut source, n, 1, 0.9, 0.5);
        let solution = system.dare().solve().unwrap();
        let boxed = (0..n).try_fold(Constraints::new(n, 1), |all, j| {
            let axis = |sign: f64| -> Vec<f64> {
                (0..n).map(|i| if i == j { sign } else { 0.0 }).collect()
            };
            all.with_state_half_space("above", &axis(1.0), 1.0)?
                .with_state_half_space("below", &axis(-1.0), 1.0)
        });
        let constraints = boxed
            .and_then(|c| c.with_input_box(&[0.0], &[1.0]))
            .unwrap();
        let claim = PolytopeClaim::maximal(&system.dare(), &solution, constraints, CAPS).unwrap();
        if !matches!(claim.set.determination, Determination::Determined { .. }) {
            continue;
        }
        determined += 1;
        let certificate = claim.certify();
        assert!(certificate.holds(), "{seed}: {certificate}");
        assert!(
            certificate
                .checks
                .iter()
                .all(|check| check.margin.is_finite()),
            "{certificate}"
        );
        // What violates a zero limit beyond rounding still fails.
        let mut wrong = claim.clone();
        for row in &mut wrong.set.rows {
            row.bound += 1e-6;
        }
        assert!(!wrong.certify().holds(), "{seed}");
    }
    assert!(determined >= 20, "{determined}");
}

#[test]
fn a_row_that_misses_by_one_rounding_is_not_proved() {
    // x+ = x/2 in |x| <= 1 is proved; the limit lowered by one ulp is not, and no floating-point check sees it.
    let system = System {
        a: mat![[0.5]],
        b: mat![[1.0]],
        q: mat![[1.0]],
        r: mat![[1.0]],
    };
    let mut solution = system.dare().solve().unwrap();
    solution.k = mat![[0.0]];
    let boxed = |limit: f64| {
        Constraints::new(1, 1)
            .with_state_half_space("right", &[1.0], limit)
            .and_then(|c| c.with_state_half_space("left", &[-1.0], 1.0))
            .unwrap()
    };
    let claim =
        |limit| PolytopeClaim::maximal(&system.dare(), &solution, boxed(limit), CAPS).unwrap();
    assert!(claim(1.0).prove().holds());
    let mut tight = claim(1.0 - f64::EPSILON);
    tight.set = claim(1.0).set;
    assert!(tight.certify().holds() && !tight.prove().holds());
}

#[test]
fn a_slab_that_a_coupling_below_rounding_leads_out_of_is_not_proved() {
    // x1+ = x1/2 + 1e-20 x2 over |x1| <= 1 with x2 free: no multiplier of the slab makes up for the 1e-20.
    let law = |coupling: f64| {
        let system = System {
            a: mat![[0.5, coupling], [0.0, 0.5]],
            b: mat![[1.0], [1.0]],
            q: mat![[1.0, 0.0], [0.0, 1.0]],
            r: mat![[1.0]],
        };
        let mut solution = system.dare().solve().unwrap();
        solution.k = mat![[0.0, 0.0]];
        let slab = Constraints::new(2, 1)
            .with_state_half_space("right", &[1.0, 0.0], 1.0)
            .and_then(|c| c.with_state_half_space("left", &[-1.0, 0.0], 1.0))
            .unwrap();
        PolytopeClaim::maximal(&system.dare(), &solution, slab, CAPS).unwrap()
    };
    let mut leaky = law(1e-20);
    leaky.set = law(0.0).set;
    assert!(law(0.0).prove().holds());
    assert!(leaky.certify().holds() && !leaky.prove().holds());
}

#[test]
fn too_many_rows_meet_their_cap_and_say_so() {
    let (c, s) = (0.99 * 0.3_f64.cos(), 0.99 * 0.3_f64.sin());
    let a = mat![[c, -s], [s, c]];
    let rows = Constraints::new(2, 1)
        .with_state_half_space("right", &[1.0, 0.0], 1.0)
        .unwrap()
        .under_law(
            a.as_ref(),
            mat![[0.0], [0.0]].as_ref(),
            mat![[0.0, 0.0]].as_ref(),
        )
        .unwrap();
    let set = |rows_cap| {
        AdmissibleSet::maximal_within(
            a.as_ref(),
            &rows,
            Caps {
                steps: 500,
                rows: rows_cap,
            },
        )
        .unwrap()
    };
    assert_eq!(
        set(8).determination,
        Determination::RowCapMet { rows: 9, steps: 8 }
    );
    let full = set(400);
    assert!(matches!(full.determination, Determination::Determined { .. }) && full.rows.len() > 8);
}

/// x+ = x/2 in the box |x1|, |x2| <= `limit`, with a further half-space.
fn box_with(limit: f64, further: &[f64], bound: f64) -> PolytopeClaim {
    let system = System {
        a: mat![[0.5, 0.0], [0.0, 0.5]],
        b: mat![[1.0], [1.0]],
        q: mat![[1.0, 0.0], [0.0, 1.0]],
        r: mat![[1.0]],
    };
    let mut solution = system.dare().solve().unwrap();
    solution.k = mat![[0.0, 0.0]];
    let sides = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
    let constraints = sides.iter().try_fold(Constraints::new(2, 1), |all, side| {
        all.with_state_half_space("side", side, limit)
    });
    let constraints = constraints
        .and_then(|c| c.with_state_half_space("further", further, bound))
        .unwrap();
    PolytopeClaim::maximal(&system.dare(), &solution, constraints, CAPS).unwrap()
}

#[test]
fn the_length_of_a_row_does_not_change_what_is_said_of_it() {
    for unit in [1e-200, 1e-12, 1.0, 1e12] {
        let free = box_with(1.0, &[unit, unit], 3.0 * unit);
        // x1 + x2 reaches 2 over the box.
        let reach = free.set.support(&[unit, unit]).unwrap().unwrap();
        assert!((reach / unit - 2.0).abs() < 1e-12, "{reach:e}");
        let mut tight = box_with(1.0, &[unit, unit], 0.5 * unit);
        assert!(tight.certify().holds());
        tight.set = free.set;
        for refuted in [tight.certify(), tight.prove()] {
            let failure = refuted.failures().find(|check| check.name == "further");
            let factor = failure.unwrap().witness.as_ref().unwrap().factor;
            assert!((factor - 4.0).abs() < 1e-11, "{unit:e}: {factor}");
        }
    }
}

#[test]
fn bounds_far_below_one_are_told_apart() {
    // Steps that differ by a tenth at 1e-12 are no tie: the cut at 1.9 of the corner's 2 stays.
    for unit in [1e-15, 1e-12, 1.0] {
        let claim = box_with(unit, &[1.0, 1.0], 1.9 * unit);
        let reach = claim.set.support(&[1.0, 1.0]).unwrap().unwrap();
        assert!((reach / unit - 1.9).abs() < 1e-9, "{unit:e}: {reach:e}");
        assert_eq!(claim.set.rows.len(), 5);
        assert!(claim.certify().holds() && claim.provable(CAPS).is_ok());
    }
}

#[test]
fn the_unit_of_the_state_does_not_change_the_polytope() {
    let system = System::random(&mut Source(5), 3, 1, 0.9, 0.0);
    let solution = system.dare().solve().unwrap();
    let step = closed_loop(&system, &solution);
    let index_in = |unit: f64| {
        let constraints = Constraints::new(3, 1)
            .with_state_half_space("f", &[1.0, 0.2, -0.3], unit)
            .and_then(|c| c.with_state_half_space("g", &[-0.4, 1.0, 0.1], 0.5 * unit))
            .and_then(|c| c.with_state_half_space("h", &[0.0, -1.0, -1.0], unit))
            .unwrap();
        let rows = constraints
            .under_law(system.a.as_ref(), system.b.as_ref(), solution.k.as_ref())
            .unwrap();
        let set = AdmissibleSet::maximal(step.as_ref(), &rows, 300).unwrap();
        (set.determination, set.rows.len())
    };
    assert_eq!(index_in(1.0), index_in(1e-9));
    assert_eq!(index_in(1.0), index_in(1e9));
}

#[test]
fn an_input_that_may_not_move_leaves_the_origin_and_that_is_proved() {
    let (a, b) = (mat![[1.0, 0.1], [0.0, 1.0]], mat![[0.005], [0.1]]);
    let (q, r) = (Mat::<f64>::identity(2, 2), mat![[1.0]]);
    let dare = lqr::Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref());
    let solution = dare.solve().unwrap();
    let limits = Constraints::new(2, 1)
        .with_input_box(&[0.0], &[0.0])
        .unwrap();
    let claim = PolytopeClaim::maximal(&dare, &solution, limits, CAPS).unwrap();
    assert_eq!(claim.set.support(&[1.0, -1.0]), Ok(Some(0.0)));
    let certificate = claim.prove();
    assert!(certificate.holds(), "{certificate}");
}
