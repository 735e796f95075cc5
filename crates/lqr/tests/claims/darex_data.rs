//! Examples of the DAREX collection that are data: the textbook residual of each, and a stable closed loop. Source: see `darex`.

use crate::systems::{System, norm, textbook_residual};
use faer::prelude::Solve;
use faer::{Mat, mat};

fn diagonal<const N: usize>(d: [f64; N]) -> Mat<f64> {
    Mat::from_fn(N, N, |i, j| if i == j { d[i] } else { 0.0 })
}

/// C'WC for the outputs y = Cx with the diagonal weight W, symmetric to the last bit.
fn output_weight(c: &Mat<f64>, w: &Mat<f64>) -> Mat<f64> {
    let q = c.transpose() * w * c;
    Mat::from_fn(q.nrows(), q.nrows(), |i, j| 0.5 * (q[(i, j)] + q[(j, i)]))
}

fn assert_solved(name: &str, system: &System, tolerance: f64) {
    let solution = system.dare().solve().unwrap();
    let residual = textbook_residual(system, &solution.p);
    assert!(residual < tolerance, "{name}: {residual:e}");
    assert!(solution.spectral_radius < 1.0, "{name}");
}

#[test]
fn example_1_5_satellite() {
    let system = System {
        a: mat![
            [0.998, 0.067, 0.0, 0.0],
            [-0.067, 0.998, 0.0, 0.0],
            [0.0, 0.0, 0.998, 0.153],
            [0.0, 0.0, -0.153, 0.998]
        ],
        b: mat![
            [0.0033, 0.02],
            [0.1, -0.0007],
            [0.04, 0.0073],
            [-0.0028, 0.1]
        ],
        q: mat![
            [1.87, 0.0, 0.0, -0.244],
            [0.0, 0.744, 0.205, 0.0],
            [0.0, 0.205, 0.589, 0.0],
            [-0.244, 0.0, 0.0, 1.048]
        ],
        r: Mat::identity(2, 2),
    };
    assert_solved("satellite", &system, 1e-13);
    assert!(system.dare().solve().unwrap().warning.is_none());
}

#[test]
fn example_1_6_slow_and_fast_modes() {
    let system = System {
        a: mat![
            [0.98475, -0.079903, 0.0009054, -0.0010765],
            [0.041588, 0.99899, -0.035855, 0.012684],
            [-0.54662, 0.044916, -0.32991, 0.19318],
            [2.6624, -0.10045, -0.92455, -0.26325]
        ],
        b: mat![
            [0.0037112, 0.0007361],
            [-0.087051, 9.3411e-6],
            [-1.19844, -4.1378e-4],
            [-3.1927, 9.2535e-4]
        ],
        q: diagonal([0.01; 4]),
        r: Mat::identity(2, 2),
    };
    assert_solved("slow and fast", &system, 1e-13);
}

#[test]
fn example_1_7_mode_near_minus_one() {
    let c = mat![
        [1.0, 1.0, 2.0, 4.0],
        [0.0, 1.0, 1.0, 2.0],
        [0.0, 0.0, 1.0, 1.0],
        [0.0, 0.0, 0.0, 1.0]
    ];
    let w = mat![
        [2.0, -1.0, 0.0, 0.0],
        [-1.0, 2.0, -1.0, 0.0],
        [0.0, -1.0, 2.0, 0.0],
        [0.0, 0.0, 0.0, 0.0]
    ];
    let system = System {
        a: mat![
            [-0.6, -2.2, -3.6, -5.400018],
            [1.0, 0.6, 0.8, 3.399982],
            [0.0, 1.0, 1.8, 3.799982],
            [0.0, 0.0, 0.0, -0.999982]
        ],
        b: mat![
            [1.0, -1.0, -1.0, -1.0],
            [0.0, 1.0, -1.0, -1.0],
            [0.0, 0.0, 1.0, -1.0],
            [0.0, 0.0, 0.0, 1.0]
        ],
        q: output_weight(&c, &w),
        r: Mat::identity(4, 4),
    };
    // The mode at -0.999982 costs next to nothing, so nothing moves it: the closed loop is as slow.
    assert_solved("mode near -1", &system, 1e-13);
    let solution = system.dare().solve().unwrap();
    assert!((solution.spectral_radius - 0.999982).abs() < 1e-9);
    assert!(solution.warning.is_some());
}

