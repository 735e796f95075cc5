//! Claims about whole problems: Riccati, refilling, softening, blame, limits, shifting.

#![expect(clippy::unwrap_used, reason = "helpers of tests may fail loudly")]

use mpc_qp::problems::random::{self, Recipe, SetKind};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ClarabelSolver, ConstraintGroup, OcpQp, OcpSolver, Penalty, Place, Residuals, Row, Softening,
    Solution, SolveError, SolveStatus, SolverSettings, Stage, Start, Terminal, TerminalSet,
};
use nalgebra::{Matrix1, Matrix2, SMatrix, SVector, Vector1, Vector2, Vector6};
use std::time::Duration;

fn solve<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> Solution<NX, NU> {
    let mut solution = Solution::new(problem);
    let mut solver = ClarabelSolver::new(problem, SolverSettings::default()).unwrap();
    solver.solve(problem, Start::Cold, &mut solution).unwrap();
    solution
}

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
            ..Recipe::feasible(seed, 40)
        };
        let problem = random::problem::<6, 2>(seed, &recipe).unwrap();
        let solution = solve(&problem);
        let exact = riccati(&problem);
        let size = exact.iter().map(SVector::amax).fold(1.0, f64::max);
        for (found, exact) in solution.u.iter().zip(&exact) {
            // An equality-constrained problem: the answer is exact up to the residual tolerance times the conditioning.
            assert!(
                (found - exact).amax() <= 1e-6 * size,
                "seed {seed}: {found} for {exact}"
            );
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
    let mut solver = ClarabelSolver::new(&problem, SolverSettings::default()).unwrap();
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
        solver.solve(&problem, Start::Cold, &mut refilled).unwrap();
        let fresh = solve(&other);
        // Both are optimal to 1e-8 relative; the equilibration differs, so the last digits may.
        assert!(
            (refilled.objective - fresh.objective).abs() <= 1e-7 * fresh.objective.abs().max(1.0)
        );
        // Strongly convex in u_0: sqrt of the gap over the least weight, 1e-2, bounds it by 1e-3; measured below 1e-5.
        assert!((refilled.u[0] - fresh.u[0]).amax() <= 1e-5, "seed {seed}");
    }
}

#[test]
fn exact_penalty_above_the_multiplier_bound_leaves_the_solution_and_below_it_gives_way() {
    let (mut held, mut gave) = (0, 0);
    for seed in 0..150 {
        let recipe = Recipe {
            state_bounds: true,
            horizon: 10,
            ..Recipe::feasible(seed, 10)
        };
        let problem = random::problem::<4, 2>(seed, &recipe).unwrap();
        let hard = solve(&problem);
        for group in [
            ConstraintGroup::StateBounds,
            ConstraintGroup::Rows,
            ConstraintGroup::TerminalSet,
        ] {
            let bound = hard.multipliers.exact_penalty_bound(group);
            if bound < 1e-3 {
                continue;
            }
            for factor in [2.0, 0.5] {
                let penalty = Penalty::Exact {
                    weight: factor * bound,
                };
                let mut softening = Softening::default();
                match group {
                    ConstraintGroup::StateBounds => softening.state_bounds = penalty,
                    ConstraintGroup::Rows => softening.rows = penalty,
                    _ => softening.terminal_set = penalty,
                }
                let soft = solve(&problem.clone().with_softening(softening).unwrap());
                let violation = soft.slacks.largest(group);
                let saved = (hard.objective - soft.objective) / hard.objective.abs().max(1.0);
                if factor > 1.0 {
                    // Gap tolerance 1e-8 over a price at least 1e-3 above the multiplier.
                    assert!(
                        violation < 1e-5 && saved.abs() < 1e-6,
                        "seed {seed} {group}: {violation:e} {saved:e}"
                    );
                    held += 1;
                } else {
                    assert!(saved > -1e-7, "a relaxation costs no more: {saved:e}");
                    gave += usize::from(violation > 1e-6);
                }
            }
        }
    }
    assert!(held > 100 && gave > 80, "{held} held, {gave} gave way");
}

#[test]
fn blame_names_the_two_rows_in_conflict_and_their_stage() {
    let mut stages = vec![Stage::new(Matrix1::new(1.0), Matrix1::new(1.0)); 6];
    for stage in &mut stages {
        (stage.r[0], stage.u_min[0], stage.u_max[0]) = (1.0, -5.0, 5.0);
    }
    let row = Row {
        g_x: Vector1::zeros(),
        h_u: Vector1::new(1.0),
        upper: -1.0,
    };
    stages[3].rows = vec![
        row,
        Row {
            h_u: -row.h_u,
            upper: -1.0,
            ..row
        },
    ];
    let solution =
        solve(&OcpQp::new(Vector1::zeros(), stages, Terminal::new(Matrix1::zeros())).unwrap());
    let SolveStatus::PrimalInfeasible { certificate, blame } = solution.status else {
        panic!("{:?}", solution.status);
    };
    assert!(certificate.residual < 1e-7);
    let first = blame.entries().next().unwrap();
    assert_eq!(
        (first.group, first.worst),
        (ConstraintGroup::Rows, Place::Stage(3))
    );
    assert!(first.share > 0.99, "{blame:?}");
}

