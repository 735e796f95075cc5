//! Riccati solutions, chains, sizing and certificates at the needle's sizes: 6 states, 8 with the last input.

// A bench that cannot compute has nothing to time.
#![allow(clippy::unwrap_used)]

use criterion::{Criterion, criterion_group, criterion_main};
use faer::Mat;
use lqr::{
    BackwardChain, Constraints, Dare, Ellipsoid, Stage, TerminalClaim, largest_volume_ellipsoid,
    spectral_radius,
};
use plain_doubling::{Square, plain_doubling};
use std::hint::black_box;

mod plain_doubling;

/// A rotation-like system of n states and 2 inputs, close to the identity as sampled systems are.
fn system(n: usize) -> (Mat<f64>, Mat<f64>, Mat<f64>, Mat<f64>) {
    let a = Mat::from_fn(n, n, |i, j| {
        if i == j {
            1.0
        } else {
            0.1 * ((i * 7 + j * 3) as f64).sin()
        }
    });
    let b = Mat::from_fn(n, 2, |i, j| 0.3 * ((i * 5 + j * 11) as f64).cos());
    (a, b, Mat::identity(n, n), Mat::identity(2, 2))
}

/// The same solution without a check: the ratio to `dare` is what the checks cost.
fn unchecked<const N: usize>(c: &mut Criterion) {
    let (a, b, q, r) = system(N);
    let columns =
        |w: &Mat<f64>| -> Square<N> { std::array::from_fn(|j| std::array::from_fn(|i| w[(i, j)])) };
    // R is the identity here.
    let (a_, g, h) = (columns(&a), columns(&(&b * b.transpose())), columns(&q));
    let checked = Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref())
        .solve()
        .unwrap();
    let plain = plain_doubling(a_, g, h);
    let gap = (0..N).map(|j| (plain[j][j] - checked.p[(j, j)]).abs());
    assert!(gap.fold(0.0, f64::max) < 1e-9 * checked.p.norm_l2());
    c.bench_function(&format!("plain doubling {N}x2, no checks"), |bench| {
        bench.iter(|| plain_doubling(black_box(a_), black_box(g), black_box(h)));
    });
}

fn riccati(c: &mut Criterion) {
    unchecked::<6>(c);
    unchecked::<8>(c);
    for n in [6, 8] {
        let (a, b, q, r) = system(n);
        let dare = Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref());
        c.bench_function(&format!("dare {n}x2"), |bench| {
            bench.iter(|| black_box(&dare).solve().unwrap().p);
        });
        c.bench_function(&format!("spectral radius {n}"), |bench| {
            bench.iter(|| spectral_radius(black_box(a.as_ref())).unwrap());
        });
    }
    let (a, b, q, r) = system(6);
    let stage = Stage::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref());
    let stages = vec![stage; 100];
    c.bench_function("chain 100 steps 6x2", |bench| {
        bench.iter(|| {
            BackwardChain::solve(black_box(&stages), q.as_ref())
                .unwrap()
                .p
        });
    });
}

fn terminal(c: &mut Criterion) {
    let (a, b, q, r) = system(6);
    let dare = Dare::new(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref());
    let solution = dare.solve().unwrap();
    let limits = Constraints::new(6, 2)
        .with_input_box(&[-1.0, -1.0], &[1.0, 2.0])
        .and_then(|limits| limits.with_rate_box(&[-0.5, -0.5], &[0.5, 0.5]))
        .unwrap();
    let rows = limits
        .under_law(a.as_ref(), b.as_ref(), solution.k.as_ref())
        .unwrap();
    c.bench_function("size ellipsoid 6, 8 rows", |bench| {
        bench.iter(|| {
            Ellipsoid::largest(solution.p.as_ref(), black_box(&rows))
                .unwrap()
                .level
        });
    });
    let claim = TerminalClaim::largest(&dare, &solution, limits).unwrap();
    c.bench_function("certify 6x2 floating", |bench| {
        bench.iter(|| black_box(&claim).certify());
    });
    c.bench_function("certify 6x2 exact", |bench| {
        bench.iter(|| black_box(&claim).prove());
    });
    let closed_loop = &a + &b * &solution.k;
    c.bench_function("largest volume 6", |bench| {
        bench.iter(|| largest_volume_ellipsoid(black_box(closed_loop.as_ref()), &rows).unwrap());
    });
}

criterion_group!(benches, riccati, terminal);
criterion_main!(benches);
