//! The structured solver allocates nothing after it was made.

use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{OcpSolver, Solution, SolveStatus, SolverSettings, Start, StructuredSolver};

#[test]
fn refill_and_solve_allocate_nothing() {
    let tracking = Tracking::default();
    for cone in [false, true] {
        let mut problem = tracking.problem(Tracking::start(1), 20, cone).unwrap();
        let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
        let mut solution = Solution::new(&problem);
        for seed in 1..20 {
            let other = tracking.problem(Tracking::start(seed), 20, cone).unwrap();
            let counted = allocation_counter::measure(|| {
                problem.set_initial_state(other.initial_state()).unwrap();
                problem.set_terminal(other.terminal()).unwrap();
                for (k, stage) in other.stages().iter().enumerate() {
                    problem.set_stage(k, stage).unwrap();
                }
                solver.solve(&problem, Start::Cold, &mut solution).unwrap();
                assert_eq!(solution.status, SolveStatus::Solved);
                solution.shift(&problem).unwrap();
                solver.solve(&problem, Start::Warm, &mut solution).unwrap();
            });
            assert_eq!(counted.count_total, 0, "seed {seed}, cone {cone}");
        }
    }
}

// More iterations than the interior point may take: the careful pass ran.
#[test]
fn hard_and_infeasible_problems_allocate_nothing_either() {
    let (mut most, mut refused) = (0, 0);
    for seed in 0..300 {
        let problem = random::problem::<6, 2>(seed, &Recipe::any(seed, 30)).unwrap();
        let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
        let mut solution = Solution::new(&problem);
        let counted = allocation_counter::measure(|| {
            solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        });
        assert_eq!(counted.count_total, 0, "seed {seed}");
        most = most.max(solution.iterations);
        let proved = matches!(solution.status, SolveStatus::PrimalInfeasible { .. });
        refused += usize::from(proved);
    }
    assert!(most > 60, "at most {most} iterations");
    assert!(refused > 30, "{refused} infeasible");
}

#[test]
fn the_counter_counts() {
    let counted = allocation_counter::measure(|| drop(std::hint::black_box(vec![0.0; 8])));
    assert_eq!(counted.count_total, 1);
}
