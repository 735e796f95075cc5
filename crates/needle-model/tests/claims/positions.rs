//! The problem "which states and inputs reach these positions" is posed so that it can be solved: a
//! dense Gauss-Newton, here only, solves it on short paths.

use nalgebra::{DMatrix, DVector, Dyn, Matrix6, OMatrix, U6, Vector3, Vector6};
use needle_model::{
    Input, Needle, Pose, PositionCurve, PositionPathProblem, PositionPathSettings, ReferencePath,
};

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

fn needle() -> Needle {
    Needle::new(KAPPA_PER_MM).unwrap()
}

fn problem(positions_mm: &[Vector3<f64>]) -> PositionPathProblem {
    let curve = PositionCurve::through(positions_mm, 0.0).unwrap();
    PositionPathProblem::new(needle(), curve, PositionPathSettings::default()).unwrap()
}

/// Least-squares step in (first pose, inputs), all later poses eliminated through the steps.
fn gauss_newton_step(
    problem: &PositionPathProblem,
    poses: &[Pose],
    inputs: &[Input],
) -> (Vec<Vector6<f64>>, DVector<f64>) {
    let n = inputs.len();
    let columns = 6 + 2 * n;
    let mut jacobian = DMatrix::zeros(5 * n + 3, columns);
    let mut residual = DVector::zeros(5 * n + 3);
    let mut offset = Vector6::zeros();
    let mut by_z = OMatrix::<f64, U6, Dyn>::zeros(columns);
    by_z.fixed_view_mut::<6, 6>(0, 0)
        .copy_from(&Matrix6::identity());
    let (mut offsets, mut sensitivities) = (vec![offset], vec![by_z.clone()]);
    for k in 0..n {
        let stage = problem
            .stage(k, &poses[k], inputs[k], &poses[k + 1])
            .unwrap()
            .unwrap();
        residual
            .rows_mut(5 * k, 5)
            .copy_from(&(stage.residual + stage.by_pose * offset));
        jacobian
            .rows_mut(5 * k, 5)
            .copy_from(&(stage.by_pose * &by_z));
        let mut inputs_block = jacobian.fixed_view_mut::<5, 2>(5 * k, 6 + 2 * k);
        inputs_block += stage.by_input;
        let step = stage.step.solved_for_target();
        offset = step.a * offset + step.c;
        by_z = step.a * &by_z;
        let mut block = by_z.fixed_view_mut::<6, 2>(0, 6 + 2 * k);
        block += step.b;
        offsets.push(offset);
        sensitivities.push(by_z.clone());
    }
    let last = problem.terminal(&poses[n]);
    residual
        .rows_mut(5 * n, 3)
        .copy_from(&(last.value + last.by_pose * offset));
    jacobian
        .rows_mut(5 * n, 3)
        .copy_from(&(last.by_pose * &by_z));
    let z = jacobian.svd(true, true).solve(&-residual, 1e-14).unwrap();
    let deltas = offsets.iter().zip(&sensitivities).map(|(o, s)| o + s * &z);
    (deltas.collect(), z)
}

/// Largest distance of the executed inputs from the targets, mm, and the executed path.
fn solved(problem: &PositionPathProblem, iterations: usize) -> (f64, ReferencePath) {
    let guess = problem.initial_guess();
    let (mut poses, mut inputs) = (guess.poses().to_vec(), guess.inputs().to_vec());
    for _ in 0..iterations {
        let (deltas, z) = gauss_newton_step(problem, &poses, &inputs);
        for (pose, delta) in poses.iter_mut().zip(&deltas) {
            *pose = pose.perturbed(delta);
        }
        for (k, input) in inputs.iter_mut().enumerate() {
            *input = problem.settings().within_limits(Input {
                v_mm_s: input.v_mm_s + z[6 + 2 * k],
                omega_rad_s: input.omega_rad_s + z[7 + 2 * k],
            });
        }
    }
    let path = ReferencePath::from_inputs(needle(), poses[0], inputs, guess.dt_s()).unwrap();
    let deviation = path
        .poses()
        .iter()
        .zip(problem.targets_mm())
        .map(|(p, y)| (p.position_mm - y).norm())
        .fold(0.0, f64::max);
    (deviation, path)
}

fn helix_like(steps: u32) -> ReferencePath {
    let inputs = (0..steps)
        .map(|k| Input {
            v_mm_s: 5.0,
            omega_rad_s: 0.1 + 0.3 * (f64::from(k) * 0.08).sin(),
        })
        .collect();
    ReferencePath::from_inputs(
        needle(),
        Pose::exp(&Vector6::new(3.0, 1.0, -2.0, 0.4, 0.2, 0.9)),
        inputs,
        0.1,
    )
    .unwrap()
}

fn positions(path: &ReferencePath) -> Vec<Vector3<f64>> {
    path.poses().iter().map(|p| p.position_mm).collect()
}

#[test]
fn positions_of_a_feasible_path_give_back_the_path() {
    let truth = helix_like(50);
    let problem = problem(&positions(&truth));
    let (deviation_mm, path) = solved(&problem, 6);
    assert!(deviation_mm < 1e-3, "{deviation_mm:e}");
    for (found, wanted) in path.poses().iter().zip(truth.poses()) {
        assert!((found.position_mm - wanted.position_mm).norm() < 1e-3);
        // The state comes back, too: 1 mrad of heading and 0.05 rad of roll, which 25 mm of arc
        // show only through curvature (0.5 kappa s^2 = 2 mm of sag).
        assert!(found.tangent().cross(&wanted.tangent()).norm() < 1e-3);
        assert!(
            found.rotation.angle_to(&wanted.rotation) < 0.05,
            "{}",
            found.rotation.angle_to(&wanted.rotation)
        );
    }
}

#[test]
fn a_gentler_curve_is_followed_by_an_uneven_spin() {
    // Half the needle's curvature, torsion 0.01 rad/mm; one turn a second at most.
    let gentle = Needle::new(0.5 * KAPPA_PER_MM).unwrap();
    let inputs = vec![
        Input {
            v_mm_s: 5.0,
            omega_rad_s: 0.05
        };
        60
    ];
    let truth = ReferencePath::from_inputs(gentle, Pose::identity(), inputs, 0.1).unwrap();
    let problem = problem(&positions(&truth));
    // The closed-form spin alone, executed open loop from its own first pose.
    let guess = problem.initial_guess();
    let rolled =
        ReferencePath::from_inputs(needle(), guess.poses()[0], guess.inputs().to_vec(), 0.1)
            .unwrap();
    let open_loop = (rolled.poses()[60].position_mm - problem.targets_mm()[60]).norm();
    println!("open loop {open_loop}");
    let (deviation_mm, path) = solved(&problem, 8);
    println!("solved {deviation_mm}");
    assert!(open_loop < 1.0, "{open_loop}");
    assert!(deviation_mm < 0.02, "{deviation_mm}");
    assert!(
        path.inputs()
            .iter()
            .all(|u| u.omega_rad_s.abs() <= std::f64::consts::TAU)
    );
}
