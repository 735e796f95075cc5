//! Refilling and rebuilding, seen from inside.

use super::*;
use crate::problems::random::{self, Recipe};
use crate::solution::SolveStatus;
use crate::stage::Stage;
use crate::terminal::Terminal;
use nalgebra::{Matrix4, Matrix4x2, Vector4};

fn bits(solver: &ClarabelSolver<4, 2>) -> Vec<u64> {
    let parts = [
        solver.cost.values(),
        solver.constraints.values(),
        &solver.linear,
        &solver.right,
    ];
    parts
        .into_iter()
        .flatten()
        .map(|value| value.to_bits())
        .collect()
}

#[test]
fn refilled_data_equal_freshly_built_bit_for_bit() {
    for seed in 0..60 {
        let recipe = Recipe {
            horizon: 12,
            ..Recipe::softened(seed, 12)
        };
        let first = random::problem::<4, 2>(seed, &recipe).unwrap();
        let mut second = random::problem::<4, 2>(seed + 1000, &recipe).unwrap();
        let mut refilled = ClarabelSolver::new(&first, SolverSettings::default()).unwrap();
        // The pattern of both: a bound absent in one only would move rows.
        refilled.refill(&second).unwrap();
        let builds = refilled.builds();
        refilled.refill(&first).unwrap();
        refilled.refill(&second).unwrap();
        assert_eq!(
            refilled.builds(),
            builds,
            "a pattern that covers both problems is never made again"
        );
        let layout = refilled.layout.clone();
        let fresh = ClarabelSolver::build(&second, layout, SolverSettings::default(), 1).unwrap();
        assert_eq!(bits(&refilled), bits(&fresh));
        let state = *second.initial_state() * 2.0;
        second.set_initial_state(&state).unwrap();
        refilled.refill(&second).unwrap();
        assert_ne!(
            bits(&refilled),
            bits(&fresh),
            "the comparison sees a changed initial state"
        );
    }
}

#[test]
fn pattern_grows_once_for_a_bound_that_appears_and_stays_when_it_goes() {
    let recipe = Recipe {
        input_bounds: false,
        ..Recipe::feasible(3, 8)
    };
    let mut problem = random::problem::<4, 2>(3, &recipe).unwrap();
    let mut solver = ClarabelSolver::new(&problem, SolverSettings::default()).unwrap();
    let free = problem.stages()[0].clone();
    let mut bounded = free.clone();
    bounded.u_max[0] = 1e3;
    let mut solution = Solution::new(&problem);
    for (stage, builds) in [(&free, 1), (&bounded, 2), (&free, 2), (&bounded, 2)] {
        problem.set_stage(0, stage).unwrap();
        solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        assert_eq!(solver.builds(), builds);
    }
}

#[test]
fn second_solver_for_a_problem_as_given_is_made_once_and_counted() {
    // A cost that falls without end, a million units of the state for one of the input.
    let mut stage = Stage::new(Matrix4::identity(), Matrix4x2::zeros());
    stage.b[(0, 0)] = 1e6;
    stage.r_linear[0] = 1.0;
    let terminal = Terminal::new(Matrix4::zeros());
    let problem = OcpQp::new(Vector4::zeros(), vec![stage; 3], terminal).unwrap();
    let mut solver = ClarabelSolver::new(&problem, SolverSettings::default()).unwrap();
    let mut solution = Solution::new(&problem);
    assert_eq!(solver.builds(), 1);
    for _ in 0..2 {
        solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        assert_eq!(solution.status, SolveStatus::NumericalTrouble);
        assert_eq!(solver.builds(), 2);
    }
}

#[test]
fn early_stop_is_an_answer_up_to_the_usable_residual() {
    use super::extraction::status;
    use clarabel::solver::SolverStatus::{InsufficientProgress, NumericalError};
    let problem = random::problem::<4, 2>(1, &Recipe::feasible(1, 5)).unwrap();
    let mut solver = ClarabelSolver::new(&problem, SolverSettings::default()).unwrap();
    let mut solution = Solution::new(&problem);
    solver.solve(&problem, Start::Cold, &mut solution).unwrap();
    solution.u[0][0] += 1e-3;
    solution.evaluate(&problem);
    let worst = solution.residuals.worst();
    assert!(worst > 1e-5);
    for verdict in [InsufficientProgress, NumericalError] {
        let mut graded = |usable| status(&problem, verdict, usable, &mut solution);
        assert_eq!(graded(worst), SolveStatus::SolvedInaccurate);
        assert_eq!(graded(0.999 * worst), SolveStatus::NumericalTrouble);
    }
}
