//! Problems of awkward practice through both solvers: unstable over long horizons, without curvature, in unsuitable units, without
//! freedom, out of reach.

use crate::{refused_for, regulated, same_cost};
use mpc_qp::{ConstraintGroup, OcpQp, Slacks, Stage, Terminal, TerminalSet};
use nalgebra::{Matrix1, Matrix2, Vector1, Vector2};

#[test]
fn unstable_pair_is_steered_over_a_hundred_stages_or_refused() {
    let a = Matrix2::new(1.2, 1.0, 0.0, 1.2);
    let (stage, mut terminal) = regulated(
        Stage::new(a, Vector2::new(0.5, 1.0)),
        Vector2::repeat(1.0),
        Vector1::new(0.1),
        Vector1::new(1.0),
    );
    let stages = vec![stage; 100];
    let problem = |start, terminal: &Terminal<2>| {
        OcpQp::new(start, stages.clone(), terminal.clone()).unwrap()
    };
    let (near, far) = (Vector2::new(0.3, 0.2), Vector2::new(0.0, 6.0));
    same_cost("free end", &problem(near, &terminal));
    for set in [
        TerminalSet::Equality {
            target: Vector2::zeros(),
        },
        TerminalSet::Ellipsoid {
            shape: Matrix2::identity(),
            center: Vector2::zeros(),
            level: 1e-2,
        },
    ] {
        terminal.set = set;
        same_cost("end in a set", &problem(near, &terminal));
        // |u| <= 1 holds states up to 5 only.
        let groups = [ConstraintGroup::InputBounds];
        refused_for("beyond reach", &problem(far, &terminal), &groups);
    }
}

#[test]
fn cost_without_curvature_is_minimised_at_vertices() {
    // Least total travel to the origin, priced by u itself: u in [0, 1], x_N = x_0 - sum u <= 0.
    let mut stage = Stage::new(Matrix1::new(1.0), Matrix1::new(-1.0));
    (stage.u_min[0], stage.u_max[0]) = (0.0, 1.0);
    let mut stages = vec![stage; 6];
    for (k, stage) in stages.iter_mut().enumerate() {
        stage.r_linear[0] = 1.0 + k as f64;
    }
    let mut terminal = Terminal::new(Matrix1::zeros());
    terminal.x_max[0] = 0.0;
    // The cheapest first: 1 + 2 + half of 3.
    let problem = OcpQp::new(Vector1::new(2.5), stages, terminal).unwrap();
    let cost = same_cost("linear program", &problem);
    assert!((cost - 4.5).abs() <= 1e-6, "{cost}");
}

#[test]
fn cost_does_not_depend_on_the_units_of_position_and_force() {
    let mut costs = Vec::new();
    for (length, force) in [(1.0, 1.0), (1e-1, 1e1), (1e-2, 1e2)] {
        let scale = Matrix2::new(length, 0.0, 0.0, length);
        let (back, a) = (
            scale.try_inverse().unwrap(),
            Matrix2::new(1.0, 0.1, 0.0, 1.0),
        );
        let mut stage = Stage::new(back * a * scale, back * Vector2::new(0.005, 0.1) * force);
        (stage.q, stage.r) = (scale * scale, Matrix1::new(0.1 * force * force));
        (stage.u_min[0], stage.u_max[0]) = (-1.0 / force, 1.0 / force);
        (stage.x_min[1], stage.x_max[1]) = (-0.5 / length, 0.5 / length);
        let mut terminal = Terminal::new(scale * scale);
        terminal.set = TerminalSet::Equality {
            target: Vector2::zeros(),
        };
        let start = back * Vector2::new(1.0, 0.0);
        let problem = OcpQp::new(start, vec![stage; 40], terminal).unwrap();
        costs.push(same_cost("units", &problem));
    }
    for cost in &costs {
        assert!((cost - costs[0]).abs() <= 1e-6 * costs[0], "{costs:?}");
    }
}

#[test]
fn inputs_without_freedom_are_followed() {
    // u_min = u_max, then a rate of zero: the only trajectory there is, at its cost.
    let stage = Stage::new(Matrix2::new(1.0, 0.1, 0.0, 1.0), Vector2::new(0.005, 0.1));
    let weights = (Vector2::repeat(1.0), Vector1::new(0.1));
    let (stage, terminal) = regulated(stage, weights.0, weights.1, Vector1::new(1.0));
    let (mut fixed, mut held) = (stage.clone(), stage);
    fixed.u_min[0] = 0.25;
    fixed.u_max[0] = 0.25;
    (held.du_min[0], held.du_max[0]) = (0.0, 0.0);
    for stage in [fixed, held] {
        for horizon in [1, 40] {
            let stages = vec![stage.clone(); horizon];
            let mut problem = OcpQp::new(Vector2::new(1.0, 0.0), stages, terminal.clone()).unwrap();
            problem.set_previous_input(&Vector1::new(0.25)).unwrap();
            let mut x = Vec::new();
            let u = vec![Vector1::new(0.25); horizon];
            problem.rollout(&u, &mut x);
            let cost = problem.objective(&x, &u, &Slacks::zeros(&problem));
            let found = same_cost("no freedom", &problem);
            assert!((found - cost).abs() <= 1e-6 * cost, "{found} for {cost}");
        }
    }
}

#[test]
fn inputs_that_cannot_move_are_blamed_together_with_what_they_miss() {
    let mut stage = Stage::new(Matrix2::new(1.0, 0.1, 0.0, 1.0), Vector2::new(0.005, 0.1));
    let mut terminal = Terminal::new(Matrix2::identity());
    terminal.set = TerminalSet::Equality {
        target: Vector2::zeros(),
    };
    (stage.u_min[0], stage.u_max[0]) = (0.0, 0.0);
    let start = Vector2::new(1.0, 0.0);
    let problem = OcpQp::new(start, vec![stage.clone(); 20], terminal.clone()).unwrap();
    let groups = [ConstraintGroup::InputBounds, ConstraintGroup::TerminalSet];
    refused_for("no input", &problem, &groups);
    // The same by the rate: what was applied last is applied for ever.
    stage.u_min[0] = -1.0;
    stage.u_max[0] = 1.0;
    (stage.du_min[0], stage.du_max[0]) = (0.0, 0.0);
    let problem = OcpQp::new(start, vec![stage.clone(); 20], terminal).unwrap();
    let groups = [ConstraintGroup::RateLimits, ConstraintGroup::TerminalSet];
    refused_for("no rate", &problem, &groups);
    // A start too fast to stop at the wall, two stages ahead.
    (stage.du_min[0], stage.du_max[0]) = (f64::NEG_INFINITY, f64::INFINITY);
    (stage.q, stage.x_max[0]) = (Matrix2::identity(), 1.0);
    let stages = vec![stage; 20];
    let problem = OcpQp::new(
        Vector2::new(0.9, 1.0),
        stages,
        Terminal::new(Matrix2::identity()),
    )
    .unwrap();
    refused_for(
        "wall",
        &problem,
        &[ConstraintGroup::InputBounds, ConstraintGroup::StateBounds],
    );
}
