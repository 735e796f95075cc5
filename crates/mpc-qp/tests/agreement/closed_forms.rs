//! Problems whose solution is known, degenerate ones among them.

use crate::structured;
use mpc_qp::problems::known::{self, KnownProblem};
use mpc_qp::{ConstraintGroup, Penalty, ProblemError, Solution, SolveStatus};
use nalgebra::Vector2;

fn matches_known<const NX: usize, const NU: usize>(
    known: Result<KnownProblem<NX, NU>, ProblemError>,
) -> Solution<NX, NU> {
    let known = known.unwrap();
    let solution = structured(&known.problem);
    assert_eq!(solution.status, SolveStatus::Solved);
    let error = (solution.objective - known.objective).abs();
    assert!(
        error <= 1e-7 * known.objective.abs().max(1.0),
        "{} for {}",
        solution.objective,
        known.objective
    );
    for (found, exact) in solution.u.iter().zip(&known.u) {
        // As in `known_answers`: inputs of a transfer reach 300.
        assert!((found - exact).amax() <= 1e-5, "{found} for {exact}");
    }
    solution
}

#[test]
fn scalar_steps_equal_their_closed_forms() {
    matches_known(known::one_scalar_step(1.0, 1.0, 3.0, 1.0));
    matches_known(known::one_scalar_step(10.0, 1.0, 3.0, 1.0));
}

#[test]
fn double_integrator_saturates_as_in_the_closed_form() {
    matches_known(known::saturated_double_integrator(60));
}

#[test]
fn least_effort_transfer_equals_its_closed_form() {
    for horizon in [2, 3, 10, 40] {
        matches_known(known::least_effort_double_integrator(horizon));
    }
}

#[test]
fn straight_needle_equals_its_riccati_cost() {
    matches_known(known::straight_needle(Vector2::new(3.0, -2.0), 30));
}

#[test]
fn degenerate_problems_equal_their_closed_forms() {
    matches_known(known::redundant_rows());
    matches_known(known::weakly_active_bound());
    for horizon in [1, 5, 10] {
        matches_known(known::start_on_terminal_boundary(horizon));
    }
}

#[test]
fn wishes_are_projected_onto_discs_of_any_size() {
    let (near, far) = (Vector2::new(1.0, 1.0), Vector2::new(4.0, 1.0));
    let center = Vector2::new(1.0, -3.0);
    matches_known(known::projection_onto_disc(near, Vector2::zeros(), 2.0));
    matches_known(known::projection_onto_disc(far, center, 2.0));
    // On the circle: active with a zero multiplier.
    matches_known(known::projection_onto_disc(
        Vector2::new(3.0, 4.0),
        Vector2::zeros(),
        5.0,
    ));
    for radius in [1e-3, 1e-5, 1e-7] {
        matches_known(known::projection_onto_disc(far, center, radius));
    }
}

#[test]
fn wishes_are_projected_onto_a_set_of_condition_1e8() {
    for axis in [0, 1] {
        for radius in [1.0, 1e-4] {
            matches_known(known::projection_along_an_axis(axis, 1e8, radius));
        }
    }
}

#[test]
fn rates_are_active_at_every_stage_of_a_ramp() {
    for horizon in [1, 20, 200] {
        let solution = matches_known(known::rate_limited_ramp(horizon));
        assert!(
            solution
                .multipliers
                .stages
                .iter()
                .all(|stage| stage.du_max[0] > 1.0)
        );
    }
}

#[test]
fn soft_bound_gives_way_by_its_price() {
    for weight in [0.25, 0.4, 2.0, 100.0] {
        for penalty in [Penalty::Exact { weight }, Penalty::Quadratic { weight }] {
            matches_known(known::soft_bound_out_of_reach(penalty));
        }
    }
}

#[test]
fn soft_disc_gives_way_by_its_price() {
    for weight in [0.1, 1.0, 3.0, 100.0] {
        for penalty in [Penalty::Exact { weight }, Penalty::Quadratic { weight }] {
            let solution = matches_known(known::soft_disc_out_of_reach(penalty));
            let growth = solution.slacks.largest(ConstraintGroup::TerminalSet);
            assert!((growth - (solution.x[1].norm() - 1.0).max(0.0)).abs() <= 1e-7);
        }
    }
}
