//! Problems with closed-form solutions, solved by the conic solver at its tolerance of 1e-8.

#![expect(clippy::unwrap_used, reason = "helpers of tests may fail loudly")]

use mpc_qp::problems::known::{self, KnownProblem};
use mpc_qp::{
    ClarabelSolver, ConstraintGroup, OcpSolver, Penalty, ProblemError, Solution, SolveStatus,
    SolverSettings, Start, TerminalSetMultipliers,
};
use nalgebra::Vector2;

/// Solves and compares with the closed form: cost to 1e-7 relative (ten times the gap tolerance), inputs to `input_tolerance`.
fn solve<const NX: usize, const NU: usize>(
    known: Result<KnownProblem<NX, NU>, ProblemError>,
    input_tolerance: f64,
) -> Solution<NX, NU> {
    let known = known.unwrap();
    let mut solution = Solution::new(&known.problem);
    let mut solver = ClarabelSolver::new(&known.problem, SolverSettings::default()).unwrap();
    solver
        .solve(&known.problem, Start::Cold, &mut solution)
        .unwrap();
    assert_eq!(solution.status, SolveStatus::Solved);
    let error = (solution.objective - known.objective).abs();
    assert!(
        error <= 1e-7 * known.objective.abs().max(1.0),
        "cost {} for {}",
        solution.objective,
        known.objective
    );
    for (k, (found, exact)) in solution.u.iter().zip(&known.u).enumerate() {
        assert!(
            (found - exact).amax() <= input_tolerance,
            "u_{k}: {found} for {exact}"
        );
    }
    assert!(
        solution.residuals.worst() < 1e-6,
        "{:?}",
        solution.residuals
    );
    solution
}

// A cost error of e moves the input by sqrt(2 e / curvature): 1e-8 in the cost is 1.4e-4 at curvature 1 in the worst
// case, and far less where a bound or the Newton equations fix the input. 1e-6 holds for all problems but the weakly
// active ones.

#[test]
fn one_scalar_step_inside_its_bounds() {
    solve(known::one_scalar_step(1.0, 1.0, 3.0, 1.0), 1e-6);
}

#[test]
fn one_scalar_step_at_its_bound_has_the_multiplier_of_the_gradient() {
    let solution = solve(known::one_scalar_step(10.0, 1.0, 3.0, 1.0), 1e-6);
    // Gradient at u = -1: q (x_0 + u) + r u = 9 - 3.
    assert!((solution.multipliers.stages[0].u_min[0] - 6.0).abs() < 1e-6);
}

#[test]
fn double_integrator_saturates() {
    let solution = solve(known::saturated_double_integrator(60), 1e-6);
    assert!(
        solution
            .multipliers
            .stages
            .iter()
            .all(|stage| stage.u_min[0] > 1e-3)
    );
}

#[test]
fn least_effort_transfer_is_linear_in_time() {
    for horizon in [2, 3, 10, 40] {
        // Inputs reach 300 at N = 2: tolerance relative to them.
        solve(known::least_effort_double_integrator(horizon), 1e-5);
    }
}

#[test]
fn straight_needle_follows_its_gain_and_its_riccati_cost() {
    for horizon in [1, 8, 100] {
        solve(
            known::straight_needle(Vector2::new(0.3, -0.2), horizon),
            1e-6,
        );
    }
}

#[test]
fn wish_outside_the_disc_is_projected_with_multiplier_equal_to_the_distance() {
    let (wish, center) = (Vector2::new(4.0, 1.0), Vector2::new(1.0, -3.0));
    let solution = solve(known::projection_onto_disc(wish, center, 2.0), 1e-6);
    let TerminalSetMultipliers::Ellipsoid { radius, .. } = solution.multipliers.terminal.set else {
        panic!("the terminal set is an ellipsoid");
    };
    assert!((radius - 3.0).abs() < 1e-6, "multiplier {radius}");
    assert_eq!(
        solution
            .multipliers
            .exact_penalty_bound(ConstraintGroup::TerminalSet),
        radius
    );
}

#[test]
fn wish_inside_the_disc_is_granted() {
    solve(
        known::projection_onto_disc(Vector2::new(1.0, 1.0), Vector2::zeros(), 2.0),
        1e-6,
    );
}

#[test]
fn wish_on_the_circle_has_a_zero_multiplier() {
    // Strict complementarity fails: the iterates approach like sqrt(gap), here sqrt(1e-8 * 12.5) = 3.5e-4.
    let solution = solve(
        known::projection_onto_disc(Vector2::new(3.0, 4.0), Vector2::zeros(), 5.0),
        1e-3,
    );
    assert!(
        solution
            .multipliers
            .exact_penalty_bound(ConstraintGroup::TerminalSet)
            < 1e-3
    );
}

#[test]
fn tiny_disc_is_met() {
    solve(
        known::projection_onto_disc(Vector2::new(4.0, 1.0), Vector2::new(1.0, -3.0), 1e-4),
        1e-6,
    );
}

#[test]
fn start_on_the_terminal_boundary_stays_there() {
    for horizon in [1, 10] {
        solve(known::start_on_terminal_boundary(horizon), 1e-4);
    }
}

#[test]
fn redundant_rows_share_one_multiplier() {
    let solution = solve(known::redundant_rows(), 1e-6);
    let rows = &solution.multipliers.stages[0].rows;
    // Gradient 2 - u = 1 is split among the four in some way.
    assert!(
        (rows[0] + rows[1] + rows[2] + 10.0 * rows[3] - 1.0).abs() < 1e-6,
        "{rows:?}"
    );
}

#[test]
fn weakly_active_bound_is_met_without_multiplier() {
    let solution = solve(known::weakly_active_bound(), 1e-4);
    assert!(solution.multipliers.stages[0].u_max[0] < 1e-4);
}

#[test]
fn soft_bound_gives_way_by_its_price() {
    for weight in [0.25, 0.4, 2.0, 100.0] {
        for penalty in [Penalty::Exact { weight }, Penalty::Quadratic { weight }] {
            let solution = solve(known::soft_bound_out_of_reach(penalty), 1e-6);
            let violation = solution.slacks.largest(ConstraintGroup::StateBounds);
            assert!(
                (violation - (3.0 - solution.u[0][0])).abs() < 1e-6,
                "{penalty:?}: {violation}"
            );
        }
    }
}
