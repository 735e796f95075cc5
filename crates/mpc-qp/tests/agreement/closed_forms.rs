//! Problems whose solution is known, degenerate ones among them, through both solvers at their tolerance of 1e-8.

use crate::answers;
use mpc_qp::problems::known::{self, KnownProblem};
use mpc_qp::{
    ConstraintGroup, Penalty, ProblemError, Solution, SolveStatus, TerminalSetMultipliers,
};
use nalgebra::Vector2;

/// Solves and compares with the closed form: cost to 1e-8 relative (the tolerance), inputs to `input_tolerance`.
fn solve<const NX: usize, const NU: usize>(
    known: Result<KnownProblem<NX, NU>, ProblemError>,
    input_tolerance: f64,
) -> [Solution<NX, NU>; 2] {
    let known = known.unwrap();
    answers(&known.problem).map(|(solver, solution)| {
        assert_eq!(solution.status, SolveStatus::Solved, "{solver}");
        let error = (solution.objective - known.objective).abs();
        assert!(
            error <= 1e-8 * known.objective.abs().max(1.0),
            "{solver}: cost {} for {}",
            solution.objective,
            known.objective
        );
        for (k, (found, exact)) in solution.u.iter().zip(&known.u).enumerate() {
            assert!(
                (found - exact).amax() <= input_tolerance,
                "{solver}, u_{k}: {found} for {exact}"
            );
        }
        let residuals = &solution.residuals;
        assert!(residuals.worst() < 1e-6, "{solver}: {residuals:?}");
        solution
    })
}

// A cost error of e moves the input by sqrt(2 e / curvature): 1e-11 in the cost, Clarabel's gap, is 4.5e-6 at curvature 1 in the worst
// case, that of weakly active bounds, and next to nothing where a bound or the Newton equations fix the input.
const FIXED: f64 = 1e-8;
const WEAK: f64 = 1e-5;

#[test]
fn one_scalar_step_inside_its_bounds() {
    solve(known::one_scalar_step(1.0, 1.0, 3.0, 1.0), FIXED);
}

#[test]
fn one_scalar_step_at_its_bound_has_the_multiplier_of_the_gradient() {
    for solution in solve(known::one_scalar_step(10.0, 1.0, 3.0, 1.0), FIXED) {
        // Gradient at u = -1: q (x_0 + u) + r u = 9 - 3.
        assert!((solution.multipliers.stages[0].u_min[0] - 6.0).abs() < 1e-6);
    }
}

#[test]
fn double_integrator_saturates() {
    for solution in solve(known::saturated_double_integrator(60), FIXED) {
        let stages = &solution.multipliers.stages;
        assert!(stages.iter().all(|stage| stage.u_min[0] > 1e-3));
    }
}

#[test]
fn least_effort_transfer_is_linear_in_time() {
    for horizon in [2, 3, 10, 40] {
        // Inputs reach 300 at N = 2: tolerance relative to them.
        solve(known::least_effort_double_integrator(horizon), FIXED);
    }
}

#[test]
fn straight_needle_follows_its_gain_and_its_riccati_cost() {
    for horizon in [1, 8, 100] {
        solve(
            known::integrators_at_their_gain(Vector2::new(0.3, -0.2), horizon),
            FIXED,
        );
    }
}

#[test]
fn wish_outside_the_disc_is_projected_with_multiplier_equal_to_the_distance() {
    let (wish, center) = (Vector2::new(4.0, 1.0), Vector2::new(1.0, -3.0));
    for solution in solve(known::projection_onto_disc(wish, center, 2.0), FIXED) {
        let TerminalSetMultipliers::Ellipsoid { radius, .. } = solution.multipliers.terminal.set
        else {
            panic!("the terminal set is an ellipsoid");
        };
        assert!((radius - 3.0).abs() < 1e-6, "multiplier {radius}");
        let bound = solution
            .multipliers
            .exact_penalty_bound(ConstraintGroup::TerminalSet);
        assert_eq!(bound, radius);
    }
}

