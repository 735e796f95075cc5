//! Both solvers on the tracking problem in one process: median, 99.9 % and worst of cold solves, of Clarabel refilled, and of
//! the warm closed loop, as ratios to Clarabel refilled. Prints the table of `docs/performance.md`.
//!
//! Times are the solutions' own (assembly included, residuals excluded). Every cold time is of another random start.

#![allow(clippy::print_stdout, reason = "the table is the product")]

use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ClarabelSolver, OcpSolver, Solution, SolveError, SolverSettings, Start, StructuredSolver,
};

const STARTS: u64 = 1000;

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
        let Ok(problem) = tracking.problem(Tracking::start(seed), horizon, cone) else {
            continue;
        };
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
        let Ok(mut problem) = tracking.problem(x, horizon, cone) else {
            continue;
        };
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
            if let Ok(next) = tracking.problem(x, horizon, cone) {
                problem = next;
            }
            if problem.set_previous_input(&last).is_err() {
                break;
            }
        }
    }
    Ok(Times::new(times))
}

fn row(tracking: &Tracking, horizon: usize, cone: bool) -> Result<(), SolveError> {
    let Ok(first) = tracking.problem(Tracking::start(0), horizon, cone) else {
        return Ok(());
    };
    let mut ours = StructuredSolver::new(&first, SolverSettings::default())?;
    let mut theirs = ClarabelSolver::new(&first, SolverSettings::default())?;
    let reference = cold(&mut theirs, tracking, (horizon, cone), 100)?;
    let ours = cold(&mut ours, tracking, (horizon, cone), STARTS)?;
    let warm = warm(tracking, horizon, cone)?;
    let unit = reference.at(0.5);
    println!(
        "| {horizon} | {} | {unit:.0} | {:.1} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} |",
        if cone { "yes" } else { "no" },
        ours.at(0.5),
        ours.at(0.5) / unit,
        ours.at(0.999) / unit,
        ours.at(1.0) / unit,
        warm.at(0.5) / unit,
        warm.at(0.999) / unit,
    );
    Ok(())
}

fn main() -> Result<(), SolveError> {
    let tracking = Tracking::default();
    println!(
        "| N | cone | Clarabel refilled, us | cold, us | cold median | 99.9 % | worst | warm median | 99.9 % |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for cone in [false, true] {
        for horizon in [1, 8, 20, 50, 100, 200] {
            row(&tracking, horizon, cone)?;
        }
    }
    Ok(())
}
