//! The structured solver allocates nothing after it was made.

use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ConstraintGroup, OcpQp, OcpSolver, ProblemError, Solution, SolveStatus, SolverSettings, Stage,
    Start, StructuredSolver, Terminal, TerminalSet,
};
use nalgebra::{Matrix1, Matrix2, Vector2};
use std::time::Duration;

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

// A double integrator to the origin in units from 1e-6 to 1e6: all but the one of unit size are converted.
#[test]
fn problems_in_other_units_allocate_nothing_either() {
    let problem = |size: f64, start: f64| {
        let mut stage = Stage::new(
            Matrix2::new(1.0, 0.1, 0.0, 1.0),
            Vector2::new(0.005, 0.1) * size,
        );
        stage.r = Matrix1::new(1.0);
        (stage.u_min[0], stage.u_max[0]) = (-5.0, 5.0);
        let mut terminal = Terminal::new(Matrix2::zeros());
        terminal.set = TerminalSet::Equality {
            target: Vector2::zeros(),
        };
        let start = Vector2::new(start, 0.0) * size;
        OcpQp::new(start, vec![stage; 20], terminal).unwrap()
    };
    let mut filled = problem(1.0, 1.0);
    let mut solver = StructuredSolver::new(&filled, SolverSettings::default()).unwrap();
    let mut solution = Solution::new(&filled);
    for size in [1e-6, 1.0, 1e3, 1e-3, 1e6] {
        let (other, later) = (problem(size, 1.0), problem(size, 0.9));
        let counted = allocation_counter::measure(|| {
            for (k, stage) in other.stages().iter().enumerate() {
                filled.set_stage(k, stage).unwrap();
            }
            for (start, from) in [(Start::Cold, &other), (Start::Warm, &later)] {
                filled.set_initial_state(from.initial_state()).unwrap();
                solver.solve(&filled, start, &mut solution).unwrap();
                assert_eq!(solution.status, SolveStatus::Solved, "size {size:e}");
            }
        });
        assert_eq!(counted.count_total, 0, "size {size:e}");
    }
}

/// Brings `problem` to the values of `other`, which has its structure.
fn refill<const NX: usize, const NU: usize>(
    problem: &mut OcpQp<NX, NU>,
    other: &OcpQp<NX, NU>,
) -> Result<(), ProblemError> {
    problem.set_initial_state(other.initial_state())?;
    problem.set_previous_input(other.previous_input())?;
    problem.set_softening(*other.softening())?;
    problem.set_terminal(other.terminal())?;
    (other.stages().iter().enumerate()).try_for_each(|(k, stage)| problem.set_stage(k, stage))
}

// Rows, rates, soft groups, every terminal set, contradictions. More iterations than the interior point may take: the careful pass ran.
#[test]
fn no_kind_of_constraint_and_no_end_allocates() {
    let (mut most, mut refused, mut soft, mut stopped) = (0, 0, 0, 0);
    for seed in 0..300 {
        let recipe = Recipe::any(seed, 30);
        let mut problem = random::problem::<6, 2>(seed + 1000, &recipe).unwrap();
        let other = random::problem::<6, 2>(seed, &recipe).unwrap();
        let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
        let mut solution = Solution::new(&problem);
        let counted = allocation_counter::measure(|| {
            refill(&mut problem, &other).unwrap();
            solver.solve(&problem, Start::Cold, &mut solution).unwrap();
            most = most.max(solution.iterations);
            let proved = matches!(solution.status, SolveStatus::PrimalInfeasible { .. });
            refused += usize::from(proved);
            soft += usize::from(solution.slacks.largest(ConstraintGroup::StateBounds) > 0.0);
            solution.shift(&problem).unwrap();
            solver.solve(&problem, Start::Warm, &mut solution).unwrap();
            solver.set_time_limit(Some(Duration::ZERO));
            solver.solve(&problem, Start::Warm, &mut solution).unwrap();
            stopped += usize::from(solution.status == SolveStatus::TimeLimit);
        });
        assert_eq!(counted.count_total, 0, "seed {seed}");
    }
    assert!(most > 60, "at most {most} iterations");
    assert!(
        refused > 30 && soft > 10 && stopped > 100,
        "{refused} infeasible, {soft} gave way, {stopped} out of time"
    );
}

#[test]
fn the_counter_counts() {
    let counted = allocation_counter::measure(|| drop(std::hint::black_box(vec![0.0; 8])));
    assert_eq!(counted.count_total, 1);
}
