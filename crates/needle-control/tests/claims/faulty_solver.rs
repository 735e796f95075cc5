//! A solver that does as it is told: answers well, late, or not at all; and the predictive controllers on it.

use mpc_qp::{
    Blame, InfeasibilityCertificate, OcpQp, OcpSolver, Solution, SolveError, SolveStatus,
    SolverSettings, Start, StructuredSolver,
};
use needle_control::{LinearConfiguration, LtvController, NmpcConfiguration, NmpcController};
use needle_model::{Needle, ReferencePath};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// How a solve goes wrong.
#[allow(
    clippy::large_enum_variant,
    reason = "a status holds the blame; there is one fault at a time"
)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// A good solver's numbers with this status.
    Status(SolveStatus),
    /// An error in place of an answer.
    Error,
    /// A good answer after this time.
    Late(Duration),
}

/// A program without a solution.
pub(crate) fn infeasible() -> Fault {
    Fault::Status(SolveStatus::PrimalInfeasible {
        certificate: InfeasibilityCertificate {
            residual: 0.0,
            sign_violation: 0.0,
        },
        blame: Blame::default(),
    })
}

/// Tells the solvers of one controller what to do, and keeps what they are told.
#[derive(Debug, Clone, Default)]
pub(crate) struct Switch {
    fault: Arc<Mutex<Option<Fault>>>,
    limits: Arc<Mutex<Vec<Duration>>>,
}

impl Switch {
    pub(crate) fn set(&self, fault: Option<Fault>) {
        *self.fault.lock().unwrap() = fault;
    }

    fn get(&self) -> Option<Fault> {
        *self.fault.lock().unwrap()
    }

    /// The times that the solvers were given since the last call.
    pub(crate) fn take_limits(&self) -> Vec<Duration> {
        std::mem::take(&mut self.limits.lock().unwrap())
    }
}

/// The structured solver behind a switch.
#[derive(Debug, Clone)]
pub(crate) struct Faulty<const NX: usize> {
    solver: StructuredSolver<NX, 2>,
    switch: Switch,
}

impl<const NX: usize> Faulty<NX> {
    pub(crate) fn new(problem: &OcpQp<NX, 2>, switch: &Switch) -> Result<Self, SolveError> {
        Ok(Self {
            solver: StructuredSolver::new(problem, SolverSettings::default())?,
            switch: switch.clone(),
        })
    }
}

impl<const NX: usize> OcpSolver<NX, 2> for Faulty<NX> {
    fn set_time_limit(&mut self, limit: Option<Duration>) {
        self.switch.limits.lock().unwrap().extend(limit);
    }

    fn solve(
        &mut self,
        problem: &OcpQp<NX, 2>,
        start: Start,
        solution: &mut Solution<NX, 2>,
    ) -> Result<(), SolveError> {
        self.solver.solve(problem, start, solution)?;
        match self.switch.get() {
            None => {}
            Some(Fault::Status(status)) => solution.status = status,
            Some(Fault::Late(by)) => std::thread::sleep(by),
            Some(Fault::Error) => {
                return Err(SolveError::Setting {
                    field: "none",
                    expected: "no fault",
                    found: 1.0,
                });
            }
        }
        Ok(())
    }
}

/// The time-varying controller on a faulty solver.
pub(crate) fn ltv(
    needle: Needle,
    path: ReferencePath,
    configuration: LinearConfiguration,
    switch: &Switch,
) -> LtvController {
    LtvController::with_solver(needle, path, configuration, |p| Faulty::new(p, switch)).unwrap()
}

/// The nonlinear controller on a faulty solver.
pub(crate) fn nmpc(
    needle: Needle,
    path: ReferencePath,
    configuration: NmpcConfiguration,
    switch: &Switch,
) -> NmpcController {
    NmpcController::with_solver(needle, path, configuration, |p| Faulty::new(p, switch)).unwrap()
}
