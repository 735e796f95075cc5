//! The structured solver allocates nothing after it was made: refilling and solving are counted.
//!
//! An allocator needs `unsafe`; this test is the one place of the crate that has it.

#![allow(unsafe_code, reason = "GlobalAlloc is an unsafe trait")]
#![expect(clippy::unwrap_used, reason = "helpers of tests may fail loudly")]

use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{OcpSolver, Solution, SolveStatus, SolverSettings, Start, StructuredSolver};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn refill_and_solve_allocate_nothing() {
    let tracking = Tracking::default();
    for cone in [false, true] {
        let mut problem = tracking.problem(Tracking::start(1), 20, cone).unwrap();
        let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
        let mut solution = Solution::new(&problem);
        for seed in 1..20 {
            let other = tracking.problem(Tracking::start(seed), 20, cone).unwrap();
            let before = COUNT.with(Cell::get);
            problem.set_initial_state(other.initial_state()).unwrap();
            problem.set_terminal(other.terminal()).unwrap();
            for (k, stage) in other.stages().iter().enumerate() {
                problem.set_stage(k, stage).unwrap();
            }
            solver.solve(&problem, Start::Cold, &mut solution).unwrap();
            solution.shift(&problem).unwrap();
            solver.solve(&problem, Start::Warm, &mut solution).unwrap();
            assert_eq!(COUNT.with(Cell::get) - before, 0, "seed {seed}, cone {cone}");
            assert_eq!(solution.status, SolveStatus::Solved);
        }
    }
}
