//! Problems of the MPC literature, as a user would pose them, through both solvers.
//!
//! Plants with one input are written with a second one that moves nothing, so that few sizes are compiled. Models in continuous time
//! are sampled with held inputs.

use crate::{refused_for, regulated, same_cost};
use mpc_qp::{ConstraintGroup, OcpQp, Penalty, Softening, Stage, Terminal};
use nalgebra::{Matrix2, Matrix4, Matrix4x2, SMatrix, SVector, Vector1, Vector2, Vector4};

/// `exp(A h)` and `integral of exp(A s) ds B` by their power series.
pub(crate) fn sampled<const NX: usize, const NU: usize>(
    a: SMatrix<f64, NX, NX>,
    b: SMatrix<f64, NX, NU>,
    step_s: f64,
) -> Stage<NX, NU> {
    let (mut power, mut integral) = (SMatrix::identity(), SMatrix::identity() * step_s);
    let mut term = SMatrix::<f64, NX, NX>::identity();
    for order in 1..60 {
        term = term * a * (step_s / f64::from(order));
        power += term;
        integral += term * (step_s / f64::from(order + 1));
    }
    Stage::new(power, integral * b)
}

fn soft_states(penalty: Penalty) -> Softening {
    Softening {
        state_bounds: penalty,
        ..Softening::default()
    }
}

// Bemporad, Morari, Dua & Pistikopoulos (2002), the example of the explicit regulator.
#[test]
fn second_order_lag_of_the_explicit_regulator() {
    let a = Matrix2::new(0.7326, -0.0861, 0.1722, 0.9909);
    let stage = Stage::new(a, Vector2::new(0.0609, 0.0064));
    let (stage, terminal) = regulated(
        stage,
        Vector2::repeat(1.0),
        Vector1::new(0.01),
        Vector1::new(2.0),
    );
    for horizon in [1, 2, 20, 100] {
        let start = Vector2::new(1.0, 1.0);
        let problem = OcpQp::new(start, vec![stage.clone(); horizon], terminal.clone()).unwrap();
        same_cost("lag", &problem);
    }
}

// Wang & Boyd (2010): masses between walls, springs of unit stiffness; here with four actuators.
#[test]
fn six_oscillating_masses_within_their_bounds() {
    let mut a = SMatrix::<f64, 12, 12>::zeros();
    let mut b = SMatrix::<f64, 12, 4>::zeros();
    for i in 0..6 {
        (a[(i, 6 + i)], a[(6 + i, i)]) = (1.0, -2.0);
        if i > 0 {
            (a[(6 + i, i - 1)], a[(5 + i, i)]) = (1.0, 1.0);
        }
    }
    for (j, (from, to)) in [(0, 1), (2, 3), (4, 5), (1, 4)].into_iter().enumerate() {
        (b[(6 + from, j)], b[(6 + to, j)]) = (1.0, -1.0);
    }
    let stage = sampled(a, b, 0.5);
    let (mut stage, mut terminal) = regulated(
        stage,
        SVector::repeat(1.0),
        SVector::repeat(1.0),
        SVector::repeat(0.5),
    );
    (stage.x_min, stage.x_max) = (SVector::repeat(-4.0), SVector::repeat(4.0));
    (terminal.x_min, terminal.x_max) = (stage.x_min, stage.x_max);
    let start = SVector::<f64, 12>::from_fn(|i, _| {
        if i < 6 {
            3.5 * (1.0 + i as f64).sin()
        } else {
            0.5
        }
    });
    for horizon in [10, 30, 60] {
        let problem = OcpQp::new(start, vec![stage.clone(); horizon], terminal.clone()).unwrap();
        same_cost("masses", &problem);
    }
}

