//! Iteration and time limits hold in every phase.

use crate::structured;
use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{OcpSolver, Solution, SolveStatus, SolverSettings, Start, StructuredSolver};

#[test]
fn no_phase_takes_more_iterations_than_allowed() {
    let mut stopped = 0;
    for seed in 0..150 {
        let recipe = Recipe::badly_scaled(seed, 30);
        let problem = random::problem::<4, 2>(seed, &recipe).unwrap();
        for max_iterations in [1, 2, 4, 8, 40, 60] {
            let settings = SolverSettings {
                max_iterations,
                ..SolverSettings::default()
            };
            let mut solution = Solution::new(&problem);
            let mut solver = StructuredSolver::new(&problem, settings).unwrap();
            solver.solve(&problem, Start::Cold, &mut solution).unwrap();
            assert!(solution.iterations <= max_iterations, "seed {seed}");
            let limited = solution.status == SolveStatus::IterationLimit;
            assert!(!limited || solution.iterations == max_iterations);
            stopped += usize::from(limited);
        }
    }
    assert!(stopped > 150, "{stopped} stops");
}

#[test]
fn time_limit_is_a_status_with_finite_numbers() {
    let tracking = Tracking::default();
    let problem = tracking.problem(Tracking::start(1), 20, true).unwrap();
    let settings = SolverSettings {
        time_limit: Some(std::time::Duration::from_nanos(1)),
        ..SolverSettings::default()
    };
    let mut solver = StructuredSolver::new(&problem, settings).unwrap();
    let mut solution = structured(&problem);
    for start in [Start::Cold, Start::Warm] {
        solver.solve(&problem, start, &mut solution).unwrap();
        assert_eq!(solution.status, SolveStatus::TimeLimit);
        assert!(
            solution
                .u
                .iter()
                .all(|u| u.iter().all(|value| value.is_finite()))
        );
    }
}
