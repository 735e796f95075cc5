//! Problems at the edge of what is well posed, through both solvers: weights and sets of extreme size and condition, starts on a constraint,
//! constraints given twice and pairs of them without interior, over one stage and over two hundred.

use crate::{answers, same_cost, structured};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ConstraintGroup, HalfSpace, OcpQp, Row, Slacks, SolveStatus, Stage, Terminal, TerminalSet,
};
use nalgebra::{Matrix1, Matrix2, Matrix6, SVector, Vector1, Vector2, Vector6};

const HORIZONS: [usize; 3] = [1, 20, 200];

/// The benchmark's problem with another stage and end.
fn tracked(stage: &Stage<6, 2>, seed: u64, horizon: usize, terminal: Terminal<6>) -> OcpQp<6, 2> {
    OcpQp::new(
        Tracking::start(seed),
        vec![stage.clone(); horizon],
        terminal,
    )
    .unwrap()
}

/// A dense matrix of condition 1e8: a reflection of its eigenvalues.
fn of_condition_1e8() -> Matrix6<f64> {
    let normal = Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0).normalize();
    let reflection = Matrix6::identity() - normal * normal.transpose() * 2.0;
    let eigenvalues = Vector6::new(1e-4, 1e-2, 1.0, 1e1, 1e3, 1e4);
    let full = reflection * Matrix6::from_diagonal(&eigenvalues) * reflection;
    (full + full.transpose()) * 0.5
}

#[test]
fn weights_from_1e_minus_6_to_1e6_beside_each_other() {
    let mut stage = Tracking::default().stage;
    stage.q = Matrix6::from_diagonal(&Vector6::new(1e6, 1e-6, 1.0, 1e3, 1e-3, 1e6));
    stage.r = Matrix2::from_diagonal(&Vector2::new(1e-6, 1e6));
    for horizon in HORIZONS {
        for seed in 0..4 {
            let terminal = Terminal::new(stage.q);
            same_cost("weights", &tracked(&stage, seed, horizon, terminal));
        }
    }
}

#[test]
fn terminal_weight_and_ellipsoid_of_condition_1e8() {
    let Tracking {
        stage, p: weight, ..
    } = Tracking::default();
    let p = of_condition_1e8();
    for horizon in HORIZONS {
        let mut terminal = Terminal::new(p);
        let free = same_cost("weight", &tracked(&stage, 2, horizon, terminal.clone()));
        // Another plan's end is within reach, but not where this cost leads to.
        let other = tracked(&stage, 2, horizon, Terminal::new(weight));
        let end = structured(&other).x[horizon];
        terminal.set = TerminalSet::Ellipsoid {
            shape: p,
            center: Vector6::zeros(),
            level: 0.99 * end.dot(&(p * end)),
        };
        let inside = same_cost("ellipsoid", &tracked(&stage, 2, horizon, terminal));
        assert!(inside >= free * (1.0 - 1e-7), "{inside} and {free}");
    }
}

#[test]
fn tiny_ellipsoids_are_met() {
    let Tracking { stage, p, .. } = Tracking::default();
    for horizon in HORIZONS {
        let start = Tracking::start(1);
        let free = structured(&tracked(&stage, 1, horizon, Terminal::new(p)));
        // Around where slightly weaker inputs end.
        let center = (free.u.iter()).fold(start, |x, u| stage.successor(&x, &(u * 0.999)));
        for level in [1e-6, 1e-10, 1e-16] {
            let mut terminal = Terminal::new(p);
            terminal.set = TerminalSet::Ellipsoid {
                shape: p,
                center,
                level,
            };
            let problem = tracked(&stage, 1, horizon, terminal);
            same_cost("tiny set", &problem);
            let off = structured(&problem).x[horizon] - center;
            let (reach, radius) = (off.dot(&(p * off)).sqrt(), f64::sqrt(level));
            assert!(
                reach <= radius + 1e-9,
                "{reach:e} from the centre of {radius:e}"
            );
        }
    }
}

#[test]
fn start_on_the_boundary_of_the_terminal_ellipsoid_with_a_wish_beyond_it() {
    let Tracking { stage, p, .. } = Tracking::default();
    // One stage cannot keep every start within: speed and spin are limited in their rate.
    for horizon in [20, 200] {
        for seed in 0..4 {
            let start = Tracking::start(seed);
            let mut terminal = Terminal::new(p);
            terminal.p_linear = p * start * -10.0;
            terminal.set = TerminalSet::Ellipsoid {
                shape: p,
                center: Vector6::zeros(),
                level: start.dot(&(p * start)),
            };
            let problem = tracked(&stage, seed, horizon, terminal);
            same_cost("start", &problem);
            for (solver, solution) in answers(&problem) {
                let multipliers = &solution.multipliers;
                let bound = multipliers.exact_penalty_bound(ConstraintGroup::TerminalSet);
                assert!(bound > 1.0, "{solver}, N = {horizon}, {seed}: {bound:e}");
            }
        }
    }
}

