//! Claims about whole problems, each for both solvers: Riccati, refilling, limits, shifting, shapes.

use crate::{answers, solvers, structured};
use mpc_qp::problems::random::{self, Recipe, SetKind};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    OcpQp, Residuals, Solution, SolveError, SolveStatus, SolverSettings, Stage, Start, Terminal,
    TerminalSet,
};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector6};
use std::time::Duration;

/// Inputs of the unconstrained problem by the backward Riccati recursion with linear terms.
fn riccati<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> Vec<SVector<f64, NU>> {
    let (mut p, mut gradient) = (problem.terminal().p, problem.terminal().p_linear);
    let mut policies: Vec<(SMatrix<f64, NU, NX>, SVector<f64, NU>)> = Vec::new();
    for stage in problem.stages().iter().rev() {
        let ahead = p * stage.c + gradient;
        let weight = (stage.r + stage.b.tr_mul(&p) * stage.b).cholesky().unwrap();
        let cross = stage.s.transpose() + stage.b.tr_mul(&p) * stage.a;
        let gain = -weight.solve(&cross);
        let offset = -weight.solve(&(stage.r_linear + stage.b.tr_mul(&ahead)));
        gradient = stage.q_linear + stage.a.tr_mul(&ahead) + cross.tr_mul(&offset);
        p = stage.q + stage.a.tr_mul(&p) * stage.a + cross.tr_mul(&gain);
        policies.push((gain, offset));
    }
    let mut x = *problem.initial_state();
    let forward = problem.stages().iter().zip(policies.iter().rev());
    forward
        .map(|(stage, (gain, offset))| {
            let u = gain * x + offset;
            x = stage.successor(&x, &u);
            u
        })
        .collect()
}

#[test]
fn unconstrained_solution_equals_riccati() {
    for seed in 0..100 {
        let recipe = Recipe {
            input_bounds: false,
            rate_limits: false,
            state_bounds: false,
            rows: 0,
            set: SetKind::None,
            ..Recipe::feasible(seed, 60)
        };
        let problem = random::problem::<6, 2>(seed, &recipe).unwrap();
        let exact = riccati(&problem);
        let size = exact.iter().map(SVector::amax).fold(1.0, f64::max);
        for (solver, solution) in answers(&problem) {
            for (found, exact) in solution.u.iter().zip(&exact) {
                // An equality-constrained problem: exact up to the residual tolerance times the conditioning.
                assert!(
                    (found - exact).amax() <= 1e-6 * size,
                    "{solver}, seed {seed}: {found} for {exact}"
                );
            }
        }
    }
}

#[test]
fn refilled_answers_as_freshly_built() {
    let recipe = Recipe {
        horizon: 15,
        ..Recipe::feasible(2, 15)
    };
    let mut problem = random::problem::<4, 2>(0, &recipe).unwrap();
    let mut kept = solvers(&problem, SolverSettings::default());
    let mut refilled = Solution::new(&problem);
    for seed in 1..40 {
        let other = random::problem::<4, 2>(seed, &recipe).unwrap();
        problem.set_initial_state(other.initial_state()).unwrap();
        problem.set_previous_input(other.previous_input()).unwrap();
        for (k, stage) in other.stages().iter().enumerate() {
            problem.set_stage(k, stage).unwrap();
        }
        problem.set_terminal(other.terminal()).unwrap();
        assert_eq!(problem, other);
        for ((name, solver), (_, fresh)) in kept.iter_mut().zip(answers(&other)) {
            solver.solve(&problem, Start::Cold, &mut refilled).unwrap();
            // Both are optimal to 1e-8 relative; Clarabel's equilibration differs, so the last digits may.
            let apart = (refilled.objective - fresh.objective).abs();
            assert!(apart <= 1e-7 * fresh.objective.abs().max(1.0), "{name}");
            // Strongly convex in u_0: sqrt of the gap over the least weight, 1e-2, bounds it by 1e-3; measured below 1e-5.
            let apart = (refilled.u[0] - fresh.u[0]).amax();
            assert!(apart <= 1e-5, "{name}, seed {seed}: {apart:e}");
        }
    }
}

#[test]
fn iteration_and_time_limits_are_statuses() {
    let problem = Tracking::default()
        .problem(Tracking::start(2), 20, true)
        .unwrap();
    let mut solution = Solution::new(&problem);
    let few = SolverSettings {
        max_iterations: 1,
        ..SolverSettings::default()
    };
    let short = SolverSettings {
        time_limit: Some(Duration::from_nanos(1)),
        ..SolverSettings::default()
    };
    for (settings, expected) in [
        (few, SolveStatus::IterationLimit),
        (short, SolveStatus::TimeLimit),
    ] {
        for (name, mut solver) in solvers(&problem, settings) {
            solver.solve(&problem, Start::Cold, &mut solution).unwrap();
            assert_eq!(solution.status, expected, "{name}");
            assert!(solution.x.iter().flatten().all(|value| value.is_finite()));
        }
    }
}

