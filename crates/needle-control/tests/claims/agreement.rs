//! Both solvers on the programs of one nonlinear controller: the first input of each program is the same.
//!
//! The spin weighs little: beside a cost that may be off by 1e-8 Clarabel's spin is off by up to 0.035 rad/s (1e-10: 2.6e-3; 1e-12: 1e-5),
//! while the structured solver's, at its default, moves by 3e-11 if it is asked for more. So Clarabel is asked for 1e-13, and where it
//! says that it did not get there for 1e-12.

use crate::scene::{self, Scene};
use mpc_qp::{
    ClarabelSolver, OcpQp, OcpSolver, Solution, SolveError, SolveStatus, SolverSettings, Start,
    StructuredSolver,
};
use needle_control::{NmpcConfiguration, NmpcController};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What Clarabel is asked for.
const ASKED: [f64; 2] = [1e-13, 1e-12];

/// What was found over all programs.
#[derive(Debug, Default)]
struct Found {
    programs: usize,
    /// Largest difference of the first inputs, mm/s and rad/s alike.
    largest: f64,
    /// Programs in which Clarabel says that it fell short of 1e-13, and the largest difference there when it is asked for 1e-12.
    short: usize,
    largest_short: f64,
}

/// Answers by the structured solver and asks Clarabel for the same.
#[derive(Debug, Clone)]
struct Both {
    structured: StructuredSolver<6, 2>,
    clarabel: [ClarabelSolver<6, 2>; 2],
    theirs: Solution<6, 2>,
    found: Arc<Mutex<Found>>,
}

impl Both {
    fn new(problem: &OcpQp<6, 2>, found: &Arc<Mutex<Found>>) -> Result<Self, SolveError> {
        let clarabel = |tolerance| {
            let usual = SolverSettings::default();
            ClarabelSolver::new(problem, SolverSettings { tolerance, ..usual })
        };
        Ok(Self {
            structured: StructuredSolver::new(problem, SolverSettings::default())?,
            clarabel: [clarabel(ASKED[0])?, clarabel(ASKED[1])?],
            theirs: Solution::new(problem),
            found: Arc::clone(found),
        })
    }
}

impl OcpSolver<6, 2> for Both {
    fn set_time_limit(&mut self, limit: Option<Duration>) {
        self.structured.set_time_limit(limit);
    }

    fn solve(
        &mut self,
        problem: &OcpQp<6, 2>,
        start: Start,
        solution: &mut Solution<6, 2>,
    ) -> Result<(), SolveError> {
        self.structured.solve(problem, start, solution)?;
        assert_eq!(solution.status, SolveStatus::Solved);
        let mut found = self.found.lock().unwrap();
        found.programs += 1;
        let mut answers = [(false, 0.0); 2];
        for (clarabel, answer) in self.clarabel.iter_mut().zip(&mut answers) {
            clarabel.solve(problem, Start::Cold, &mut self.theirs)?;
            let apart = (solution.u[0] - self.theirs.u[0]).amax();
            *answer = (self.theirs.status == SolveStatus::Solved, apart);
        }
        match answers {
            [(true, apart), _] => found.largest = found.largest.max(apart),
            [_, (_, apart)] => {
                found.short += 1;
                found.largest_short = found.largest_short.max(apart);
            }
        }
        Ok(())
    }
}

#[test]
fn both_solvers_give_the_same_first_input_of_each_program() {
    let scene = Scene::default();
    let found = Arc::new(Mutex::new(Found::default()));
    let configuration = NmpcConfiguration::default();
    let mut controller =
        NmpcController::with_solver(scene.model, scene.path(), configuration, |problem| {
            Both::new(problem, &found)
        })
        .unwrap();
    scene::run(&mut controller, &scene);
    let found = found.lock().unwrap();
    println!("{found:?}");
    assert!(found.programs > 200, "{found:?}");
    // Measured: 2.8e-6, and 7.6e-6 in the 20 programs where Clarabel fell short.
    assert!(found.largest < 1e-5, "{found:?}");
    assert!(found.largest_short < 1e-5, "{found:?}");
    assert!(5 * found.short <= found.programs, "{found:?}");
}
