//! Softening, infeasibility and blame, each claim for both solvers.

use crate::{answers, refused_for};
use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::{
    BlameEntry, ConstraintGroup, OcpQp, Penalty, Place, Row, Softening, Solution, SolveStatus,
    Stage, Terminal, TerminalSet, TerminalSetMultipliers, examine_certificate,
};
use nalgebra::{Matrix1, Matrix2, SMatrix, SVector, Vector1, Vector2};

/// `penalty` on one group that can be softened.
fn soft(group: ConstraintGroup, penalty: Penalty) -> Softening {
    let mut softening = Softening::default();
    match group {
        ConstraintGroup::StateBounds => softening.state_bounds = penalty,
        ConstraintGroup::Rows => softening.rows = penalty,
        _ => softening.terminal_set = penalty,
    }
    softening
}

/// Largest distance of inputs and states.
fn distance<const NX: usize, const NU: usize>(
    one: &Solution<NX, NU>,
    other: &Solution<NX, NU>,
) -> f64 {
    let of_inputs = one.u.iter().zip(&other.u).map(|(a, b)| (a - b).amax());
    let of_states = one.x.iter().zip(&other.x).map(|(a, b)| (a - b).amax());
    of_inputs.chain(of_states).fold(0.0, f64::max)
}

#[test]
fn exact_penalty_above_the_multiplier_bound_leaves_the_solution_and_below_it_gives_way() {
    let groups = [
        ConstraintGroup::StateBounds,
        ConstraintGroup::Rows,
        ConstraintGroup::TerminalSet,
    ];
    let (mut held, mut gave) = ([0; 2], [0; 2]);
    for seed in 0..100 {
        let recipe = Recipe {
            state_bounds: true,
            horizon: 10,
            ..Recipe::feasible(seed, 10)
        };
        let problem = random::problem::<4, 2>(seed, &recipe).unwrap();
        let hard = answers(&problem);
        let active = groups.map(|group| (group, hard[0].1.multipliers.exact_penalty_bound(group)));
        for (group, bound) in active.into_iter().filter(|(_, bound)| *bound >= 1e-3) {
            for factor in [2.0, 0.5] {
                let weight = factor * bound;
                let softening = soft(group, Penalty::Exact { weight });
                let softened = problem.clone().with_softening(softening).unwrap();
                for (i, (solver, soft)) in answers(&softened).into_iter().enumerate() {
                    let violation = soft.slacks.largest(group);
                    let (hard, reported) =
                        (&hard[i].1, soft.multipliers.exact_penalty_bound(group));
                    let saved = (hard.objective - soft.objective) / hard.objective.abs().max(1.0);
                    if factor > 1.0 {
                        // Clarabel's gap of 1e-11 of the cost, or rounding, over a price at least 1e-3 above the multiplier.
                        assert!(
                            violation < 1e-7 && saved.abs() < 1e-8,
                            "{solver}, seed {seed} {group}: {violation:e} {saved:e}"
                        );
                        // Two answers to one problem, each within its gap of the optimum.
                        let apart = distance(hard, &soft);
                        assert!(apart <= 1e-4, "{solver}, seed {seed} {group}: {apart:e}");
                        // The multipliers are the hard problem's, so the bound that it reports is the one that made the price exact.
                        let error = (reported - bound).abs() / bound;
                        assert!(error <= 2e-4, "{solver}, seed {seed} {group}: {error:e}");
                        held[i] += 1;
                    } else {
                        assert!(saved > -1e-7, "a relaxation costs no more: {saved:e}");
                        gave[i] += usize::from(violation > 1e-6);
                    }
                }
            }
        }
    }
    assert!(
        held.into_iter().all(|held| held > 70) && gave.into_iter().all(|gave| gave > 55),
        "{held:?} held, {gave:?} gave way"
    );
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
            ..row
        },
    ];
    let problem = OcpQp::new(Vector1::zeros(), stages, Terminal::new(Matrix1::zeros())).unwrap();
    for (solver, solution) in answers(&problem) {
        let SolveStatus::PrimalInfeasible { certificate, blame } = solution.status else {
            panic!("{solver}: {:?}", solution.status);
        };
        assert!(certificate.residual < 1e-7, "{solver}");
        let first = blame.entries().next().unwrap();
        assert_eq!(
            (first.group, first.worst),
            (ConstraintGroup::Rows, Place::Stage(3)),
            "{solver}"
        );
        assert!(first.share > 0.99, "{solver}: {blame:?}");
    }
}

