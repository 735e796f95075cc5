//! The errors of the paper's printed linearisation (20), (21): design claims 4.1 and 4.2.

use nalgebra::{Matrix6, Vector6};
use needle_model::{
    EulerIntegrator, EulerJacobians, EulerPlant, EulerState, Input, Needle, printed_linearisation,
};

use crate::finite_difference::derivative;

const DT_S: f64 = 0.1;

fn plant() -> EulerPlant {
    EulerPlant {
        needle: Needle::new(1.0 / 150.0).unwrap(),
        integrator: EulerIntegrator::ForwardEuler,
    }
}

fn point() -> (EulerState, Input) {
    let state = EulerState::from_vector(&Vector6::new(1.0, -2.0, 30.0, 0.3, -0.2, 0.5));
    let input = Input {
        v_mm_s: 10.0,
        omega_rad_s: 0.5,
    };
    (state, input)
}

fn printed_and_exact() -> (EulerJacobians, EulerJacobians) {
    let (state, input) = point();
    (
        printed_linearisation(&plant(), &state, input, DT_S).unwrap(),
        plant().linearise(&state, input, DT_S).unwrap(),
    )
}

#[test]
fn printed_alpha_column_of_p_x_is_the_beta_column() {
    let (printed, _) = printed_and_exact();
    let (state, input) = point();
    let by_beta = derivative(1e-3, |t| {
        let moved = EulerState {
            beta_rad: state.beta_rad + t,
            ..state
        };
        plant().rate(&moved, input).unwrap()
    });
    // v cos(beta) = 9.80 mm/s stands one column too far to the left.
    assert!((printed.a[(0, 3)] - by_beta[0]).abs() < 1e-9);
    assert_eq!(printed.a[(0, 4)], 0.0);
}

#[test]
fn printed_a_becomes_the_derivative_with_identity_and_dt_and_the_moved_entry() {
    let (printed, exact) = printed_and_exact();
    let mut repaired = printed.a;
    repaired.swap((0, 3), (0, 4));
    let repaired = Matrix6::identity() + repaired * DT_S;
    // The same products in another order.
    assert!((repaired - exact.a).norm() < 1e-14);
    assert!((printed.b - exact.b).norm() < 1e-14);
    assert!((printed.a - exact.a).norm() > 10.0);
}

#[test]
fn printed_a_is_all_but_nilpotent() {
    // Design claim 4.13: without the identity the prediction forgets its start.
    let (printed, _) = printed_and_exact();
    let angles = printed.a.fixed_view::<3, 3>(3, 3).into_owned();
    let radius = angles
        .complex_eigenvalues()
        .iter()
        .map(|z| z.norm())
        .fold(0.0, f64::max);
    // kappa v = 1/15 rad/s: every eigenvalue of A is of that order or zero, not near 1.
    assert!(radius < 0.1, "{radius}");
}
