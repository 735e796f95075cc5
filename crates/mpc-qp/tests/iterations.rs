//! Iteration counts on a fixed set of 200 problems: lost convergence shows here before it shows in times.

#![expect(clippy::unwrap_used, reason = "helpers of tests may fail loudly")]

use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{OcpSolver, Solution, SolveStatus, SolverSettings, Start, StructuredSolver};

/// Counts of each problem: one line without, one with the ellipsoid. To renew it, paste what the failing test prints.
const SNAPSHOT: &str = include_str!("iterations.txt");

/// Counts over 100 random starts at N = 20; sweeps of the active-set phases count as iterations.
fn counts(cone: bool) -> Vec<usize> {
    let tracking = Tracking::default();
    let first = tracking.problem(Tracking::start(0), 20, cone).unwrap();
    let mut solver = StructuredSolver::new(&first, SolverSettings::default()).unwrap();
    let mut solution = Solution::new(&first);
    (0..100)
        .map(|seed| {
            let problem = tracking.problem(Tracking::start(seed), 20, cone).unwrap();
            solver.solve(&problem, Start::Cold, &mut solution).unwrap();
            assert_eq!(solution.status, SolveStatus::Solved, "seed {seed}");
            solution.iterations
        })
        .collect()
}

#[test]
fn iterations_of_each_problem_stay_what_they_were() {
    for (line, cone) in SNAPSHOT.lines().zip([false, true]) {
        let recorded: Vec<usize> = line
            .split(' ')
            .map(|count| count.parse().unwrap())
            .collect();
        let found = counts(cone);
        // Machines with and without fused multiplication may part by one iteration where a test of progress is close.
        let same = recorded.len() == found.len()
            && recorded
                .iter()
                .zip(&found)
                .all(|(a, b)| a.abs_diff(*b) <= 1);
        assert!(
            same,
            "cone {cone}: recorded\n{recorded:?}\nfound\n{found:?}"
        );
    }
    assert_eq!(SNAPSHOT.lines().count(), 2);
}