#[test]
fn blame_tells_from_where_to_where_and_where_most() {
    // x+ = 2 x + u reaches 31 from rest: an input counts twice as much as the one after it.
    let mut stage = Stage::new(Matrix1::new(2.0), Matrix1::new(1.0));
    (stage.r[0], stage.u_min[0], stage.u_max[0]) = (1.0, -1.0, 1.0);
    let mut terminal = Terminal::new(Matrix1::zeros());
    terminal.set = TerminalSet::Equality {
        target: Vector1::new(40.0),
    };
    let problem = OcpQp::new(Vector1::zeros(), vec![stage; 5], terminal).unwrap();
    for (solver, solution) in answers(&problem) {
        let SolveStatus::PrimalInfeasible { blame, .. } = solution.status else {
            panic!("{solver}: {:?}", solution.status);
        };
        let inputs = |entry: &&BlameEntry| entry.group == ConstraintGroup::InputBounds;
        let entry = blame.entries().find(inputs).unwrap();
        assert_eq!(
            [entry.first, entry.worst, entry.last],
            [Place::Stage(0), Place::Stage(0), Place::Stage(4)],
            "{solver}"
        );
    }
}

/// The problem in other units: `x = state X`, `u = input U`, rows multiplied by `row`; and the same ray in them.
fn in_other_units<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
    [state, input, row]: [&dyn Fn(usize) -> f64; 3],
) -> (OcpQp<NX, NU>, Solution<NX, NU>) {
    let x = SVector::<f64, NX>::from_fn(|i, _| state(i));
    let u = SVector::<f64, NU>::from_fn(|i, _| input(i));
    let [to_x, of_x] = [
        SMatrix::from_diagonal(&x.map(f64::recip)),
        SMatrix::from_diagonal(&x),
    ];
    let of_u = SMatrix::from_diagonal(&u);
    let mut ray = solution.clone();
    let mut stages = problem.stages().to_vec();
    for (k, (stage, y)) in stages
        .iter_mut()
        .zip(&mut ray.multipliers.stages)
        .enumerate()
    {
        (stage.a, stage.b, stage.c) =
            (to_x * stage.a * of_x, to_x * stage.b * of_u, to_x * stage.c);
        for bound in [
            &mut stage.u_min,
            &mut stage.u_max,
            &mut stage.du_min,
            &mut stage.du_max,
        ] {
            bound.component_div_assign(&u);
        }
        for bound in [&mut stage.x_min, &mut stage.x_max] {
            bound.component_div_assign(&x);
        }
        for y in [&mut y.u_min, &mut y.u_max, &mut y.du_min, &mut y.du_max] {
            y.component_mul_assign(&u);
        }
        for y in [&mut y.x_min, &mut y.x_max] {
            y.component_mul_assign(&x);
        }
        for (i, (constraint, y)) in stage.rows.iter_mut().zip(&mut y.rows).enumerate() {
            constraint.g_x.component_mul_assign(&x);
            constraint.h_u.component_mul_assign(&u);
            constraint.g_x *= row(i);
            constraint.h_u *= row(i);
            constraint.upper *= row(i);
            *y /= row(i);
        }
        // Costs play no part.
        (stage.q, stage.r, stage.s) = (SMatrix::zeros(), SMatrix::zeros(), SMatrix::zeros());
        ray.multipliers.costates[k].component_mul_assign(&x);
    }
    let mut terminal = problem.terminal().clone();
    terminal.p = SMatrix::zeros();
    terminal.x_min.component_div_assign(&x);
    terminal.x_max.component_div_assign(&x);
    ray.multipliers.terminal.x_min.component_mul_assign(&x);
    ray.multipliers.terminal.x_max.component_mul_assign(&x);
    match &mut terminal.set {
        TerminalSet::Equality { target } => target.component_div_assign(&x),
        TerminalSet::Ellipsoid { shape, center, .. } => {
            *shape = of_x * *shape * of_x;
            center.component_div_assign(&x);
        }
        TerminalSet::Polytope { faces } => {
            for face in faces {
                face.normal.component_mul_assign(&x);
            }
        }
        TerminalSet::None => {}
    }
    if let TerminalSetMultipliers::Equality(y) = &mut ray.multipliers.terminal.set {
        y.component_mul_assign(&x);
    }
    let start = to_x * problem.initial_state();
    let mut scaled = OcpQp::new(start, stages, terminal).unwrap();
    let before = problem.previous_input().component_div(&u);
    scaled.set_previous_input(&before).unwrap();
    (scaled, ray)
}

