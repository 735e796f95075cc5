//! Wrong data are errors that name the stage and the field; a refused refill changes nothing.

#![expect(clippy::unwrap_used, reason = "helpers of tests may fail loudly")]

use mpc_qp::{
    ConstraintGroup, HalfSpace, OcpQp, Penalty, Place, ProblemError, Row, Softening, Stage,
    Terminal, TerminalSet,
};
use nalgebra::{Matrix1, Matrix2, Matrix3, Vector1, Vector2, Vector3};

fn stage() -> Stage<2, 1> {
    let mut stage = Stage::new(Matrix2::identity(), Vector2::new(0.0, 1.0));
    (stage.q, stage.r) = (Matrix2::identity(), Matrix1::identity());
    stage.rows = vec![Row {
        g_x: Vector2::zeros(),
        h_u: Vector1::new(1.0),
        upper: 1.0,
    }];
    stage
}

fn terminal() -> Terminal<2> {
    let mut terminal = Terminal::new(Matrix2::identity());
    terminal.set = TerminalSet::Ellipsoid {
        shape: Matrix2::identity(),
        center: Vector2::zeros(),
        level: 1.0,
    };
    terminal
}

fn problem() -> OcpQp<2, 1> {
    OcpQp::new(Vector2::zeros(), vec![stage(); 3], terminal()).unwrap()
}

/// The error of refilling stage 1 with one field spoilt; the problem must stay as it was.
fn refused(spoil: impl Fn(&mut Stage<2, 1>)) -> ProblemError {
    let mut problem = problem();
    let before = problem.clone();
    let mut bad = stage();
    spoil(&mut bad);
    let error = problem.set_stage(1, &bad).unwrap_err();
    assert_eq!(problem, before, "a refused refill changes nothing");
    assert_eq!(
        OcpQp::new(Vector2::zeros(), vec![stage(), bad, stage()], terminal()).ok(),
        None
    );
    error
}

fn refused_terminal(spoil: impl Fn(&mut Terminal<2>)) -> ProblemError {
    let mut problem = problem();
    let before = problem.clone();
    let mut bad = terminal();
    spoil(&mut bad);
    let error = problem.set_terminal(&bad).unwrap_err();
    assert_eq!(problem, before, "a refused refill changes nothing");
    error
}

#[test]
fn nan_and_infinity_are_refused_in_every_field() {
    type Spoil = fn(&mut Stage<2, 1>, f64);
    let fields: [(&str, Spoil); 17] = [
        ("a", |stage, bad| stage.a[(1, 0)] = bad),
        ("b", |stage, bad| stage.b[1] = bad),
        ("c", |stage, bad| stage.c[0] = bad),
        ("q", |stage, bad| stage.q[(0, 0)] = bad),
        ("r", |stage, bad| stage.r[0] = bad),
        ("s", |stage, bad| stage.s[1] = bad),
        ("q_linear", |stage, bad| stage.q_linear[1] = bad),
        ("r_linear", |stage, bad| stage.r_linear[0] = bad),
        ("rows.g_x", |stage, bad| stage.rows[0].g_x[1] = bad),
        ("rows.h_u", |stage, bad| stage.rows[0].h_u[0] = bad),
        // Bounds: infinite on the wrong side.
        ("u_min", |stage, bad| stage.u_min[0] = bad.abs()),
        ("u_max", |stage, bad| stage.u_max[0] = -bad.abs()),
        ("du_min", |stage, bad| stage.du_min[0] = bad.abs()),
        ("du_max", |stage, bad| stage.du_max[0] = -bad.abs()),
        ("x_min", |stage, bad| stage.x_min[1] = bad.abs()),
        ("x_max", |stage, bad| stage.x_max[1] = -bad.abs()),
        ("rows.upper", |stage, bad| stage.rows[0].upper = -bad.abs()),
    ];
    for (name, spoil) in fields {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let error = refused(|stage| spoil(stage, bad));
            let ProblemError::NotFinite { place, field, .. } = error else {
                panic!("{name}: {error:?}")
            };
            assert_eq!((place, field), (Place::Stage(1), name));
        }
    }
}

#[test]
fn nan_is_refused_in_the_initial_condition_and_at_the_end() {
    let mut problem = problem();
    assert!(
        problem
            .set_initial_state(&Vector2::new(0.0, f64::NAN))
            .is_err()
    );
    assert!(
        problem
            .set_previous_input(&Vector1::new(f64::INFINITY))
            .is_err()
    );
    assert!(OcpQp::new(Vector2::new(f64::NAN, 0.0), vec![stage()], terminal()).is_err());
    let errors = [
        refused_terminal(|terminal| terminal.p[(0, 1)] = f64::NAN),
        refused_terminal(|terminal| terminal.p_linear[1] = f64::INFINITY),
        refused_terminal(|terminal| terminal.x_min[1] = f64::INFINITY),
        refused_terminal(|terminal| {
            let (shape, center) = (Matrix2::identity(), Vector2::new(f64::NAN, 0.0));
            terminal.set = TerminalSet::Ellipsoid {
                shape,
                center,
                level: 1.0,
            };
        }),
    ];
    for error in errors {
        assert!(
            matches!(
                error,
                ProblemError::NotFinite {
                    place: Place::Terminal,
                    ..
                }
            ),
            "{error:?}"
        );
    }
}

