//! Both solvers on the tracking problem (six states, two inputs, rate limits, tolerance 1e-8) in one process: Clarabel refilled, the
//! structured solver cold and warm, with and without the terminal cone. Figures are ratios to Clarabel of the same run.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{ClarabelSolver, OcpQp, OcpSolver, Solution, SolverSettings, Start, StructuredSolver};

const FEASIBLE: &str = "every start is feasible by construction";

/// Problems from 16 random starts, so that a median is over different active sets.
fn problems(horizon: usize, cone: bool) -> Vec<OcpQp<6, 2>> {
    let tracking = Tracking::default();
    (0..16)
        .map(|seed| tracking.problem(Tracking::start(seed), horizon, cone))
        .map(|problem| problem.expect(FEASIBLE))
        .collect()
}

/// The states of a closed loop of 70 steps and the inputs applied before them.
fn recorded_loop(horizon: usize, cone: bool) -> Vec<OcpQp<6, 2>> {
    let tracking = Tracking::default();
    let mut problem = tracking
        .problem(Tracking::start(3), horizon, cone)
        .expect(FEASIBLE);
    let mut solver = structured(&problem);
    let mut solution = Solution::new(&problem);
    (0..70)
        .map(|step| {
            let recorded = problem.clone();
            solver
                .solve(&recorded, Start::Cold, &mut solution)
                .expect("the solver was made for this structure");
            let last = solution.u[0];
            let x = tracking.stage.successor(recorded.initial_state(), &last)
                + Tracking::start(1000 + step) * 0.01;
            problem = tracking.problem(x, horizon, cone).expect(FEASIBLE);
            problem.set_previous_input(&last).expect("finite inputs");
            recorded
        })
        .collect()
}

fn structured(problem: &OcpQp<6, 2>) -> StructuredSolver<6, 2> {
    StructuredSolver::new(problem, SolverSettings::default()).expect("default settings")
}

fn both(criterion: &mut Criterion) {
    for cone in [false, true] {
        let mut group = criterion.benchmark_group(if cone { "cone" } else { "no cone" });
        group.sample_size(20);
        for horizon in [1, 8, 20, 50, 100, 200] {
            let problems = problems(horizon, cone);
            let recorded = recorded_loop(horizon, cone);
            let mut solution = Solution::new(&problems[0]);
            let mut clarabel = ClarabelSolver::new(&problems[0], SolverSettings::default())
                .expect("default settings");
            let mut structured = structured(&problems[0]);
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
