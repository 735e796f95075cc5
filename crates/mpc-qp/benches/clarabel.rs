//! Clarabel on the tracking problem (six states, two inputs, rate limits, tolerance 1e-8): built anew and refilled, with and
//! without the terminal cone. Other solvers' figures are ratios to `refilled` of the same run.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{ClarabelSolver, OcpQp, OcpSolver, Solution, SolverSettings, Start};

/// Problems from 16 random starts, so that a median is over different active sets.
fn problems(horizon: usize, cone: bool) -> Vec<OcpQp<6, 2>> {
    let tracking = Tracking::default();
    (0..16)
        .filter_map(|seed| tracking.problem(Tracking::start(seed), horizon, cone).ok())
        .collect()
}

fn clarabel(criterion: &mut Criterion) {
    for cone in [false, true] {
        let mut group = criterion.benchmark_group(if cone {
            "clarabel, cone"
        } else {
            "clarabel, no cone"
        });
        group.sample_size(20);
        for horizon in [1, 8, 20, 50, 100, 200] {
            let problems = problems(horizon, cone);
            let mut solution = Solution::new(&problems[0]);
            let mut turn = 0;
            group.bench_function(BenchmarkId::new("built anew", horizon), |bencher| {
                bencher.iter(|| {
                    turn = (turn + 1) % problems.len();
                    let solver = ClarabelSolver::new(&problems[turn], SolverSettings::default());
                    solver.and_then(|mut solver| {
                        solver.solve(&problems[turn], Start::Cold, &mut solution)
                    })
                });
            });
            let Ok(mut solver) = ClarabelSolver::new(&problems[0], SolverSettings::default())
            else {
                continue;
            };
            group.bench_function(BenchmarkId::new("refilled", horizon), |bencher| {
                bencher.iter(|| {
                    turn = (turn + 1) % problems.len();
                    solver.solve(&problems[turn], Start::Cold, &mut solution)
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, clarabel);
criterion_main!(benches);