// Powers of two, so that the same ray is the same to the last bit.
#[test]
fn blame_does_not_depend_on_units() {
    for seed in 0..60 {
        let recipe = Recipe::infeasible(seed, 20);
        let problem = random::problem::<4, 2>(seed, &recipe).unwrap();
        let [(_, solution), _] = answers(&problem);
        let (proof, blame) = examine_certificate(&problem, &solution);
        assert!(proof.residual < 1e-7, "seed {seed}: {proof:?}");
        let units: [&dyn Fn(usize) -> f64; 3] = [
            &|i| [1048576.0, 1.0, 1048576_f64.recip(), 1024_f64.recip()][i],
            &|i| [1048576_f64.recip(), 1024.0][i],
            &|i| if i == 0 { 1048576.0 } else { 1024_f64.recip() },
        ];
        let (scaled, ray) = in_other_units(&problem, &solution, units);
        let (_, other) = examine_certificate(&scaled, &ray);
        assert_eq!(other, blame, "seed {seed}");
    }
}

#[test]
fn softening_the_blamed_group_makes_the_problem_feasible() {
    let group = ConstraintGroup::TerminalSet;
    for seed in (3..200).step_by(4) {
        let recipe = Recipe::infeasible(seed, 20);
        let problem = random::problem::<3, 2>(seed, &recipe).unwrap();
        for (solver, solution) in answers(&problem) {
            let SolveStatus::PrimalInfeasible { certificate, blame } = solution.status else {
                panic!("{solver}: seed {seed} is infeasible by construction");
            };
            // Every input is bounded here, so the ray can be made exact.
            assert!(certificate.residual < 1e-11, "{solver}: {certificate:?}");
            assert!(blame.names(group), "{solver}, seed {seed}");
        }
        for penalty in [
            Penalty::Exact { weight: 10.0 },
            Penalty::Quadratic { weight: 10.0 },
        ] {
            let softened = problem
                .clone()
                .with_softening(soft(group, penalty))
                .unwrap();
            for (solver, soft) in answers(&softened) {
                let status = soft.status;
                assert!(status.has_solution(), "{solver}, seed {seed}: {status:?}");
                assert!(
                    soft.slacks.largest(group) > 0.1,
                    "the violation is reported"
                );
            }
        }
    }
}

/// A cost that falls along `u` without end, and a second state at `second` that nothing moves, over one stage at least `least`.
fn falling(u_max: f64, second: f64, least: f64) -> OcpQp<2, 1> {
    let mut stage = Stage::new(Matrix2::identity(), Vector2::new(1.0, 0.0));
    stage.r_linear[0] = 1.0;
    stage.u_max[0] = u_max;
    let mut stages = vec![stage; 3];
    stages[2].x_min[1] = least;
    let terminal = Terminal::new(Matrix2::zeros());
    OcpQp::new(Vector2::new(1.0, second), stages, terminal).unwrap()
}

// Without any bound on the inputs, then with one on the other side.
#[test]
fn unbounded_cost_is_trouble_and_no_reason_to_overlook_a_contradiction() {
    for u_max in [f64::INFINITY, 1.0] {
        for (solver, solution) in answers(&falling(u_max, 1.0, 0.0)) {
            let status = solution.status;
            assert_eq!(status, SolveStatus::NumericalTrouble, "{solver}, {u_max}");
        }
        refused_for(
            &format!("inputs to {u_max}"),
            &falling(u_max, 0.0, 1.0),
            &[ConstraintGroup::StateBounds],
        );
    }
}
