//! Tails, which criterion does not show: both solvers on the tracking problem in one process, median, 99.9 % and worst of cold solves, of Clarabel refilled, and of
//! the warm closed loop, as ratios to Clarabel refilled; then the worst of 1e5 cold solves. Prints the tables of `docs/performance.md`.
//!
//! Times are the solutions' own (assembly and extraction included, residuals excluded, for both solvers). Every cold time is of another random start.

#![allow(clippy::print_stdout, reason = "the table is the product")]

use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ClarabelSolver, OcpSolver, Solution, SolveError, SolveStatus, SolverSettings, Start,
    StructuredSolver,
};

const STARTS: u64 = 1000;

const FEASIBLE: &str = "every start is feasible by construction";

/// For the worst case.
const MANY_STARTS: u64 = 100_000;

struct Times(Vec<f64>);

impl Times {
    fn new(mut micros: Vec<f64>) -> Self {
        micros.sort_by(f64::total_cmp);
        Self(micros)
    }

    fn at(&self, fraction: f64) -> f64 {
        let last = self.0.len().saturating_sub(1);
        self.0
            .get((last as f64 * fraction).round() as usize)
            .copied()
            .unwrap_or(f64::NAN)
    }
}

fn micros(solution: &Solution<6, 2>) -> f64 {
    solution.time.as_secs_f64() * 1e6
}

fn cold<S: OcpSolver<6, 2>>(
    solver: &mut S,
    tracking: &Tracking,
    (horizon, cone): (usize, bool),
    starts: u64,
) -> Result<Times, SolveError> {
    let mut times = Vec::new();
    for seed in 0..starts {
        let problem = tracking
            .problem(Tracking::start(seed), horizon, cone)
            .expect(FEASIBLE);
        let mut solution = Solution::new(&problem);
        solver.solve(&problem, Start::Cold, &mut solution)?;
        times.push(micros(&solution));
    }
    Ok(Times::new(times))
}

/// Seventy steps of the loop from each of ten starts, disturbed by a hundredth of a start at each step.
fn warm(tracking: &Tracking, horizon: usize, cone: bool) -> Result<Times, SolveError> {
    let mut times = Vec::new();
    for start in 0..10 {
        let mut x = Tracking::start(start);
        let mut problem = tracking.problem(x, horizon, cone).expect(FEASIBLE);
        let mut solver = StructuredSolver::new(&problem, SolverSettings::default())?;
        let mut solution = Solution::new(&problem);
        for step in 0..70 {
            let from = if step == 0 { Start::Cold } else { Start::Warm };
            solver.solve(&problem, from, &mut solution)?;
            if step > 0 {
                times.push(micros(&solution));
            }
            let last = solution.u[0];
            x = tracking.stage.successor(&x, &last) + Tracking::start(1000 * start + step) * 0.01;
            solution.shift(&problem)?;
            problem = tracking.problem(x, horizon, cone).expect(FEASIBLE);
            problem.set_previous_input(&last).expect("finite inputs");
        }
    }
    Ok(Times::new(times))
}

/// One factorise-and-solve sweep with what surrounds it: the same problem without any bound.
fn bare(tracking: &Tracking, horizon: usize) -> Result<Times, SolveError> {
    let mut free = tracking.clone();
    free.stage = mpc_qp::Stage {
        u_min: nalgebra::Vector2::repeat(f64::NEG_INFINITY),
        u_max: nalgebra::Vector2::repeat(f64::INFINITY),
        du_min: nalgebra::Vector2::repeat(f64::NEG_INFINITY),
        du_max: nalgebra::Vector2::repeat(f64::INFINITY),
        ..tracking.stage.clone()
    };
    let first = free
        .problem(Tracking::start(0), horizon, false)
        .expect(FEASIBLE);
    let mut solver = StructuredSolver::new(&first, SolverSettings::default())?;
    cold(&mut solver, &free, (horizon, false), STARTS)
}

/// The worst of many cold solves over their median; what looks slow is timed again, so that an interruption does not count.
fn worst_of_many(tracking: &Tracking, horizon: usize, cone: bool) -> Result<(), SolveError> {
    let first = tracking
        .problem(Tracking::start(0), horizon, cone)
        .expect(FEASIBLE);
    let mut solver = StructuredSolver::new(&first, SolverSettings::default())?;
    let median = cold(&mut solver, tracking, (horizon, cone), STARTS)?.at(0.5);
    let mut solution = Solution::new(&first);
    let (mut worst, mut most, mut unsolved): (f64, usize, usize) = (0.0, 0, 0);
    for seed in 0..MANY_STARTS {
        let problem = tracking
            .problem(Tracking::start(seed), horizon, cone)
            .expect(FEASIBLE);
        solver.solve(&problem, Start::Cold, &mut solution)?;
        let mut least = micros(&solution);
        for _ in 0..8 {
            if least <= 2.0 * median {
                break;
            }
            solver.solve(&problem, Start::Cold, &mut solution)?;
            least = least.min(micros(&solution));
        }
        worst = worst.max(least);
        most = most.max(solution.iterations);
        unsolved += usize::from(solution.status != SolveStatus::Solved);
    }
    let ratio = worst / median;
    println!(
        "| {horizon} | {} | {MANY_STARTS} | {ratio:.2} | {most} | {unsolved} |",
        if cone { "yes" } else { "no" },
    );
    Ok(())
}

fn row(tracking: &Tracking, horizon: usize, cone: bool) -> Result<(), SolveError> {
    let first = tracking
        .problem(Tracking::start(0), horizon, cone)
        .expect(FEASIBLE);
    let mut ours = StructuredSolver::new(&first, SolverSettings::default())?;
    let mut theirs = ClarabelSolver::new(&first, SolverSettings::default())?;
    let reference = cold(&mut theirs, tracking, (horizon, cone), 100)?;
    let ours = cold(&mut ours, tracking, (horizon, cone), STARTS)?;
    let warm = warm(tracking, horizon, cone)?;
    let bare = bare(tracking, horizon)?;
    let unit = reference.at(0.5);
    println!(
        "| {horizon} | {} | {unit:.0} | {:.1} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} | {:.2} |",
        if cone { "yes" } else { "no" },
        ours.at(0.5),
        ours.at(0.5) / unit,
        ours.at(0.999) / unit,
        ours.at(1.0) / unit,
        warm.at(0.5) / unit,
        warm.at(0.999) / unit,
        warm.at(0.5) / bare.at(0.5),
    );
    Ok(())
}

fn main() -> Result<(), SolveError> {
    let tracking = Tracking::default();
    println!(
        "| N | cone | Clarabel refilled, us | cold, us | cold median | 99.9 % | worst | warm median | 99.9 % | bare sweeps |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for cone in [false, true] {
        for horizon in [1, 8, 20, 50, 100, 200] {
            row(&tracking, horizon, cone)?;
        }
    }
    println!("\n| N | cone | starts | worst, cold medians | most iterations | not solved |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for cone in [false, true] {
        for horizon in [1, 8, 20, 50, 100, 200] {
            worst_of_many(&tracking, horizon, cone)?;
        }
    }
    Ok(())
}