#[test]
fn example_1_8_chemical_plant() {
    let system = System {
        a: mat![
            [0.95407, 0.019643, 0.003597, 0.000673, 0.00019],
            [0.40849, 0.41317, 0.16084, 0.044679, 0.011971],
            [0.12217, 0.26326, 0.36149, 0.1593, 0.12383],
            [0.041118, 0.12858, 0.27209, 0.21442, 0.40976],
            [0.001305, 0.005808, 0.01875, 0.036162, 0.9428]
        ],
        b: mat![
            [0.000434, -0.000122],
            [0.026606, -0.010453],
            [0.03753, -0.0551],
            [0.036076, -0.066],
            [0.004617, -0.009148]
        ],
        q: Mat::identity(5, 5),
        r: Mat::identity(2, 2),
    };
    assert_solved("chemical plant", &system, 1e-13);
}

#[test]
fn example_1_9_cross_term() {
    let chain = |i: usize, j: usize| [(0, 1), (1, 2), (3, 4), (4, 5)].contains(&(i, j));
    let a = Mat::from_fn(6, 6, |i, j| f64::from(chain(i, j)));
    let b = Mat::from_fn(6, 2, |i, j| f64::from((i, j) == (2, 0) || (i, j) == (5, 1)));
    let c = mat![
        [1.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, -1.0, 0.0]
    ];
    let q = output_weight(&c, &Mat::identity(2, 2));
    let (r, s) = (
        diagonal([3.0, 1.0]),
        mat![
            [1.0, 0.0],
            [1.0, 0.0],
            [0.0, 0.0],
            [1.0, 0.0],
            [-1.0, 0.0],
            [0.0, 0.0]
        ],
    );
    let solution = lqr::Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref())
        .with_cross(s.as_ref())
        .solve()
        .unwrap();
    let p = &solution.p;
    let gradient = b.transpose() * p * &a + s.transpose();
    let hessian = &r + b.transpose() * p * &b;
    let right = &q + a.transpose() * p * &a
        - gradient.transpose() * hessian.partial_piv_lu().solve(&gradient);
    assert!(norm(&(&right - p)) < 1e-14 * norm(p) && solution.spectral_radius < 1.0);
}

#[test]
fn example_1_10_ammonia_reactor() {
    let system = System {
        a: mat![
            [
                0.8701, 0.135, 0.01159, 0.0005014, -0.03722, 0.0003484, 0.0, 0.004242, 0.007249
            ],
            [
                0.07655, 0.8974, 0.01272, 0.0005504, -0.04016, 0.0003743, 0.0, 0.00453, 0.007499
            ],
            [
                -0.1272, 0.3575, 0.817, 0.001455, -0.1028, 0.000987, 0.0, 0.01185, 0.01872
            ],
            [
                -0.3635, 0.6339, 0.07491, 0.7966, -0.2735, 0.002653, 0.0, 0.03172, 0.04882
            ],
            [
                -0.96, 1.6459, -0.1289, -0.005597, 0.07142, 0.007108, 0.0, 0.08452, 0.1259
            ],
            [
                -0.6644, 0.11296, -0.08889, -0.003854, 0.08447, 0.0136, 0.0, 0.1443, 0.1016
            ],
            [
                -0.4102, 0.693, -0.05471, -0.002371, 0.06649, 0.01249, 0.0001063, 0.09997, 0.06967
            ],
            [
                -0.1799, 0.3017, -0.02393, -0.001035, 0.06059, 0.02216, 0.0, 0.2139, 0.03554
            ],
            [
                -0.3451, 0.5804, -0.04596, -0.001989, 0.1056, 0.01986, 0.0, 0.2191, 0.2152
            ]
        ],
        b: mat![
            [0.000476, -5.701e-5, -0.008368],
            [8.79e-5, -0.0004773, -0.000273],
            [0.0001482, -0.001312, 0.0008876],
            [0.0003892, -0.003513, 0.00248],
            [0.001034, -0.009275, 0.00668],
            [0.0007203, -0.006159, 0.003834],
            [0.0004454, -0.003683, 0.002029],
            [0.0001971, -0.001554, 0.0006937],
            [0.0003773, -0.003028, 0.001469]
        ],
        q: diagonal([50.0, 0.0, 0.0, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0]),
        r: Mat::identity(3, 3),
    };
    assert_solved("ammonia reactor", &system, 1e-13);
}