// The quadrotor of the OSQP and CVXGEN examples, linearised at hover, climbing by a metre.
#[test]
fn quadrotor_climbs_from_hover() {
    let mut a = SMatrix::<f64, 12, 12>::identity();
    for (i, j, value) in [
        (0, 6, 0.1),
        (1, 7, 0.1),
        (2, 8, 0.1),
        (3, 0, 0.0488),
        (3, 6, 0.0016),
        (3, 9, 0.0992),
        (4, 1, -0.0488),
        (4, 7, -0.0016),
        (4, 10, 0.0992),
        (5, 11, 0.0992),
        (9, 0, 0.9734),
        (9, 6, 0.0488),
        (9, 9, 0.9846),
        (10, 1, -0.9734),
        (10, 7, -0.0488),
        (10, 10, 0.9846),
        (11, 11, 0.9846),
    ] {
        a[(i, j)] = value;
    }
    let mut b = SMatrix::<f64, 12, 4>::zeros();
    for (i, row) in [
        [0.0, -0.0726, 0.0, 0.0726],
        [-0.0726, 0.0, 0.0726, 0.0],
        [-0.0152, 0.0152, -0.0152, 0.0152],
        [0.0, -0.0006, 0.0, 0.0006],
        [0.0006, 0.0, -0.0006, 0.0],
        [0.0106; 4],
        [0.0, -1.4512, 0.0, 1.4512],
        [-1.4512, 0.0, 1.4512, 0.0],
        [-0.3049, 0.3049, -0.3049, 0.3049],
        [0.0, -0.0236, 0.0, 0.0236],
        [0.0236, 0.0, -0.0236, 0.0],
        [0.2107; 4],
    ]
    .into_iter()
    .enumerate()
    {
        (0..4).for_each(|j| b[(i, j)] = row[j]);
    }
    let mut stage = Stage::new(a, b);
    let weights = SVector::<f64, 12>::from_column_slice(&[
        0.0, 0.0, 10.0, 10.0, 10.0, 10.0, 0.0, 0.0, 0.0, 5.0, 5.0, 5.0,
    ]);
    stage.q = SMatrix::from_diagonal(&weights);
    stage.r = SMatrix::identity() * 0.1;
    stage.q_linear[2] = -10.0;
    stage.q_linear[5] = -10.0;
    (stage.u_min, stage.u_max) = (
        SVector::repeat(9.6 - 10.5916),
        SVector::repeat(13.0 - 10.5916),
    );
    let tilt = std::f64::consts::FRAC_PI_6;
    for (i, low, high) in [(0, -tilt, tilt), (1, -tilt, tilt), (5, -1.0, f64::INFINITY)] {
        (stage.x_min[i], stage.x_max[i]) = (low, high);
    }
    let mut terminal = Terminal::new(stage.q);
    (terminal.p_linear, terminal.x_min, terminal.x_max) =
        (stage.q_linear, stage.x_min, stage.x_max);
    for horizon in [10, 40] {
        let start = SVector::zeros();
        let problem = OcpQp::new(start, vec![stage.clone(); horizon], terminal.clone()).unwrap();
        same_cost("quadrotor", &problem);
    }
}

// Kapasouris, Athans & Stein (1990): open-loop unstable, the angle of attack within half a degree, a pitch of ten degrees asked for.
#[test]
fn unstable_aircraft_keeps_its_soft_angle_of_attack() {
    let a = Matrix4::new(
        -0.0151, -60.5651, 0.0, -32.174, -0.0001, -1.3411, 0.9929, 0.0, 0.00018, 43.2541, -0.86939,
        0.0, 0.0, 0.0, 1.0, 0.0,
    );
    let b = Matrix4x2::new(
        -2.516, -13.136, -0.1689, -0.2514, -17.251, -1.5766, 0.0, 0.0,
    );
    let mut stage = sampled(a, b, 0.05);
    stage.q = Matrix4::from_diagonal(&Vector4::new(0.0, 10.0, 0.0, 10.0));
    stage.r = Matrix2::identity() * 0.1;
    stage.q_linear[3] = -100.0;
    (stage.u_min, stage.u_max) = (Vector2::repeat(-25.0), Vector2::repeat(25.0));
    (stage.x_min[1], stage.x_max[1]) = (-0.5, 0.5);
    let mut terminal = Terminal::new(stage.q);
    (terminal.p_linear, terminal.x_min, terminal.x_max) =
        (stage.q_linear, stage.x_min, stage.x_max);
    // From inside, and from a measured angle of attack that no input can bring back at once.
    for (start, horizon) in [(0.0, 10), (0.0, 100), (5.0, 10), (5.0, 60)] {
        let start = Vector4::new(0.0, start, 0.0, 0.0);
        let hard = OcpQp::new(start, vec![stage.clone(); horizon], terminal.clone()).unwrap();
        for penalty in [
            Penalty::Exact { weight: 1e4 },
            Penalty::Quadratic { weight: 1e4 },
        ] {
            let softened = hard.clone().with_softening(soft_states(penalty)).unwrap();
            same_cost("aircraft", &softened);
        }
        if start[1] > 0.5 {
            refused_for("aircraft", &hard, &[ConstraintGroup::StateBounds]);
        }
    }
}

