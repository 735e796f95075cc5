//! Examples of the DAREX collection (P. Benner, A. Laub, V. Mehrmann, "A collection of benchmark examples for the numerical solution of
//! algebraic Riccati equations II: discrete-time case", 1995), entered as numbers, with the solutions known in closed form.

use crate::systems::{System, norm, textbook_residual};
use faer::{Mat, mat};
use lqr::{Dare, DareError};

/// Relative error of the solution in the Frobenius norm.
fn error(system: &System, expected: &Mat<f64>) -> f64 {
    let solution = system.dare().solve().unwrap();
    assert!(solution.spectral_radius < 1.0);
    norm(&(&solution.p - expected)) / norm(expected)
}

#[test]
fn van_dooren_with_zero_input_weight_is_the_identity() {
    let system = System {
        a: mat![[2.0, -1.0], [1.0, 0.0]],
        b: mat![[1.0], [0.0]],
        q: mat![[0.0, 0.0], [0.0, 1.0]],
        r: mat![[0.0]],
    };
    assert!(error(&system, &Mat::identity(2, 2)) < 1e-13);
}

#[test]
fn nilpotent_pair_has_two_plus_root_five() {
    let system = System {
        a: mat![[0.0, 1.0], [0.0, 0.0]],
        b: mat![[0.0], [1.0]],
        q: mat![[1.0, 2.0], [2.0, 4.0]],
        r: mat![[1.0]],
    };
    assert!(error(&system, &mat![[1.0, 2.0], [2.0, 2.0 + 5.0_f64.sqrt()]]) < 1e-15);
}

#[test]
fn indefinite_state_weight_of_ionescu_and_weiss_is_refused() {
    let q = mat![[-4.0 / 11.0, -4.0 / 11.0], [-4.0 / 11.0, 7.0 / 11.0]];
    let (a, b) = (mat![[0.0, 1.0], [0.0, -1.0]], mat![[1.0, 0.0], [2.0, 1.0]]);
    let (r, s) = (mat![[9.0, 3.0], [3.0, 1.0]], mat![[3.0, 1.0], [-1.0, 7.0]]);
    let refused = Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref())
        .with_cross(s.as_ref())
        .solve();
    assert!(matches!(
        refused,
        Err(DareError::IndefiniteWeight { name: "Q", .. })
    ));
}

#[test]
fn satellite_attitude_control_satisfies_the_equation_to_rounding() {
    let system = System {
        a: mat![
            [0.998, 0.067, 0.0, 0.0],
            [-0.067, 0.998, 0.0, 0.0],
            [0.0, 0.0, 0.998, 0.153],
            [0.0, 0.0, -0.153, 0.998]
        ],
        b: mat![
            [0.0033, 0.02],
            [0.1, -0.0007],
            [0.04, 0.0073],
            [-0.0028, 0.1]
        ],
        q: mat![
            [1.87, 0.0, 0.0, -0.244],
            [0.0, 0.744, 0.205, 0.0],
            [0.0, 0.205, 0.589, 0.0],
            [-0.244, 0.0, 0.0, 1.048]
        ],
        r: Mat::identity(2, 2),
    };
    let solution = system.dare().solve().unwrap();
    assert!(textbook_residual(&system, &solution.p) < 1e-13);
    assert!(solution.warning.is_none());
}

#[test]
fn cheap_to_dear_control_follows_the_closed_form() {
    for r in [1e-4_f64, 1.0, 1e2, 1e6] {
        let q = mat![[9.0, 6.0], [6.0, 4.0]];
        let expected = &q * ((1.0 + (1.0 + 4.0 * r).sqrt()) / 2.0);
        let system = System {
            a: mat![[4.0, 3.0], [-4.5, -3.5]],
            b: mat![[1.0], [-1.0]],
            q,
            r: mat![[r]],
        };
        // P is singular and the closed loop approaches the circle as r grows: digits go with 1 / (1 - radius).
        let found = error(&system, &expected);
        assert!(found < 1e-11 * (1.0 + r.sqrt()), "r = {r:e}: {found:e}");
    }
}

#[test]
fn badly_scaled_transition_follows_the_closed_form() {
    for e in [1e-6, 1.0, 1e2, 1e6] {
        let system = System {
            a: mat![[0.0, e], [0.0, 0.0]],
            b: mat![[0.0], [1.0]],
            q: Mat::identity(2, 2),
            r: mat![[1.0]],
        };
        assert!(
            error(&system, &mat![[1.0, 0.0], [0.0, 1.0 + e * e]]) < 1e-15,
            "e = {e:e}"
        );
    }
}

#[test]
fn two_inputs_of_very_different_cost_satisfy_the_equation() {
    for e in [1e-6, 1e-3, 1.0, 1e3] {
        let system = System {
            a: mat![[0.9512, 0.0], [0.0, 0.9048]],
            b: mat![[4.877, 4.877], [-1.1895, 3.569]],
            q: mat![[0.005, 0.0], [0.0, 0.02]],
            r: mat![[1.0 / (3.0 * e), 0.0], [0.0, 3.0 * e]],
        };
        let solution = system.dare().solve().unwrap();
        assert!(textbook_residual(&system, &solution.p) < 1e-12, "e = {e:e}");
    }
}

#[test]
fn reflected_diagonal_system_follows_the_scalar_solutions() {
    for e in [1e-4, 1.0, 1e4] {
        let v = Mat::from_fn(3, 3, |i, j| if i == j { 1.0 / 3.0 } else { -2.0 / 3.0 });
        let modes = [0.0, 1.0, 3.0];
        let diagonal = |d: [f64; 3]| Mat::from_fn(3, 3, |i, j| if i == j { d[i] } else { 0.0 });
        // p = q + a^2 p r / (r + p) with r = q = e: p^2 - a^2 e p - e^2 = 0.
        let scalar = |a: f64| e * (a * a + (a.powi(4) + 4.0).sqrt()) / 2.0;
        let system = System {
            a: &v * diagonal(modes) * &v,
            b: Mat::identity(3, 3),
            q: Mat::from_fn(3, 3, |i, j| if i == j { e } else { 0.0 }),
            r: Mat::from_fn(3, 3, |i, j| if i == j { e } else { 0.0 }),
        };
        let expected = &v * diagonal(modes.map(scalar)) * &v;
        assert!(error(&system, &expected) < 1e-14, "e = {e:e}");
    }
}

#[test]
fn shift_of_a_hundred_states_counts_up() {
    let n = 100;
    let system = System {
        a: Mat::from_fn(n, n, |i, j| if j == i + 1 { 1.0 } else { 0.0 }),
        b: Mat::from_fn(n, 1, |i, _| if i == n - 1 { 1.0 } else { 0.0 }),
        q: Mat::identity(n, n),
        r: mat![[1.0]],
    };
    let expected = Mat::from_fn(n, n, |i, j| if i == j { (i + 1) as f64 } else { 0.0 });
    assert!(error(&system, &expected) < 1e-14);
}