#[test]
fn example_1_11_paper_machine_with_integrators() {
    let mut a = Mat::<f64>::zeros(11, 11);
    for (i, j, x) in [
        (1, 0, 1.0),
        (2, 1, 1.0),
        (3, 2, 1.0),
        (4, 3, 1.0),
        (5, 5, 0.222),
        (5, 6, 0.778),
        (6, 4, 0.4),
        (6, 6, 0.6),
        (7, 7, 1.372),
        (7, 8, -0.47),
        (8, 7, 1.0),
        (9, 5, -15.0),
        (9, 9, 1.0),
        (10, 6, -7.0),
        (10, 7, 5.357),
        (10, 8, 3.943),
        (10, 10, 1.0),
    ] {
        a[(i, j)] = x;
    }
    let mut b = Mat::<f64>::zeros(11, 2);
    (b[(0, 0)], b[(7, 1)]) = (1.0, 0.098);
    let mut c = Mat::<f64>::zeros(4, 11);
    for (i, j, x) in [
        (0, 5, 15.0),
        (1, 6, 7.0),
        (1, 7, -5.357),
        (1, 8, -3.943),
        (2, 9, 1.0),
        (3, 10, 1.0),
    ] {
        c[(i, j)] = x;
    }
    let system = System {
        a,
        b,
        q: output_weight(&c, &diagonal([0.5, 5.0, 0.5, 5.0])),
        r: diagonal([400.0, 700.0]),
    };
    assert_solved("paper machine with integrators", &system, 1e-13);
}

#[test]
fn example_1_12_paper_machine_with_disturbances() {
    let mut a = Mat::from_fn(13, 13, |i, j| f64::from(j == i + 1 && i < 10));
    for (i, j, x) in [
        (5, 6, 0.0),
        (7, 8, 0.0),
        (11, 11, 1.0),
        (12, 12, 1.0),
        (11, 0, -3.318),
        (12, 0, -1.5484),
        (5, 5, 0.7788),
        (7, 6, -0.4724),
        (12, 6, 0.3981),
        (7, 7, 1.3746),
        (12, 7, 0.5113),
        (12, 8, 5.7865),
        (10, 10, 0.8071),
    ] {
        a[(i, j)] = x;
    }
    let mut b = Mat::<f64>::zeros(13, 2);
    (b[(5, 0)], b[(7, 1)]) = (1.0, 1.0);
    let mut c = Mat::<f64>::zeros(4, 13);
    for (i, j, x) in [
        (0, 0, 3.318),
        (1, 0, 1.5484),
        (1, 6, -0.3981),
        (1, 7, -0.5113),
        (1, 8, -5.7865),
        (2, 11, 1.0),
        (3, 12, 1.0),
    ] {
        c[(i, j)] = x;
    }
    let system = System {
        a,
        b,
        q: output_weight(&c, &diagonal([0.5, 5.0, 0.5, 5.0])),
        r: diagonal([400.0, 700.0]),
    };
    assert_solved("paper machine", &system, 1e-13);
}

#[test]
fn example_2_2_two_inputs_of_very_different_cost() {
    for e in [1e-8, 1e-6, 1e-3, 1.0, 1e3, 1e6] {
        let system = System {
            a: diagonal([0.9512, 0.9048]),
            b: mat![[4.877, 4.877], [-1.1895, 3.569]],
            q: diagonal([0.005, 0.02]),
            r: diagonal([1.0 / (3.0 * e), 3.0 * e]),
        };
        assert_solved(&format!("e = {e:e}"), &system, 1e-12);
    }
}
