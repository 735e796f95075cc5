//! Infeasibility certificates of both solvers, recomputed from the definition: `y'(b - A z)` evaluated at points z; and rays spoilt in one place.

use crate::{answers, structured};
use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::{
    ConstraintGroup, InfeasibilityCertificate, OcpQp, Penalty, Place, Row, Softening, Solution,
    SolveStatus, Stage, Terminal, TerminalSet, TerminalSetMultipliers, examine_certificate,
};
use nalgebra::{Matrix1, Matrix2, SVector, Vector1, Vector2};

/// Sum of numbers, and of their sizes for an estimate of rounding.
#[derive(Default, Clone, Copy)]
struct Sum {
    value: f64,
    size: f64,
}

impl Sum {
    fn add(&mut self, multiplier: f64, distance: f64) {
        // Absent bounds have no multiplier.
        if multiplier != 0.0 {
            self.value += multiplier * distance;
            self.size += (multiplier * distance).abs();
        }
    }

    fn add_all<const N: usize>(
        &mut self,
        multipliers: &SVector<f64, N>,
        distances: &SVector<f64, N>,
    ) {
        for (multiplier, distance) in multipliers.iter().zip(distances) {
            self.add(*multiplier, *distance);
        }
    }
}

/// `y'(b - A z)` for the ray y and the trajectory `z = (u, x)`: multipliers times distances to the constraints.
fn product<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    ray: &Solution<NX, NU>,
    x: &[SVector<f64, NX>],
    u: &[SVector<f64, NU>],
) -> Sum {
    let (n, y) = (problem.horizon(), &ray.multipliers);
    let mut sum = Sum::default();
    for (k, stage) in problem.stages().iter().enumerate() {
        let (of, before) = (
            &y.stages[k],
            if k == 0 {
                problem.previous_input()
            } else {
                &u[k - 1]
            },
        );
        let step = u[k] - before;
        sum.add_all(&of.u_min, &(u[k] - stage.u_min));
        sum.add_all(&of.u_max, &(stage.u_max - u[k]));
        sum.add_all(&of.du_min, &(step - stage.du_min));
        sum.add_all(&of.du_max, &(stage.du_max - step));
        if k > 0 {
            sum.add_all(&of.x_min, &(x[k] - stage.x_min));
            sum.add_all(&of.x_max, &(stage.x_max - x[k]));
        }
        for (row, multiplier) in stage.rows.iter().zip(&of.rows) {
            sum.add(
                *multiplier,
                row.upper - row.g_x.dot(&x[k]) - row.h_u.dot(&u[k]),
            );
        }
        let ahead = stage.a * x[k] + stage.b * u[k] + stage.c;
        sum.add_all(&y.costates[k], &(x[k + 1] - ahead));
    }
    let terminal = problem.terminal();
    sum.add_all(&y.terminal.x_min, &(x[n] - terminal.x_min));
    sum.add_all(&y.terminal.x_max, &(terminal.x_max - x[n]));
    match (&terminal.set, &y.terminal.set) {
        (TerminalSet::Equality { target }, TerminalSetMultipliers::Equality(multiplier)) => {
            sum.add_all(multiplier, &(target - x[n]));
        }
        (TerminalSet::Polytope { faces }, TerminalSetMultipliers::Polytope(multipliers)) => {
            for (face, multiplier) in faces.iter().zip(multipliers) {
                sum.add(*multiplier, face.upper - face.normal.dot(&x[n]));
            }
        }
        (TerminalSet::Ellipsoid { .. }, TerminalSetMultipliers::Ellipsoid { radius, offset }) => {
            let cone = problem.terminal_cone().unwrap();
            sum.add(*radius, cone.radius);
            sum.add_all(offset, &cone.offset(&x[n]));
        }
        _ => {}
    }
    sum
}

// A'y by differences along each unknown (the product is affine, so they are exact but for rounding), b'y at the origin.
#[test]
fn certificates_are_what_the_definition_says() {
    for seed in 0..12 {
        let problem = random::problem::<4, 2>(seed, &Recipe::infeasible(seed, 15)).unwrap();
        let n = problem.horizon();
        for (solver, solution) in answers(&problem) {
            let SolveStatus::PrimalInfeasible { certificate, .. } = solution.status else {
                panic!("{solver}, seed {seed}: {:?}", solution.status);
            };
            let mut x = vec![SVector::zeros(); n + 1];
            x[0] = *problem.initial_state();
            let mut u = vec![SVector::zeros(); n];
            let origin = product(&problem, &solution, &x, &u);
            let separation = -origin.value;
            assert!(separation > 0.0, "{solver}, seed {seed}: {separation}");
            let (mut steepest, mut size): (f64, f64) = (0.0, origin.size);
            let mut difference = |there: Sum| {
                steepest = steepest.max((there.value - origin.value).abs());
                size = size.max(there.size);
            };
            for k in 0..n {
                for i in 0..2 {
                    u[k][i] = 1.0;
                    difference(product(&problem, &solution, &x, &u));
                    u[k][i] = 0.0;
                }
                for i in 0..4 {
                    x[k + 1][i] = 1.0;
                    difference(product(&problem, &solution, &x, &u));
                    x[k + 1][i] = 0.0;
                }
            }
            // Sums of some two hundred products.
            let rounding = 1e-13 * size / separation;
            let residual = steepest / separation;
            assert!(
                (residual - certificate.residual).abs() <= rounding + 1e-9 * residual,
                "{solver}, seed {seed}: {residual:e} for {certificate:?}"
            );
            // What it proves: here is no feasible point, whose product would not be negative.
            for k in 0..n {
                u[k] = SVector::from_fn(|i, _| ((7 * k + 3 * i) as f64).sin());
                x[k + 1] = SVector::from_fn(|i, _| ((5 * k + i) as f64).cos());
            }
            let there = product(&problem, &solution, &x, &u);
            assert!(there.value < -0.5 * separation, "{solver}, seed {seed}");
        }
    }
}