// Johansson (2000), the tanks in their minimum-phase setting, levels in cm and flows in V.
#[test]
fn quadruple_tank_fills_to_a_corner() {
    let (t, gamma) = ([62.0, 90.0, 23.0, 30.0], [0.7, 0.6]);
    let mut a = Matrix4::from_diagonal(&Vector4::from_fn(|i, _| -1.0 / t[i]));
    (a[(0, 2)], a[(1, 3)]) = (28.0 / (28.0 * t[2]), 32.0 / (32.0 * t[3]));
    let mut b = Matrix4x2::zeros();
    (b[(0, 0)], b[(1, 1)]) = (gamma[0] * 3.33 / 28.0, gamma[1] * 3.35 / 32.0);
    (b[(2, 1)], b[(3, 0)]) = (
        (1.0 - gamma[1]) * 3.35 / 28.0,
        (1.0 - gamma[0]) * 3.33 / 32.0,
    );
    let weights = Vector4::new(1.0, 1.0, 0.0, 0.0);
    let (mut stage, mut terminal) = regulated(
        sampled(a, b, 2.0),
        weights,
        Vector2::repeat(1e-3),
        Vector2::repeat(3.0),
    );
    (stage.x_min, stage.x_max) = (Vector4::repeat(-3.0), Vector4::repeat(1.0));
    (stage.du_min, stage.du_max) = (Vector2::repeat(-0.5), Vector2::repeat(0.5));
    (terminal.x_min, terminal.x_max) = (stage.x_min, stage.x_max);
    for horizon in [1, 30, 60] {
        let start = Vector4::new(-2.0, 0.9, 0.9, -1.0);
        let problem = OcpQp::new(start, vec![stage.clone(); horizon], terminal.clone()).unwrap();
        same_cost("tanks", &problem);
    }
}

// Upright poles, a crane's load, a ball on a beam, a motor's shaft: one input each.
#[test]
fn classics_with_one_input_move_to_their_targets() {
    let pole = |sign: f64| {
        Matrix4::new(
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            -0.1,
            1.0,
            0.0,
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            -0.2,
            sign * 20.0,
            0.0,
        )
    };
    let push = Vector4::new(0.0, 1.0, 0.0, 2.0);
    let beam = Matrix4::new(
        0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -7.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0,
    );
    let (inertia, load, stiffness) = (0.5, 10.0, 1280.2);
    let shaft = Matrix4::new(
        0.0,
        1.0,
        0.0,
        0.0,
        -stiffness / load,
        -2.5,
        stiffness / 20.0 / load,
        0.0,
        0.0,
        0.0,
        0.0,
        1.0,
        stiffness / 20.0 / inertia,
        0.0,
        -stiffness / 400.0 / inertia,
        -10.2,
    );
    let plants = [
        (
            "pole",
            pole(1.0),
            push,
            0.05,
            10.0,
            Vector4::new(0.5, 0.0, 0.1, 0.0),
        ),
        (
            "crane",
            pole(-1.0),
            push,
            0.1,
            2.0,
            Vector4::new(4.0, 0.0, 0.0, 0.0),
        ),
        (
            "beam",
            beam,
            Vector4::new(0.0, 0.0, 0.0, 1.0),
            0.05,
            5.0,
            Vector4::new(0.4, 0.0, 0.0, 0.0),
        ),
        (
            "shaft",
            shaft,
            Vector4::new(0.0, 0.0, 0.0, 2.0),
            0.1,
            220.0,
            Vector4::new(1.57, 0.0, 30.0, 0.0),
        ),
    ];
    for (name, a, b, step_s, u_max, start) in plants {
        let b = Matrix4x2::from_columns(&[b, Vector4::zeros()]);
        let (mut stage, mut terminal) = regulated(
            sampled(a, b, step_s),
            Vector4::new(10.0, 0.1, 1.0, 0.1),
            Vector2::new(0.01, 1.0),
            Vector2::new(u_max, 1.0),
        );
        (stage.x_min[1], stage.x_max[1]) = (-0.6, 0.6);
        (terminal.x_min[1], terminal.x_max[1]) = (-0.6, 0.6);
        for horizon in [1, 15, 60] {
            let stages = vec![stage.clone(); horizon];
            let problem = OcpQp::new(start, stages, terminal.clone()).unwrap();
            let softening = soft_states(Penalty::Exact { weight: 1e4 });
            same_cost(name, &problem.with_softening(softening).unwrap());
        }
    }
}