#[test]
fn wish_inside_the_disc_is_granted() {
    solve(
        known::projection_onto_disc(Vector2::new(1.0, 1.0), Vector2::zeros(), 2.0),
        FIXED,
    );
}

#[test]
fn wish_on_the_circle_has_a_zero_multiplier() {
    // Strict complementarity fails: the iterates approach like sqrt(gap), here sqrt(1e-11 * 12.5) = 1.1e-5.
    let wish = Vector2::new(3.0, 4.0);
    for solution in solve(
        known::projection_onto_disc(wish, Vector2::zeros(), 5.0),
        4.0 * WEAK,
    ) {
        let bound = solution
            .multipliers
            .exact_penalty_bound(ConstraintGroup::TerminalSet);
        assert!(bound < 4.0 * WEAK, "{bound:e}");
    }
}

#[test]
fn discs_of_any_size_are_met() {
    let (wish, center) = (Vector2::new(4.0, 1.0), Vector2::new(1.0, -3.0));
    for radius in [1e-3, 1e-4, 1e-5, 1e-7] {
        solve(known::projection_onto_disc(wish, center, radius), FIXED);
    }
}

#[test]
fn wishes_are_projected_onto_a_set_of_condition_1e8() {
    for axis in [0, 1] {
        for radius in [1.0, 1e-4] {
            solve(known::projection_along_an_axis(axis, 1e8, radius), FIXED);
        }
    }
}

#[test]
fn rates_are_active_at_every_stage_of_a_ramp() {
    for horizon in [1, 20, 200] {
        for solution in solve(known::rate_limited_ramp(horizon), FIXED) {
            let stages = &solution.multipliers.stages;
            assert!(stages.iter().all(|stage| stage.du_max[0] > 1.0));
        }
    }
}

#[test]
fn start_on_the_terminal_boundary_stays_there() {
    for horizon in [1, 5, 10] {
        solve(known::start_on_terminal_boundary(horizon), WEAK);
    }
}

#[test]
fn redundant_rows_share_one_multiplier() {
    for solution in solve(known::redundant_rows(), FIXED) {
        let rows = &solution.multipliers.stages[0].rows;
        // Gradient 2 - u = 1 is split among the four in some way.
        let sum = rows[0] + rows[1] + rows[2] + 10.0 * rows[3];
        assert!((sum - 1.0).abs() < 1e-6, "{rows:?}");
    }
}

#[test]
fn weakly_active_bound_is_met_without_multiplier() {
    for solution in solve(known::weakly_active_bound(), WEAK) {
        assert!(solution.multipliers.stages[0].u_max[0] < WEAK);
    }
}

#[test]
fn soft_bound_gives_way_by_its_price() {
    for weight in [0.25, 0.4, 2.0, 100.0] {
        for penalty in [Penalty::Exact { weight }, Penalty::Quadratic { weight }] {
            for solution in solve(known::soft_bound_out_of_reach(penalty), FIXED) {
                let violation = solution.slacks.largest(ConstraintGroup::StateBounds);
                let u = solution.u[0][0];
                let short = 3.0 - u;
                assert!((violation - short).abs() < 1e-6, "{penalty:?}: {violation}");
                // The objective of `known` comes from `Penalty::cost`; this one does not.
                let price = match penalty {
                    Penalty::Quadratic { weight } => 0.5 * weight * short * short,
                    _ => weight * short,
                };
                assert!((solution.objective - 0.5 * u * u - price).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn soft_disc_gives_way_by_its_price() {
    for weight in [0.1, 1.0, 3.0, 100.0] {
        for penalty in [Penalty::Exact { weight }, Penalty::Quadratic { weight }] {
            for solution in solve(known::soft_disc_out_of_reach(penalty), FIXED) {
                let growth = solution.slacks.largest(ConstraintGroup::TerminalSet);
                let beyond = (solution.x[1].norm() - 1.0).max(0.0);
                assert!((growth - beyond).abs() <= 1e-6, "{growth} and {beyond}");
            }
        }
    }
}