#[test]
fn row_that_only_the_given_state_enters_is_blamed() {
    let mut stage = Stage::new(Matrix1::new(1.0), Matrix1::new(1.0));
    stage.r = Matrix1::new(1.0);
    (stage.u_min, stage.u_max) = (Vector1::new(-1.0), Vector1::new(1.0));
    let mut stages = vec![stage; 3];
    stages[0].rows = vec![Row {
        g_x: Vector1::new(1.0),
        h_u: Vector1::new(0.0),
        upper: 0.0,
    }];
    let terminal = Terminal::new(Matrix1::new(1.0));
    let problem = OcpQp::new(Vector1::new(1.0), stages, terminal).unwrap();
    for (solver, solution) in answers(&problem) {
        let SolveStatus::PrimalInfeasible { blame, .. } = solution.status else {
            panic!("{solver}: {:?}", solution.status);
        };
        let first = blame.entries().next().unwrap();
        assert_eq!(
            (first.group, first.worst),
            (ConstraintGroup::Rows, Place::Stage(0)),
            "{solver}"
        );
    }
}

// A ball on a plate (Ferreau's benchmark) that cannot be at rest in time, within bounds on position and speed that may give way.
#[test]
fn soft_constraints_have_no_part_in_a_proof() {
    let mut stage = Stage::new(
        Matrix2::new(1.0, 0.01, 0.0, 1.0),
        Vector2::new(-0.0004, -0.0701),
    );
    stage.q = Matrix2::new(12.0, 0.0, 0.0, 0.2);
    stage.r = Matrix1::new(2.0);
    (stage.u_min[0], stage.u_max[0]) = (-0.0524, 0.0524);
    (stage.x_min, stage.x_max) = (Vector2::new(-0.2, -0.1), Vector2::new(0.01, 0.1));
    let mut terminal = Terminal::new(stage.q);
    terminal.set = TerminalSet::Equality {
        target: Vector2::zeros(),
    };
    let weight = 1e3;
    for penalty in [Penalty::Exact { weight }, Penalty::Quadratic { weight }] {
        let softening = Softening {
            state_bounds: penalty,
            ..Softening::default()
        };
        for (horizon, far) in [(1, 0.3), (1, 3.0), (5, 0.3), (5, 3.0), (20, 3.0)] {
            let start = Vector2::new(-0.15, 0.05) * far;
            let problem = OcpQp::new(start, vec![stage.clone(); horizon], terminal.clone());
            let problem = problem.unwrap().with_softening(softening).unwrap();
            for (solver, solution) in answers(&problem) {
                let SolveStatus::PrimalInfeasible { certificate, blame } = solution.status else {
                    panic!(
                        "{solver}, N = {horizon}, {far} of the start: {:?}",
                        solution.status
                    );
                };
                assert!(certificate.residual <= 1e-7, "{solver}: {certificate:?}");
                assert!(!blame.names(ConstraintGroup::StateBounds), "{solver}");
            }
        }
    }
}

/// The certificate of a proof's ray, spoilt by a thousandth of what the terminal ellipsoid has in it.
fn ray_spoilt(spoil: fn(&mut Solution<4, 2>, f64)) -> InfeasibilityCertificate {
    let problem = random::problem::<4, 2>(3, &Recipe::infeasible(3, 15)).unwrap();
    let mut ray = structured(&problem);
    let size = ray
        .multipliers
        .exact_penalty_bound(ConstraintGroup::TerminalSet);
    assert!(matches!(ray.status, SolveStatus::PrimalInfeasible { .. }) && size > 0.0);
    spoil(&mut ray, 1e-3 * size);
    examine_certificate(&problem, &ray).0
}

#[test]
fn ray_with_a_wrong_sign_says_so() {
    assert!(ray_spoilt(|_, _| {}).sign_violation <= 1e-9);
    let spoils: [fn(&mut Solution<4, 2>, f64); 3] = [
        // One of two opposite multipliers is zero.
        |ray, little| {
            let of_inputs = &mut ray.multipliers.stages[0];
            let zero = match of_inputs.u_max[0] <= of_inputs.u_min[0] {
                true => &mut of_inputs.u_max,
                false => &mut of_inputs.u_min,
            };
            zero[0] = -little;
        },
        // The second state has no bounds.
        |ray, little| ray.multipliers.terminal.x_max[1] = little,
        |ray, little| {
            if let TerminalSetMultipliers::Ellipsoid { radius, offset } =
                &mut ray.multipliers.terminal.set
            {
                *radius = offset.norm() - little;
            }
        },
    ];
    for spoil in spoils {
        let certificate = ray_spoilt(spoil);
        assert!(certificate.residual.is_finite(), "{certificate:?}");
        assert!(certificate.sign_violation > 1e-6, "{certificate:?}");
    }
}

#[test]
fn ray_on_soft_constraints_says_so() {
    // Ellipsoid, point.
    for seed in [3, 7] {
        let problem = random::problem::<4, 2>(seed, &Recipe::infeasible(seed, 15)).unwrap();
        let ray = structured(&problem);
        assert!(examine_certificate(&problem, &ray).0.sign_violation <= 1e-9);
        let softening = Softening {
            terminal_set: Penalty::Exact { weight: 1.0 },
            ..Softening::default()
        };
        let softened = problem.with_softening(softening).unwrap();
        let certificate = examine_certificate(&softened, &ray).0;
        assert!(certificate.sign_violation > 1e-6, "{certificate:?}");
    }
}
