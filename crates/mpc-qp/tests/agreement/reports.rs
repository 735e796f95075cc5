//! What is reported of a point, spoilt in one place at a time: no kind of error may go unseen.

use crate::structured;
use mpc_qp::problems::known;
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ConstraintGroup, HalfSpace, OcpQp, Penalty, Residuals, Row, Softening, Solution, Stage,
    Terminal, TerminalSet, TerminalSetMultipliers, TerminalSetSlacks,
};
use nalgebra::{Matrix1, Matrix2, Vector1, Vector2, Vector6};

#[test]
fn residuals_see_each_kind_of_error() {
    let problem = Tracking::default()
        .problem(Tracking::start(2), 10, true)
        .unwrap();
    let good = structured(&problem);
    assert!(good.residuals.worst() < 1e-6);
    let spoilt = |spoil: &dyn Fn(&mut Solution<6, 2>)| {
        let mut bad = good.clone();
        spoil(&mut bad);
        bad.evaluate(&problem);
        bad.residuals
    };
    // Another start: the dynamics hold, but from elsewhere.
    let mut moved = problem.clone();
    let start = problem.initial_state() + Vector6::repeat(1e-3);
    moved.set_initial_state(&start).unwrap();
    let elsewhere = Residuals::evaluate(&moved, &good);
    assert!(elsewhere.dynamics.absolute > 9e-4, "{elsewhere:?}");
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
fn residuals_see_errors_of_slacks_and_of_the_cone() {
    let spoilt = |penalty, spoil: fn(&mut Solution<2, 2>)| {
        let problem = known::soft_disc_out_of_reach(penalty).unwrap().problem;
        let mut solution = structured(&problem);
        assert!(solution.residuals.worst() < 1e-6);
        spoil(&mut solution);
        solution.evaluate(&problem);
        solution.residuals
    };
    // The disc grows by 3 at the price of 1, or by 2 against a force of 2.
    let exact = Penalty::Exact { weight: 1.0 };
    let cheap = spoilt(exact, |bad| {
        if let TerminalSetMultipliers::Ellipsoid { radius, offset } =
            &mut bad.multipliers.terminal.set
        {
            (*radius, *offset) = (0.5 * *radius, 0.5 * *offset);
        }
    });
    assert!(cheap.complementarity.absolute > 1.0, "{cheap:?}");
    let outside = spoilt(exact, |bad| {
        if let TerminalSetMultipliers::Ellipsoid { offset, .. } = &mut bad.multipliers.terminal.set
        {
            *offset *= 2.0;
        }
    });
    assert!(outside.multiplier_signs.absolute > 0.9, "{outside:?}");
    // Multiplier 1 at |x| = 4, where the grown disc ends: half the way it is no boundary, half as far again is outside.
    let within = spoilt(exact, |bad| bad.x[1] *= 0.5);
    assert!(within.complementarity.absolute > 1.9, "{within:?}");
    let beyond = spoilt(exact, |bad| bad.x[1] *= 1.5);
    assert!(beyond.constraints.absolute > 1.9, "{beyond:?}");
    let larger = spoilt(Penalty::Quadratic { weight: 1.0 }, |bad| {
        bad.slacks.terminal.set = TerminalSetSlacks::Ellipsoid(2.1);
    });
    assert!(larger.stationarity.absolute > 0.09, "{larger:?}");
}

#[test]
fn huge_component_hides_no_error_of_a_small_one_beside_it() {
    // A position of 1e9 and an angle of 0.3 in one state: the angle is wrong by 1e-3.
    let mut stage = Stage::new(Matrix2::identity(), Vector2::new(0.0, 0.1));
    (stage.q, stage.r) = (Matrix2::identity(), Matrix1::identity());
    let problem = OcpQp::new(
        Vector2::new(1e9, 0.3),
        vec![stage; 5],
        Terminal::new(Matrix2::identity()),
    )
    .unwrap();
    let good = structured(&problem);
    assert!(good.residuals.worst() <= 1e-9, "{:?}", good.residuals);
    let mut bad = good.clone();
    bad.x[3][1] += 1e-3;
    bad.evaluate(&problem);
    let residuals = bad.residuals;
    assert!(residuals.dynamics.relative() > 1e-4, "{residuals:?}");
    assert!(residuals.stationarity.relative() > 1e-4, "{residuals:?}");
}

/// Residuals of the answer to `soft_bound_out_of_reach`, spoilt: u = 0.25 at a price of 0.25, or with 3 w / (1 + w) = 0.6 at 0.25.
fn soft_bound_spoilt(penalty: Penalty, spoil: fn(&mut Solution<1, 1>)) -> Residuals {
    let problem = known::soft_bound_out_of_reach(penalty).unwrap().problem;
    let mut solution = structured(&problem);
    assert!(solution.residuals.worst() < 1e-6);
    spoil(&mut solution);
    solution.evaluate(&problem);
    solution.residuals
}

#[test]
fn residuals_see_errors_of_soft_bounds_and_at_the_end() {
    let weight = 0.25;
    let (exact, quadratic) = (Penalty::Exact { weight }, Penalty::Quadratic { weight });
    for penalty in [exact, quadratic] {
        let negative = soft_bound_spoilt(penalty, |bad| bad.slacks.terminal.x_max[0] = -0.5);
        assert!(negative.constraints.absolute >= 0.5, "{negative:?}");
        // Beyond the bound, where nothing but its sign is wrong with a slack.
        let negative = soft_bound_spoilt(penalty, |bad| {
            (bad.x[1][0], bad.slacks.terminal.x_min[0]) = (4.0, -0.5);
        });
        assert!(negative.constraints.absolute >= 0.5, "{negative:?}");
        let absent = soft_bound_spoilt(penalty, |bad| bad.multipliers.terminal.x_max[0] = 0.5);
        assert!(absent.multiplier_signs.absolute >= 0.5, "{absent:?}");
        let unbalanced = soft_bound_spoilt(penalty, |bad| bad.multipliers.terminal.x_min[0] -= 0.1);
        assert!(unbalanced.stationarity.absolute > 0.09, "{unbalanced:?}");
    }
    let dear = soft_bound_spoilt(exact, |bad| bad.multipliers.terminal.x_min[0] = 0.5);
    assert!(dear.multiplier_signs.absolute > 0.2, "{dear:?}");
    let cheap = soft_bound_spoilt(exact, |bad| bad.multipliers.terminal.x_min[0] = 0.0);
    assert!(cheap.complementarity.absolute > 0.2, "{cheap:?}");
    let large = soft_bound_spoilt(quadratic, |bad| bad.slacks.terminal.x_min[0] += 1.0);
    assert!(large.stationarity.absolute > 0.2, "{large:?}");
}

#[test]
fn residuals_see_errors_of_a_point_at_the_end() {
    // One step to 3, which costs u^2 / 2 against a price of 0.5 for what is missing: u = 0.5.
    let mut stage = Stage::new(Matrix1::zeros(), Matrix1::new(1.0));
    stage.r[0] = 1.0;
    let mut terminal = Terminal::new(Matrix1::zeros());
    terminal.set = TerminalSet::Equality {
        target: Vector1::new(3.0),
    };
    let softening = Softening {
        terminal_set: Penalty::Exact { weight: 0.5 },
        ..Softening::default()
    };
    let problem = OcpQp::new(Vector1::zeros(), vec![stage], terminal).unwrap();
    let problem = problem.with_softening(softening).unwrap();
    let good = structured(&problem);
    assert!((good.u[0][0] - 0.5).abs() < 1e-6 && good.residuals.worst() < 1e-6);
    let mut unbalanced = good.clone();
    unbalanced.slacks.terminal.set = TerminalSetSlacks::Equality(Vector1::new(-2.0));
    unbalanced.evaluate(&problem);
    assert!(unbalanced.residuals.dynamics.absolute > 0.4);
    for (multiplier, least) in [(-1.0, 0.4), (1.0, 0.4)] {
        let mut dear = good.clone();
        dear.multipliers.terminal.set = TerminalSetMultipliers::Equality(Vector1::new(multiplier));
        dear.evaluate(&problem);
        assert!(dear.residuals.multiplier_signs.absolute > least);
    }
}

/// Writes 3 in one place of the multipliers and of the slacks.
type Place = fn(&mut Solution<2, 1>);

#[test]
fn bounds_on_prices_violations_and_cost_see_every_place() {
    let mut stage = Stage::<2, 1>::new(Matrix2::identity(), Vector2::new(0.0, 1.0));
    stage.rows = vec![Row {
        g_x: Vector2::zeros(),
        h_u: Vector1::new(1.0),
        upper: 1.0,
    }];
    let face = HalfSpace {
        normal: Vector2::new(1.0, 0.0),
        upper: 1.0,
    };
    let target = Vector2::zeros();
    for set in [
        TerminalSet::Polytope { faces: vec![face] },
        TerminalSet::Equality { target },
    ] {
        let mut terminal = Terminal::new(Matrix2::zeros());
        terminal.set = set;
        let price = Penalty::Exact { weight: 2.0 };
        let softening = Softening {
            state_bounds: price,
            rows: price,
            terminal_set: price,
        };
        let problem = OcpQp::new(Vector2::zeros(), vec![stage.clone(); 2], terminal).unwrap();
        let problem = problem.with_softening(softening).unwrap();
        let zero = Solution::new(&problem);
        let places: [(ConstraintGroup, Place); 6] = [
            (ConstraintGroup::StateBounds, |it| {
                it.multipliers.stages[1].x_min[1] = 3.0;
                it.slacks.stages[1].x_min[1] = 3.0;
            }),
            (ConstraintGroup::StateBounds, |it| {
                it.multipliers.stages[1].x_max[0] = 3.0;
                it.slacks.stages[1].x_max[0] = 3.0;
            }),
            (ConstraintGroup::StateBounds, |it| {
                it.multipliers.terminal.x_min[1] = 3.0;
                it.slacks.terminal.x_min[1] = 3.0;
            }),
            (ConstraintGroup::StateBounds, |it| {
                it.multipliers.terminal.x_max[0] = 3.0;
                it.slacks.terminal.x_max[0] = 3.0;
            }),
            (ConstraintGroup::Rows, |it| {
                it.multipliers.stages[1].rows[0] = 3.0;
                it.slacks.stages[1].rows[0] = 3.0;
            }),
            (ConstraintGroup::TerminalSet, |it| {
                match &mut it.multipliers.terminal.set {
                    TerminalSetMultipliers::Equality(multiplier) => multiplier[1] = -3.0,
                    TerminalSetMultipliers::Polytope(multipliers) => multipliers[0] = 3.0,
                    _ => {}
                }
                match &mut it.slacks.terminal.set {
                    TerminalSetSlacks::Equality(violation) => violation[1] = -3.0,
                    TerminalSetSlacks::Polytope(violations) => violations[0] = 3.0,
                    _ => {}
                }
            }),
        ];
        for (group, place) in places {
            let mut it = zero.clone();
            place(&mut it);
            let found = [
                it.multipliers.exact_penalty_bound(group),
                it.slacks.largest(group),
            ];
            assert_eq!(found, [3.0, 3.0], "{group}");
            // The violation is paid for, wherever it is.
            assert_eq!(problem.objective(&it.x, &it.u, &it.slacks), 6.0, "{group}");
        }
    }
}
