//! The solver of a controller's programs, its type hidden: each controller is one type and is compiled once, whatever solves for it.

use mpc_qp::{OcpQp, OcpSolver, SolveError, SolverSettings, StructuredSolver};
use std::fmt::Debug;
use std::time::Duration;

/// A solver that a controller can hold whatever its type: so controllers are compiled once, not for each solver.
pub trait PlanSolver<const NX: usize>: OcpSolver<NX, 2> + Debug + Send + Sync {
    /// A copy behind a pointer.
    fn boxed_clone(&self) -> Box<dyn PlanSolver<NX>>;
}

impl<S, const NX: usize> PlanSolver<NX> for S
where
    S: OcpSolver<NX, 2> + Clone + Debug + Send + Sync + 'static,
{
    fn boxed_clone(&self) -> Box<dyn PlanSolver<NX>> {
        Box::new(self.clone())
    }
}

impl<const NX: usize> Clone for Box<dyn PlanSolver<NX>> {
    fn clone(&self) -> Self {
        (**self).boxed_clone()
    }
}

/// Makes the solver of a program.
pub(crate) type MakeSolver<'a, const NX: usize> =
    &'a mut dyn FnMut(&OcpQp<NX, 2>) -> Result<Box<dyn PlanSolver<NX>>, SolveError>;

/// Hides the type of the solvers that are made.
pub(crate) fn boxed<S: PlanSolver<NX> + 'static, const NX: usize>(
    mut make_solver: impl FnMut(&OcpQp<NX, 2>) -> Result<S, SolveError>,
) -> impl FnMut(&OcpQp<NX, 2>) -> Result<Box<dyn PlanSolver<NX>>, SolveError> {
    move |problem| Ok(Box::new(make_solver(problem)?))
}

/// The structured solver within a deadline.
pub(crate) fn structured<const NX: usize>(
    deadline: Option<Duration>,
) -> impl FnMut(&OcpQp<NX, 2>) -> Result<StructuredSolver<NX, 2>, SolveError> {
    move |problem| {
        let settings = SolverSettings {
            time_limit: deadline,
            ..SolverSettings::default()
        };
        StructuredSolver::new(problem, settings)
    }
}