#[test]
fn asymmetric_weights_are_refused() {
    let error = refused(|stage| stage.q[(0, 1)] = 1e-3);
    assert_eq!(
        error,
        ProblemError::NotSymmetric {
            place: Place::Stage(1),
            field: "q",
            row: 0,
            column: 1,
            expected: 0.0,
            found: 1e-3
        }
    );
}

// Rounding of the largest entry, 1e-9 of it, is much beside the smallest: `x'Qx` and the gradient must not disagree about it.
#[test]
fn symmetric_part_of_a_weight_is_what_counts() {
    let mut stage = Stage::new(Matrix3::identity(), Vector3::zeros());
    stage.q = Matrix3::from_diagonal(&Vector3::new(1e6, 1e-6, 1e-6));
    let mut problem = OcpQp::new(
        Vector3::zeros(),
        vec![stage.clone()],
        Terminal::new(stage.q),
    )
    .unwrap();
    // Half of it in each place: (0, 1, -1) would cost less than zero.
    stage.q[(1, 2)] = 9e-4;
    let refused = [
        problem.set_stage(0, &stage),
        problem.set_terminal(&Terminal::new(stage.q)),
    ];
    for error in refused {
        let error = error.unwrap_err();
        let indefinite = matches!(error, ProblemError::NotPositiveSemidefinite { .. });
        assert!(indefinite, "{error:?}");
    }
    stage.q[(1, 2)] = 1.9e-6;
    problem.set_stage(0, &stage).unwrap();
    problem.set_terminal(&Terminal::new(stage.q)).unwrap();
    for kept in [problem.stages()[0].q, problem.terminal().p] {
        assert_eq!((kept[(1, 2)], kept[(2, 1)]), (0.95e-6, 0.95e-6));
    }
}

#[test]
fn indefinite_weights_are_refused_at_any_scale() {
    for scale in [1e-12, 1.0, 1e12] {
        let errors = [
            refused(|stage| stage.q = Matrix2::new(1.0, 2.0, 2.0, 1.0) * scale),
            refused(|stage| stage.q = Matrix2::new(0.0, 1.0, 1.0, 1.0) * scale),
            refused(|stage| stage.r[0] = -scale),
            // Each block is definite, the joint matrix is not: 1 - 4 < 0.
            refused(|stage| {
                (stage.q, stage.r[0], stage.s[0]) =
                    (Matrix2::identity() * scale, scale, 2.0 * scale);
            }),
            refused(|stage| stage.q = Matrix2::new(1.0, 5.0, 5.0, 0.0) * scale),
            refused(|stage| stage.q = Matrix2::new(0.0, 5.0, 5.0, 1.0) * scale),
            // Without a weight on the state, x'S u falls without limit.
            refused(|stage| (stage.q, stage.s[0]) = (Matrix2::zeros(), 5.0 * scale)),
            refused_terminal(|terminal| terminal.p = Matrix2::new(1.0, 5.0, 5.0, 0.0) * scale),
            // A free input must not be coupled.
            refused(|stage| (stage.r[0], stage.s[0]) = (0.0, scale)),
            refused_terminal(|terminal| terminal.p[(0, 0)] = -scale),
        ];
        for error in errors {
            assert!(
                matches!(error, ProblemError::NotPositiveSemidefinite { .. }),
                "{error:?}"
            );
        }
    }
}

#[test]
fn singular_and_badly_scaled_weights_are_accepted() {
    let mut stage = stage();
    stage.q = Matrix2::new(1e6, 1.0, 1.0, 1e-6);
    (stage.r[0], stage.s) = (0.0, Vector2::zeros());
    let mut problem = problem();
    problem.set_stage(0, &stage).unwrap();
    stage.q = Matrix2::new(1e6, 1.1, 1.1, 1e-6);
    assert!(
        problem.set_stage(0, &stage).is_err(),
        "determinant 1 - 1.21 < 0"
    );
}

// I - t t' weights what is across t: singular in a direction that is no axis.
#[test]
fn projectors_tilted_by_any_angle_are_accepted() {
    let mut problem = problem();
    for decade in 1..=9 {
        for axis in [0.0, std::f64::consts::FRAC_PI_2] {
            let angle = axis + 10.0_f64.powi(-decade);
            let along = Vector2::new(angle.cos(), angle.sin());
            let projector = Matrix2::identity() - along * along.transpose();
            for weight in [1e-6, 1.0, 1e6] {
                let mut stage = stage();
                stage.q = projector * weight;
                assert_eq!(problem.set_stage(0, &stage), Ok(()), "1e-{decade}");
                let mut terminal = terminal();
                terminal.p = projector * weight;
                assert_eq!(problem.set_terminal(&terminal), Ok(()), "1e-{decade}");
                // Short by far more than rounding.
                stage.q -= Matrix2::identity() * (1e-8 * weight);
                assert!(problem.set_stage(0, &stage).is_err(), "1e-{decade}");
            }
        }
    }
}

