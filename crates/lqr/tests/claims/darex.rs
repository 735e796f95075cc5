//! Examples of the DAREX collection with a solution in closed form, and the two with an indefinite weight.
//!
//! P. Benner, A. Laub, V. Mehrmann, "A collection of benchmark examples for the numerical solution of algebraic Riccati equations II:
//! discrete-time case", SPC 95_23, TU Chemnitz-Zwickau, 1995, in the numbering and with the numbers of version 2.0 (J. Abels, P. Benner, SLICOT Working
//! Note 1999-16), checked against SLICOT's generator BB02AD. The examples without a closed form are in `darex_data`.

use crate::systems::{System, norm};
use faer::{Mat, mat};
use lqr::{Dare, DareError};

/// Relative error of the solution in the Frobenius norm.
fn error(system: &System, expected: &Mat<f64>) -> f64 {
    let solution = system.dare().solve().unwrap();
    assert!(solution.spectral_radius < 1.0);
    norm(&(&solution.p - expected)) / norm(expected)
}

#[test]
fn example_1_1_van_dooren_with_zero_input_weight_is_the_identity() {
    let system = System {
        a: mat![[2.0, -1.0], [1.0, 0.0]],
        b: mat![[1.0], [0.0]],
        q: mat![[0.0, 0.0], [0.0, 1.0]],
        r: mat![[0.0]],
    };
    assert!(error(&system, &Mat::identity(2, 2)) < 1e-13);
}

#[test]
fn example_1_3_nilpotent_pair_has_two_plus_root_five() {
    let system = System {
        a: mat![[0.0, 1.0], [0.0, 0.0]],
        b: mat![[0.0], [1.0]],
        q: mat![[1.0, 2.0], [2.0, 4.0]],
        r: mat![[1.0]],
    };
    assert!(error(&system, &mat![[1.0, 2.0], [2.0, 2.0 + 5.0_f64.sqrt()]]) < 1e-15);
}

#[test]
fn example_1_2_indefinite_state_weight_of_ionescu_and_weiss_is_refused() {
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
fn example_1_4_indefinite_state_weight_of_sun_is_refused() {
    // The collection gives X = diag(1e5, 1e3, 0): a stabilising solution that this library, by its contract, does not look for.
    let system = System {
        a: mat![[0.0, 0.1, 0.0], [0.0, 0.0, 0.01], [0.0, 0.0, 0.0]],
        b: mat![[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]],
        q: mat![[1e5, 0.0, 0.0], [0.0, 1e3, 0.0], [0.0, 0.0, -10.0]],
        r: mat![[0.0, 0.0], [0.0, 1.0]],
    };
    assert!(matches!(
        system.dare().solve(),
        Err(DareError::IndefiniteWeight { name: "Q", eigenvalue, .. }) if eigenvalue == -10.0
    ));
}

#[test]
fn example_2_1_cheap_to_dear_control_follows_the_closed_form() {
    for r in [1e-8_f64, 1e-4, 1.0, 1e2, 1e6] {
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
fn example_2_3_badly_scaled_transition_follows_the_closed_form() {
    for e in [1e-8, 1e-6, 1.0, 1e2, 1e6, 1e8] {
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
fn example_2_4_reflected_diagonal_system_follows_the_scalar_solutions() {
    for e in [1e-8, 1e-4, 1.0, 1e4, 1e6] {
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
fn example_2_5_slow_paper_machine_follows_the_scalar_solution() {
    // D = K = 1, r = 1/4; the first state is a filter with a = 1 - 1/tau and gain 1/tau, then three delays.
    for tau in [2.0_f64, 1e2, 1e4, 1e6, 1e8] {
        let (alpha, beta, r) = (1.0 - 1.0 / tau, 1.0 / tau, 0.25);
        let system = System {
            a: mat![
                [alpha, 0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0]
            ],
            b: mat![[beta], [0.0], [0.0], [0.0]],
            q: Mat::from_fn(4, 4, |i, j| if (i, j) == (3, 3) { 1.0 } else { 0.0 }),
            r: mat![[r]],
        };
        // beta^2 x^2 - (r (alpha^2 - 1) + beta^2) x - r = 0.
        let half = r * (alpha * alpha - 1.0) + beta * beta;
        let root = (half * half + 4.0 * beta * beta * r).sqrt();
        // The positive root without cancellation: half is negative for a slow machine.
        let x = if half < 0.0 {
            2.0 * r / (root - half)
        } else {
            (half + root) / (2.0 * beta * beta)
        };
        let expected = Mat::from_fn(4, 4, |i, j| match (i == j, i) {
            (true, 0) => x,
            (true, _) => 1.0,
            (false, _) => 0.0,
        });
        // The closed loop is at 1 - sqrt(5)/tau: a rounding of alpha moves P by tau roundings.
        let found = error(&system, &expected);
        assert!(found < 1e-15 * (10.0 + tau), "tau = {tau:e}: {found:e}");
    }
}

#[test]
fn example_4_1_shift_of_a_hundred_states_counts_up() {
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