/// A double integrator, |u| <= 1, from rest at 1.
fn integrator() -> (Stage<2, 1>, Vector2<f64>) {
    let mut stage = Stage::new(Matrix2::new(1.0, 0.1, 0.0, 1.0), Vector2::new(0.005, 0.1));
    (stage.q, stage.r) = (Matrix2::identity(), Matrix1::new(0.1));
    (stage.u_min[0], stage.u_max[0]) = (-1.0, 1.0);
    (stage, Vector2::new(1.0, 0.0))
}

#[test]
fn start_on_a_bound_that_the_cost_pushes_against_stays_there() {
    let (mut stage, start) = integrator();
    // The wish is at 3, the wall at 1.
    (stage.q_linear[0], stage.x_max[0]) = (-3.0, 1.0);
    let mut terminal = Terminal::new(stage.q);
    (terminal.p_linear[0], terminal.x_max[0]) = (-3.0, 1.0);
    for horizon in HORIZONS {
        let stages = vec![stage.clone(); horizon];
        let problem = OcpQp::new(start, stages, terminal.clone()).unwrap();
        for (solver, solution) in answers(&problem) {
            assert_eq!(solution.status, SolveStatus::Solved, "{solver}");
            let moved = solution.u.iter().map(SVector::amax).fold(0.0, f64::max);
            // The wall's multiplier is of the order of the horizon; what a gap of 1e-11 leaves of its distance is over dt^2 in u.
            assert!(moved <= 1e-6, "{solver}, N = {horizon}: {moved:e}");
        }
    }
}

/// The row `0.5 x_1 + 0.8 x_2 + u <= upper`, times a factor.
fn feedback_row(factor: f64, upper: f64) -> Row<2, 1> {
    Row {
        g_x: Vector2::new(0.5, 0.8) * factor,
        h_u: Vector1::new(factor),
        upper: upper * factor,
    }
}

#[test]
fn opposed_rows_are_an_equation() {
    let (mut stage, start) = integrator();
    stage.rows = vec![feedback_row(1.0, 0.0), feedback_row(-1.0, 0.0)];
    for horizon in HORIZONS {
        let stages = vec![stage.clone(); horizon];
        let problem = OcpQp::new(start, stages, Terminal::new(stage.q)).unwrap();
        // u = -(0.5, 0.8) x at every stage: the only trajectory there is.
        let (mut x, mut u) = (vec![start], Vec::new());
        for k in 0..horizon {
            u.push(Vector1::new(-0.5 * x[k][0] - 0.8 * x[k][1]));
            x.push(stage.successor(&x[k], &u[k]));
        }
        let cost = problem.objective(&x, &u, &Slacks::zeros(&problem));
        let found = same_cost("opposed rows", &problem);
        assert!((found - cost).abs() <= 1e-7 * cost, "{found} for {cost}");
    }
}

#[test]
fn rows_given_several_times_change_nothing() {
    let (stage, start) = integrator();
    for horizon in HORIZONS {
        let cost = |factors: &[f64]| {
            let mut stage = stage.clone();
            let rows = factors.iter().map(|&factor| feedback_row(factor, -0.1));
            stage.rows = rows.collect();
            let terminal = Terminal::new(stage.q);
            let problem = OcpQp::new(start, vec![stage; horizon], terminal).unwrap();
            same_cost("rows", &problem)
        };
        let (once, more) = (cost(&[1.0]), cost(&[1.0, 1.0, 1e3, 1e-3]));
        assert!((more - once).abs() <= 1e-7 * once, "{more} for {once}");
    }
}

#[test]
fn point_at_the_end_may_be_said_in_any_way_and_twice() {
    let (stage, start) = integrator();
    for horizon in HORIZONS {
        let u = Vector1::new(-0.3);
        let target = (0..horizon).fold(start, |x, _| stage.successor(&x, &u));
        let cost = |bounded: bool, set: TerminalSet<2>| {
            let mut terminal = Terminal::new(stage.q);
            if bounded {
                (terminal.x_min, terminal.x_max) = (target, target);
            }
            terminal.set = set;
            let problem = OcpQp::new(start, vec![stage.clone(); horizon], terminal).unwrap();
            same_cost("point", &problem)
        };
        let faces = (0..2).flat_map(|i| {
            [1.0, -1.0].map(|sign| HalfSpace {
                normal: Vector2::from_fn(|j, _| if i == j { sign } else { 0.0 }),
                upper: sign * target[i],
            })
        });
        let faces = TerminalSet::Polytope {
            faces: faces.collect(),
        };
        let point = TerminalSet::Equality { target };
        let once = cost(false, point.clone());
        for other in [
            cost(true, point),
            cost(true, TerminalSet::None),
            cost(false, faces),
        ] {
            assert!((other - once).abs() <= 1e-7 * once, "{other} for {once}");
        }
    }
}