#[test]
fn shifted_solution_of_a_time_invariant_problem_is_nearly_the_next_one() {
    let tracking = Tracking::default();
    let first = tracking.problem(Tracking::start(5), 30, false).unwrap();
    for (solver, solution) in answers(&first) {
        let mut guess = solution;
        let mut problem = first.clone();
        let (state, input) = (guess.x[1], guess.u[0]);
        guess.shift(&problem).unwrap();
        problem.set_initial_state(&state).unwrap();
        problem.set_previous_input(&input).unwrap();
        let next = structured(&problem);
        // The terminal cost is the unconstrained cost-to-go: after 30 stages the tails differ by the held last input only.
        for k in 0..25 {
            assert!(
                (guess.u[k] - next.u[k]).amax() < 1e-3,
                "{solver}, stage {k}"
            );
            let apart = (guess.multipliers.costates[k] - next.multipliers.costates[k]).amax();
            assert!(apart < 1e-2, "{solver}, costate {k}: {apart:e}");
        }
        let residuals = Residuals::evaluate(&problem, &guess);
        assert!(
            residuals.dynamics.relative() < 1e-7,
            "the shifted states obey the dynamics: {:?}",
            residuals.dynamics
        );
    }
}

#[test]
fn shift_leaves_no_multiplier_on_the_given_state() {
    let problem = Tracking::default()
        .problem(Tracking::start(2), 10, false)
        .unwrap();
    let mut guess = Solution::new(&problem);
    for (stage, slacks) in guess
        .multipliers
        .stages
        .iter_mut()
        .zip(&mut guess.slacks.stages)
    {
        for bound in [
            &mut stage.x_min,
            &mut stage.x_max,
            &mut slacks.x_min,
            &mut slacks.x_max,
        ] {
            bound.fill(1.0);
        }
    }
    guess.shift(&problem).unwrap();
    let (stage, slacks) = (&guess.multipliers.stages[0], &guess.slacks.stages[0]);
    for bound in [&stage.x_min, &stage.x_max, &slacks.x_min, &slacks.x_max] {
        assert_eq!(bound.amax(), 0.0);
    }
}

#[test]
fn solution_of_another_shape_is_refused() {
    let tracking = Tracking::default();
    let long = tracking.problem(Vector6::zeros(), 5, false).unwrap();
    let short = tracking.problem(Vector6::zeros(), 4, false).unwrap();
    let cone = tracking.problem(Vector6::zeros(), 5, true).unwrap();
    for (name, mut solver) in solvers(&long, SolverSettings::default()) {
        for other in [&short, &cone] {
            let refused = solver.solve(&long, Start::Cold, &mut Solution::new(other));
            assert!(
                matches!(refused, Err(SolveError::SolutionShape { .. })),
                "{name}: {refused:?}"
            );
        }
    }
}

#[test]
fn input_after_the_last_step_is_an_extra_stage_with_identity_dynamics() {
    // N = 1 with inputs u_0 and u_1: cost u_1^2/2 - u_1 is free of the state, so u_1 = 1 within its rate of 0.5 from u_0.
    let mut stage = Stage::new(Matrix2::identity(), Matrix2::identity());
    stage.r = Matrix2::identity();
    (stage.du_min, stage.du_max) = (Vector2::repeat(-0.5), Vector2::repeat(0.5));
    let mut last = Stage {
        b: Matrix2::zeros(),
        r_linear: Vector2::new(-1.0, 0.0),
        ..stage.clone()
    };
    last.r = Matrix2::identity();
    stage.du_min.fill(f64::NEG_INFINITY);
    stage.du_max.fill(f64::INFINITY);
    let mut terminal = Terminal::new(Matrix2::zeros());
    terminal.set = TerminalSet::Ellipsoid {
        shape: Matrix2::identity(),
        center: Vector2::zeros(),
        level: 100.0,
    };
    let problem = OcpQp::new(Vector2::zeros(), vec![stage, last], terminal).unwrap();
    // min a^2/2 + b^2/2 - b with b <= a + 1/2: a = 1/4, b = 3/4.
    for (solver, solution) in answers(&problem) {
        let (a, b) = (solution.u[0][0], solution.u[1][0]);
        assert!(
            (a - 0.25).abs() < 1e-6 && (b - 0.75).abs() < 1e-6,
            "{solver}: {a} {b}"
        );
        assert!((solution.x[2] - solution.x[1]).amax() < 1e-8, "{solver}");
    }
}