#[test]
fn softening_the_blamed_group_makes_the_problem_feasible() {
    for seed in (3..200).step_by(4) {
        let recipe = Recipe::infeasible(seed, 20);
        let problem = random::problem::<3, 2>(seed, &recipe).unwrap();
        let SolveStatus::PrimalInfeasible { blame, .. } = solve(&problem).status else {
            panic!("seed {seed} is infeasible by construction");
        };
        assert!(blame.names(ConstraintGroup::TerminalSet));
        for penalty in [
            Penalty::Exact { weight: 10.0 },
            Penalty::Quadratic { weight: 10.0 },
        ] {
            let softening = Softening {
                terminal_set: penalty,
                ..Softening::default()
            };
            let soft = solve(&problem.clone().with_softening(softening).unwrap());
            assert!(soft.status.has_solution(), "seed {seed}: {:?}", soft.status);
            assert!(
                soft.slacks.largest(ConstraintGroup::TerminalSet) > 0.1,
                "the violation is reported"
            );
        }
    }
}

#[test]
fn unbounded_cost_is_never_called_solved() {
    let mut stage = Stage::new(Matrix1::new(1.0), Matrix1::new(1.0));
    stage.r_linear[0] = 1.0;
    let solution = solve(
        &OcpQp::new(
            Vector1::zeros(),
            vec![stage.clone(); 3],
            Terminal::new(Matrix1::zeros()),
        )
        .unwrap(),
    );
    assert!(
        !solution.status.has_solution(),
        "without any constraint: {:?}",
        solution.status
    );
    stage.u_max[0] = 1.0;
    let solution = solve(
        &OcpQp::new(
            Vector1::zeros(),
            vec![stage; 3],
            Terminal::new(Matrix1::zeros()),
        )
        .unwrap(),
    );
    assert_eq!(
        solution.status,
        SolveStatus::DualInfeasible,
        "with the other side bounded"
    );
}

#[test]
fn iteration_and_time_limits_are_statuses() {
    let problem = Tracking::default()
        .problem(Tracking::start(1), 20, true)
        .unwrap();
    let mut solution = Solution::new(&problem);
    let few = SolverSettings {
        max_iterations: 2,
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
        let mut solver = ClarabelSolver::new(&problem, settings).unwrap();
        solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        assert_eq!(solution.status, expected);
        assert!(
            solution
                .x
                .iter()
                .all(|x| x.iter().all(|value| value.is_finite()))
        );
    }
}

#[test]
fn shifted_solution_of_a_time_invariant_problem_is_nearly_the_next_one() {
    let tracking = Tracking::default();
    let mut problem = tracking.problem(Tracking::start(5), 30, false).unwrap();
    let mut guess = solve(&problem);
    let (state, input) = (guess.x[1], guess.u[0]);
    guess.shift(&problem).unwrap();
    problem.set_initial_state(&state).unwrap();
    problem.set_previous_input(&input).unwrap();
    let next = solve(&problem);
    // The terminal cost is the unconstrained cost-to-go: after 30 stages the tails differ by the held last input only.
    for k in 0..25 {
        assert!(
            (guess.u[k] - next.u[k]).amax() < 1e-3,
            "stage {k}: {} {}",
            guess.u[k],
            next.u[k]
        );
    }
    let residuals = Residuals::evaluate(&problem, &guess);
    assert!(
        residuals.dynamics.relative() < 1e-7,
        "the shifted states obey the dynamics: {:?}",
        residuals.dynamics
    );
}

#[test]
fn residuals_see_each_kind_of_error() {
    let problem = Tracking::default()
        .problem(Tracking::start(2), 10, true)
        .unwrap();
    let good = solve(&problem);
    assert!(good.residuals.worst() < 1e-6);
    let spoilt = |spoil: &dyn Fn(&mut Solution<6, 2>)| {
        let mut bad = good.clone();
        spoil(&mut bad);
        bad.evaluate(&problem);
        bad.residuals
    };
    assert!(spoilt(&|bad| bad.x[5][0] += 1e-3).dynamics.absolute > 1e-4);
    assert!(spoilt(&|bad| bad.u[4][1] += 1e-3).stationarity.absolute > 1e-5);
    assert!(spoilt(&|bad| bad.u[4][1] += 100.0).constraints.absolute > 1.0);
    assert!(
        spoilt(&|bad| bad.multipliers.stages[3].u_max[0] = -1.0)
            .multiplier_signs
            .absolute
            >= 1.0
    );
    assert!(
        spoilt(&|bad| bad.multipliers.stages[3].u_max[0] += 1.0)
            .complementarity
            .absolute
            > 1.0
    );
    assert!(
        spoilt(&|bad| bad.slacks.stages[3].x_max[0] = 1.0)
            .constraints
            .absolute
            >= 1.0
    );
    assert!(spoilt(&|bad| bad.u[0][0] = f64::NAN).worst().is_infinite());
}

#[test]
fn solution_of_another_shape_is_refused() {
    let tracking = Tracking::default();
    let long = tracking.problem(Vector6::zeros(), 5, false).unwrap();
    let short = tracking.problem(Vector6::zeros(), 4, false).unwrap();
    let cone = tracking.problem(Vector6::zeros(), 5, true).unwrap();
    let mut solver = ClarabelSolver::new(&long, SolverSettings::default()).unwrap();
    for other in [&short, &cone] {
        let refused = solver.solve(&long, Start::Cold, &mut Solution::new(other));
        assert!(
            matches!(refused, Err(SolveError::SolutionShape { .. })),
            "{refused:?}"
        );
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
    let solution = solve(&problem);
    // min a^2/2 + b^2/2 - b with b <= a + 1/2: a = 1/4, b = 3/4.
    assert!((solution.u[0][0] - 0.25).abs() < 1e-6 && (solution.u[1][0] - 0.75).abs() < 1e-6);
    assert!((solution.x[2] - solution.x[1]).amax() < 1e-8);
}
