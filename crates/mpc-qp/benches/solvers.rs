//! Both solvers on the tracking problem (six states, two inputs, rate limits, tolerance 1e-8) in one process: Clarabel refilled, the
//! structured solver cold and warm, with and without the terminal cone. Figures are ratios to Clarabel of the same run.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{ClarabelSolver, OcpQp, OcpSolver, Solution, SolverSettings, Start, StructuredSolver};

/// Problems from 16 random starts, so that a median is over different active sets.
fn problems(horizon: usize, cone: bool) -> Vec<OcpQp<6, 2>> {
    let tracking = Tracking::default();
    (0..16)
        .filter_map(|seed| tracking.problem(Tracking::start(seed), horizon, cone).ok())
        .collect()
}

/// The states of a closed loop of 70 steps and the inputs applied before them.
fn recorded_loop(horizon: usize, cone: bool) -> Vec<OcpQp<6, 2>> {
    let tracking = Tracking::default();
    let mut x = Tracking::start(3);
    let mut problems = Vec::new();
    let Ok(mut problem) = tracking.problem(x, horizon, cone) else {
        return problems;
    };
    let Ok(mut solver) = StructuredSolver::new(&problem, SolverSettings::default()) else {
        return problems;
    };
    let mut solution = Solution::new(&problem);
    for step in 0..70 {
        problems.push(problem.clone());
        if solver.solve(&problem, Start::Cold, &mut solution).is_err() {
            break;
        }
        let last = solution.u[0];
        x = tracking.stage.successor(&x, &last) + Tracking::start(1000 + step) * 0.01;
        if let Ok(next) = tracking.problem(x, horizon, cone) {
            problem = next;
        }
        if problem.set_previous_input(&last).is_err() {
            break;
        }
    }
    problems
}

fn both(criterion: &mut Criterion) {
    let settings = SolverSettings::default();
    for cone in [false, true] {
        let mut group = criterion.benchmark_group(if cone { "cone" } else { "no cone" });
        group.sample_size(20);
        for horizon in [1, 8, 20, 50, 100, 200] {
            let problems = problems(horizon, cone);
            let recorded = recorded_loop(horizon, cone);
            let mut solution = Solution::new(&problems[0]);
            let (Ok(mut clarabel), Ok(mut structured)) = (
                ClarabelSolver::new(&problems[0], settings),
                StructuredSolver::new(&problems[0], settings),
            ) else {
                continue;
            };
            let mut turn = 0;
            group.bench_function(BenchmarkId::new("Clarabel refilled", horizon), |bencher| {
                bencher.iter(|| {
                    turn = (turn + 1) % problems.len();
                    clarabel.solve(&problems[turn], Start::Cold, &mut solution)
                });
            });
            group.bench_function(BenchmarkId::new("structured cold", horizon), |bencher| {
                bencher.iter(|| {
                    turn = (turn + 1) % problems.len();
                    structured.solve(&problems[turn], Start::Cold, &mut solution)
                });
            });
            group.bench_function(BenchmarkId::new("structured warm", horizon), |bencher| {
                bencher.iter(|| {
                    turn = (turn + 1) % recorded.len();
                    let start = if turn == 0 { Start::Cold } else { Start::Warm };
                    solution.shift(&recorded[turn])?;
                    structured.solve(&recorded[turn], start, &mut solution)
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, both);
criterion_main!(benches);
