//! Weights and P keep their sign in every unit: what is indefinite is refused, what only rounds so is not.

use crate::systems::{Source, System};
use faer::{Mat, Side, mat};
use lqr::{Dare, DareError, DareSolution};
use proptest::prelude::*;

fn with_weights(q: &Mat<f64>, r: &Mat<f64>) -> Result<DareSolution, DareError> {
    let (a, b) = (
        Mat::from_fn(2, 2, |i, j| if i == j { 0.5 } else { 0.0 }),
        Mat::identity(2, 2),
    );
    Dare::new(a.as_ref(), Mat::as_ref(&b), q.as_ref(), r.as_ref()).solve()
}

#[test]
fn a_negative_weight_in_small_units_is_refused() {
    let eye = Mat::<f64>::identity(2, 2);
    let small = mat![[1e12, 0.0], [0.0, -1e-3]];
    for (name, found) in [
        ("Q", with_weights(&small, &eye)),
        ("R", with_weights(&eye, &small)),
    ] {
        assert!(
            matches!(found, Err(DareError::IndefiniteWeight { name: at, eigenvalue, tolerance })
                if at == name && (eigenvalue + 1e-3).abs() < 1e-12 && tolerance < 1e-3),
            "{found:?}"
        );
    }
}

#[test]
fn a_coupling_beyond_the_diagonal_is_refused_in_any_units() {
    // The determinant has the sign of 1 - coupling^2; the eigenvalues in doubles are 1e12 and rounding.
    let weight = |coupling: f64| mat![[1e12, coupling], [coupling, 1.0]];
    let eye = Mat::<f64>::identity(2, 2);
    assert!(with_weights(&weight(0.999e6), &eye).is_ok());
    let refused = with_weights(&weight(1.001e6), &eye);
    // x'Qx = 1 - 1.001^2 at x = (-1.001e-6, 1).
    assert!(
        matches!(refused, Err(DareError::IndefiniteWeight { name: "Q", eigenvalue, .. }) if eigenvalue < -1e-3),
        "{refused:?}"
    );
}

fn is_called_indefinite(q: &Mat<f64>) -> bool {
    let found = with_weights(q, &Mat::identity(2, 2));
    matches!(found, Err(DareError::IndefiniteWeight { .. }))
}

#[test]
fn two_ulps_of_the_largest_entry_below_zero_are_rounding() {
    let with = |least: f64| mat![[1.0, 0.0], [0.0, least]];
    assert!(with_weights(&with(-1e-17), &Mat::identity(2, 2)).is_ok());
    assert!(with_weights(&with(0.0), &Mat::identity(2, 2)).is_ok());
    assert!(!is_called_indefinite(&with(-1.9 * f64::EPSILON)));
    assert!(is_called_indefinite(&with(-2.1 * f64::EPSILON)));
}

#[test]
fn a_weight_computed_by_hand_with_a_true_zero_is_no_indefinite_one() {
    // Q - SR^-1S' where [Q S; S' R] has rank 2 of 3: its least eigenvalue is zero, up to rounding of what is subtracted.
    let mut judged = 0;
    for seed in 0..2000 {
        let c = Source(seed).matrix(2, 3);
        let whole = c.transpose() * &c;
        let difference = Mat::from_fn(2, 2, |i, j| {
            whole[(i, j)] - whole[(i, 2)] * whole[(2, j)] / whole[(2, 2)]
        });
        let q = Mat::from_fn(2, 2, |i, j| 0.5 * (difference[(i, j)] + difference[(j, i)]));
        // Where less than half is left, rounding of what went is larger than that of the rest.
        if whole[(0, 0)].max(whole[(1, 1)]) > 2.0 * q.norm_max() {
            continue;
        }
        judged += 1;
        assert!(!is_called_indefinite(&q), "{seed}: {q:?}");
    }
    assert!(judged > 500, "{judged}");
}

#[test]
fn a_weight_of_extreme_size_is_judged_like_any_other() {
    for size in [1e-290, 1e290] {
        let found = with_weights(&mat![[size, 0.0], [0.0, -size]], &Mat::identity(2, 2));
        assert!(
            matches!(found, Err(DareError::IndefiniteWeight { name: "Q", .. })),
            "{size:e}: {found:?}"
        );
    }
}

/// A system with a singular weight, a mode that inputs hardly reach, and states in units of 10^-`digits` to 10^`digits`.
fn wild(source: &mut Source, n: usize, m: usize, digits: f64) -> System {
    let mut power = |digits: f64| 10f64.powf(digits * (2.0 * source.uniform() - 1.0));
    let (units, cost, effort, weak): (Vec<f64>, _, _, _) = (
        (0..n).map(|_| power(digits)).collect(),
        power(6.0),
        power(6.0),
        power(6.0) * 1e-6,
    );
    let rank = 1 + (source.uniform() * n as f64) as usize;
    let mut system = System::random(source, n, m, 1.2, 0.0);
    let c = source.matrix(rank, n);
    for j in 0..m {
        system.b[(n - 1, j)] *= weak;
    }
    let q = c.transpose() * &c;
    System {
        a: Mat::from_fn(n, n, |i, j| system.a[(i, j)] * units[j] / units[i]),
        b: Mat::from_fn(n, m, |i, j| system.b[(i, j)] / units[i]),
        q: Mat::from_fn(n, n, |i, j| {
            0.5 * (q[(i, j)] + q[(j, i)]) * units[i] * units[j] * cost
        }),
        r: system.r * effort,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn a_singular_weight_in_any_units_is_no_indefinite_one((n, m, seed) in (1..=8_usize, 1..=3_usize, any::<u64>()), digits in 0.0..6.0_f64) {
        let system = wild(&mut Source(seed), n, m, digits);
        match system.dare().solve() {
            Ok(solution) => {
                let p = &solution.p;
                let least = p.self_adjoint_eigenvalues(Side::Lower).unwrap().into_iter().fold(f64::INFINITY, f64::min);
                // What the library allows for rounding of the largest entry, and that of the eigenvalues here.
                prop_assert!(least >= -2e-12 * n as f64 * p.norm_max(), "{least:e}");
                // A closed loop in units of 1e-6 to 1e6 has eigenvalues to be had with balancing only.
                let radius = lqr::spectral_radius((&system.a + &system.b * &solution.k).as_ref()).unwrap();
                prop_assert!((radius - solution.spectral_radius).abs() < 1e-4, "{radius}");
            }
            Err(DareError::IndefiniteWeight { name, eigenvalue, .. }) => prop_assert!(false, "{name} {eigenvalue:e}"),
            Err(_) => {}
        }
    }
}

#[test]
fn a_weight_that_rounding_made_negative_does_not_make_p_negative() {
    // q22 = -1e-17 counts as rounding beside 1, and a mode at 1 - 1e-12 that no input moves adds it up to P22 = -5e-6.
    let a = mat![[0.5, 0.0], [0.0, 1.0 - 1e-12]];
    let (b, r) = (mat![[1.0], [0.0]], mat![[1.0]]);
    for (q22, fine) in [(1e-17, true), (-1e-17, false)] {
        let q = mat![[1.0, 0.0], [0.0, q22]];
        let found = Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref()).solve();
        match found {
            Ok(solution) => assert!(fine && solution.p[(1, 1)] > 0.0),
            Err(error) => assert!(
                !fine
                    && matches!(error, DareError::IndefiniteSolution { eigenvalue, .. } if eigenvalue < -1e-6),
                "{error}"
            ),
        }
    }
}
