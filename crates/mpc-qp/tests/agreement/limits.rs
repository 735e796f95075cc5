//! What settings, guesses and refills promise: limits hold in every phase, nothing is left over from a guess or a refill.

use crate::{answers, refused_for, solvers, structured};
use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ConstraintGroup, OcpQp, OcpSolver, Solution, SolveError, SolveStatus, SolverSettings, Start,
    StructuredSolver, TerminalSet, examine_certificate,
};
use nalgebra::Vector6;

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
fn point_is_an_answer_by_its_residuals_whatever_stopped_the_solver() {
    let mut short = 0;
    for seed in 1..5 {
        let problem = Tracking::default()
            .problem(Tracking::start(seed), 20, true)
            .unwrap();
        for max_iterations in 1..16 {
            let settings = SolverSettings {
                max_iterations,
                ..SolverSettings::default()
            };
            for (name, mut solver) in solvers(&problem, settings) {
                let mut solution = Solution::new(&problem);
                solver.solve(&problem, Start::Cold, &mut solution).unwrap();
                // 1000 tolerances are what an inaccurate answer may leave.
                let (status, worst) = (solution.status, solution.residuals.worst());
                let answer = status.has_solution();
                assert_eq!(answer, worst <= 1e-5, "{name}: {status:?}, {worst:e}");
                let inaccurate = status == SolveStatus::SolvedInaccurate;
                short += usize::from(inaccurate && name == "Clarabel");
            }
        }
    }
    assert!(short > 0, "Clarabel never stopped just short");
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

#[test]
fn every_tolerance_is_met_and_called_solved() {
    let problem = Tracking::default()
        .problem(Tracking::start(4), 20, true)
        .unwrap();
    for tolerance in [1e-3, 1e-6, 1e-10] {
        let settings = SolverSettings {
            tolerance,
            ..SolverSettings::default()
        };
        let mut solution = Solution::new(&problem);
        let mut solver = StructuredSolver::new(&problem, settings).unwrap();
        solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        assert_eq!(solution.status, SolveStatus::Solved, "{tolerance:e}");
        // Two decades between the solver's scaling and the shared measure.
        let worst = solution.residuals.worst();
        assert!(worst <= 100.0 * tolerance, "{worst:e} for {tolerance:e}");
    }
}

// Where few solve, agreement of the solved ones says little.
#[test]
fn badly_scaled_problems_are_nearly_all_solved() {
    let solved = (0..300)
        .filter(|&seed| {
            let recipe = Recipe::badly_scaled(seed, 30);
            let problem = random::problem::<4, 2>(seed, &recipe).unwrap();
            structured(&problem).status == SolveStatus::Solved
        })
        .count();
    assert!(solved * 100 >= 98 * 300, "{solved} of 300");
}

#[test]
fn guess_that_is_not_finite_gives_the_cold_answer() {
    let problem = Tracking::default()
        .problem(Tracking::start(5), 20, true)
        .unwrap();
    let cold = structured(&problem);
    let spoils: [fn(&mut Solution<6, 2>); 4] = [
        |guess| guess.u[3][0] = f64::NAN,
        |guess| guess.multipliers.stages[2].du_max[1] = f64::NAN,
        |guess| guess.multipliers.stages[4].x_min[0] = f64::INFINITY,
        |guess| guess.slacks.terminal.x_max[5] = f64::NAN,
    ];
    for spoil in spoils {
        let mut guess = cold.clone();
        spoil(&mut guess);
        let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
        solver.solve(&problem, Start::Warm, &mut guess).unwrap();
        assert_eq!((guess.status, &guess.u), (SolveStatus::Solved, &cold.u));
    }
}

#[test]
fn state_bounds_that_vanish_leave_no_multipliers() {
    let mut problem = Tracking::default()
        .problem(Tracking::start(5), 20, false)
        .unwrap();
    let mut solution = structured(&problem);
    let mut stage = problem.stages()[3].clone();
    stage.x_min.fill(f64::NEG_INFINITY);
    stage.x_max.fill(f64::INFINITY);
    let free = stage.clone();
    // A little less than it reaches without a bound.
    let component = solution.x[3].iamax();
    let reached = solution.x[3][component];
    let size = reached.abs() * 0.999;
    (stage.x_min[component], stage.x_max[component]) = (-size, size);
    problem.set_stage(3, &stage).unwrap();
    let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
    solver.solve(&problem, Start::Cold, &mut solution).unwrap();
    let at_bound = |solution: &Solution<6, 2>| {
        let stage = &solution.multipliers.stages[3];
        stage.x_min.amax().max(stage.x_max.amax())
    };
    assert!(at_bound(&solution) > 0.0, "the bound is not active");
    problem.set_stage(3, &free).unwrap();
    for _ in 0..2 {
        solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        assert_eq!(
            (solution.status, at_bound(&solution)),
            (SolveStatus::Solved, 0.0)
        );
    }
}

/// The tracking problem with absent bounds written as `large`, as in most public data.
fn with_large_bounds(large: f64, set: TerminalSet<6>) -> OcpQp<6, 2> {
    let tracked = Tracking::default()
        .problem(Tracking::start(5), 20, false)
        .unwrap();
    let (mut stages, mut terminal) = (tracked.stages().to_vec(), tracked.terminal().clone());
    for stage in &mut stages {
        let absent = |bound: f64| bound.clamp(-large, large);
        (stage.x_min, stage.x_max) = (stage.x_min.map(absent), stage.x_max.map(absent));
        (stage.du_min, stage.du_max) = (stage.du_min.map(absent), stage.du_max.map(absent));
    }
    stages[7].u_max[1] = large;
    (terminal.x_min, terminal.x_max) = (Vector6::repeat(-large), Vector6::repeat(large));
    terminal.set = set;
    OcpQp::new(*tracked.initial_state(), stages, terminal).unwrap()
}

#[test]
fn bounds_of_1e20_are_absent() {
    for large in [1e20, 1e30] {
        let problem = with_large_bounds(large, TerminalSet::None);
        for (solver, good) in answers(&problem) {
            assert_eq!(good.status, SolveStatus::Solved, "{solver}, {large:e}");
            let mut bad = good.clone();
            bad.u[3][0] = problem.stages()[3].u_max[0] + 1.0;
            bad.evaluate(&problem);
            assert!(bad.residuals.constraints.relative() > 1e-3, "{bad:?}");
        }
        let target = Vector6::repeat(1e3);
        let unreachable = with_large_bounds(large, TerminalSet::Equality { target });
        refused_for("unreachable", &unreachable, &[ConstraintGroup::TerminalSet]);
    }
    // A refill reads them alike.
    let mut problem = with_large_bounds(1e20, TerminalSet::None);
    let mut stage = problem.stages()[2].clone();
    (stage.u_min[0], stage.u_max[0]) = (-1e25, 1e25);
    problem.set_stage(2, &stage).unwrap();
    let read = &problem.stages()[2];
    assert_eq!(
        (read.u_min[0], read.u_max[0]),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
}

#[test]
fn answer_to_a_problem_of_another_structure_is_never_good() {
    let tracking = Tracking::default();
    let cone = tracking.problem(Tracking::start(5), 20, true).unwrap();
    let free = tracking.problem(Tracking::start(5), 20, false).unwrap();
    let mut solution = structured(&free);
    solution.evaluate(&cone);
    assert_eq!(solution.residuals.worst(), f64::INFINITY);
    // Nor is one over another horizon, nor does it prove anything.
    let shorter = tracking.problem(Tracking::start(5), 19, false).unwrap();
    let longer = tracking.problem(Tracking::start(5), 21, false).unwrap();
    for other in [shorter, longer] {
        solution.evaluate(&other);
        assert_eq!(solution.residuals.worst(), f64::INFINITY);
        assert_eq!(
            examine_certificate(&other, &solution).0.residual,
            f64::INFINITY
        );
    }
    let mut solver = StructuredSolver::new(&free, SolverSettings::default()).unwrap();
    let refused = solver.solve(&cone, Start::Cold, &mut Solution::new(&cone));
    assert!(matches!(refused, Err(SolveError::SolverShape { .. })));
}