#[test]
fn crossed_bounds_are_refused() {
    let error = refused(|stage| (stage.du_min[0], stage.du_max[0]) = (1.0, 0.5));
    assert_eq!(
        error,
        ProblemError::BoundsCrossed {
            place: Place::Stage(1),
            field: "du",
            component: 0,
            lower: 1.0,
            upper: 0.5
        }
    );
}

#[test]
fn structure_cannot_change_in_a_refill() {
    assert_eq!(
        refused_rows(),
        ProblemError::RowCount {
            place: Place::Stage(1),
            expected: 1,
            found: 2
        }
    );
    assert_eq!(
        refused_terminal(|terminal| terminal.set = TerminalSet::None),
        ProblemError::TerminalSetKind {
            expected: "ellipsoid",
            found: "none"
        }
    );
    let mut problem = problem();
    assert_eq!(
        problem.set_stage(3, &stage()),
        Err(ProblemError::StageIndex {
            expected: 3,
            found: 3
        })
    );
    let softening = Softening {
        rows: Penalty::Exact { weight: 1.0 },
        ..Softening::default()
    };
    let refused = problem.set_softening(softening);
    assert!(matches!(
        refused,
        Err(ProblemError::PenaltyKind {
            group: ConstraintGroup::Rows,
            ..
        })
    ));
}

fn refused_rows() -> ProblemError {
    let mut longer = stage();
    longer.rows.push(longer.rows[0]);
    problem().set_stage(1, &longer).unwrap_err()
}

#[test]
fn ellipsoid_levels_weights_and_empty_horizons_are_checked() {
    for found in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused_terminal(|terminal| {
            let (shape, center) = (Matrix2::identity(), Vector2::zeros());
            terminal.set = TerminalSet::Ellipsoid {
                shape,
                center,
                level: found,
            };
        });
        assert!(matches!(error, ProblemError::EllipsoidLevel { .. }));
        let softening = Softening {
            terminal_set: Penalty::Quadratic { weight: found },
            ..Softening::default()
        };
        assert!(matches!(
            problem().with_softening(softening),
            Err(ProblemError::PenaltyWeight { .. })
        ));
    }
    let empty = OcpQp::<2, 1>::new(Vector2::zeros(), Vec::new(), terminal());
    assert_eq!(empty, Err(ProblemError::EmptyHorizon));
}

#[test]
fn coefficient_is_named_by_its_row_and_its_column() {
    let mut row = stage().rows[0];
    row.g_x[1] = f64::NAN;
    let of_state = refused_second_row(row);
    let mut row = stage().rows[0];
    row.h_u[0] = f64::NAN;
    let of_input = refused_second_row(row);
    let face = HalfSpace {
        normal: Vector2::new(1.0, f64::NAN),
        upper: 1.0,
    };
    let mut terminal = Terminal::new(Matrix2::identity());
    terminal.set = TerminalSet::Polytope {
        faces: vec![
            HalfSpace {
                normal: Vector2::zeros(),
                ..face
            },
            face,
        ],
    };
    let of_face = OcpQp::<2, 1>::new(Vector2::zeros(), vec![stage()], terminal).unwrap_err();
    for (error, name, at) in [
        (of_state, "rows.g_x", (1, 1)),
        (of_input, "rows.h_u", (1, 0)),
        (of_face, "faces.normal", (1, 1)),
    ] {
        let ProblemError::NotFinite {
            field, row, column, ..
        } = error
        else {
            panic!("{error:?}")
        };
        assert_eq!((field, (row, column)), (name, at));
    }
}

/// The error of a stage whose second row is `row`.
fn refused_second_row(row: Row<2, 1>) -> ProblemError {
    let mut bad = stage();
    bad.rows.push(row);
    OcpQp::new(Vector2::zeros(), vec![bad], terminal()).unwrap_err()
}

#[test]
fn faces_are_checked_one_by_one() {
    let face = HalfSpace {
        normal: Vector2::new(1.0, 0.0),
        upper: f64::NAN,
    };
    let mut terminal = Terminal::new(Matrix2::identity());
    terminal.set = TerminalSet::Polytope {
        faces: vec![HalfSpace { upper: 1.0, ..face }, face],
    };
    let error = OcpQp::<2, 1>::new(Vector2::zeros(), vec![stage()], terminal).unwrap_err();
    assert!(
        matches!(
            error,
            ProblemError::NotFinite {
                field: "faces.upper",
                row: 1,
                ..
            }
        ),
        "{error:?}"
    );
}
