//! Linear model predictive control about a reference: time-varying on SE(3), and time-invariant for the straight needle.
//!
//! The error is xi = log(g_r^-1 g), linearised along the reference itself, so the program is the same wherever the world frame
//! is. Of a straight needle only depth (xi_3) and roll (xi_6) answer to the inputs; there the model is x+ = x + dt u exactly,
//! the paper's problem. Both share this file; they differ in the coordinates of the error and the terminal choices.
//!
//! Under an estimated curvature that is more than 0.1 % off the model's the time-varying controller is linearised about a nominal needle of that
//! curvature, which the nonlinear controller steers along the path (`nominal`).

mod configuration;
mod linearisation;
mod nominal;
mod regulator;
mod step;

pub use configuration::{LinearConfiguration, LinearWeights};

use crate::configuration::ConfigurationError;
use crate::controller::SolverStatistics;
use crate::corridor::Corridor;
use crate::follower::Follower;
use crate::plan_solver::{MakeSolver, PlanSolver, boxed, structured};
use crate::terminal::{
    ALL_COORDINATES, Chosen, DEPTH_AND_ROLL, Ingredients, RefusedChoice, TerminalChoice,
    TerminalRegion,
};
use linearisation::Linearisation;
use lqr::Certificate;
use mpc_qp::{OcpQp, SolveError};
use nalgebra::{SMatrix, Vector6};
use needle_model::{Needle, Pose, ReferencePath};
use nominal::Nominal;
use regulator::{Regulator, weighted_stage};

/// Model predictive controller linearised along the reference; `NX` counts the coordinates of the error and the two inputs.
#[derive(Debug, Clone)]
pub struct LinearController<const NX: usize> {
    configuration: LinearConfiguration,
    coordinates: &'static [usize],
    follower: Follower,
    /// Where an estimate of the curvature may come; a straight needle has none.
    nominal: Option<Nominal>,
    linearisation: Linearisation,
    regulator: Regulator<NX>,
    corridor: Option<Corridor>,
    /// The path itself over the horizon, where there is a corridor: a nominal needle may stand in the tracker.
    axis: Vec<Pose>,
    ingredients: Ingredients,
    chosen: TerminalChoice,
    refused: Vec<RefusedChoice>,
    /// Poses of the last plan that was applied, from its own sample on.
    predicted: Vec<Pose>,
    /// Error of the last pose that was solved from.
    present: Vector6<f64>,
    lag_s: f64,
    value: f64,
    statistics: SolverStatistics,
}

/// Linear time-varying controller on SE(3).
pub type LtvController = LinearController<8>;

/// Controller of the straight needle: depth and roll.
pub type StraightController = LinearController<4>;

impl LtvController {
    /// A controller at the start of `path`, at rest, on the structured solver.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the setting that is out of range, or holds the reason why the terminal choice cannot be had.
    pub fn new(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
    ) -> Result<Self, ConfigurationError> {
        let make_solver = structured(configuration.survival.deadline);
        Self::with_solver(needle, path, configuration, make_solver)
    }

    /// The same on a solver of the caller's choice; under an estimated curvature the nominal needle is planned by the structured one.
    ///
    /// # Errors
    /// As [`LtvController::new`].
    pub fn with_solver<S: PlanSolver<8> + 'static>(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
        make_solver: impl FnMut(&OcpQp<8, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        Self::assemble(
            needle,
            path,
            configuration,
            ALL_COORDINATES,
            &mut boxed(make_solver),
        )
    }
}

impl StraightController {
    /// A controller of a straight needle (`curvature_per_mm` of zero) at the start of `path`, on the structured solver.
    ///
    /// # Errors
    /// As [`LtvController::new`], and [`TerminalError::Bent`](crate::TerminalError::Bent) or
    /// [`ConfigurationError::CorridorOfStraightNeedle`].
    pub fn new(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
    ) -> Result<Self, ConfigurationError> {
        let make_solver = structured(configuration.survival.deadline);
        Self::with_solver(needle, path, configuration, make_solver)
    }

    /// The same on a solver of the caller's choice.
    ///
    /// # Errors
    /// As [`StraightController::new`].
    pub fn with_solver<S: PlanSolver<4> + 'static>(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
        make_solver: impl FnMut(&OcpQp<4, 2>) -> Result<S, SolveError>,
    ) -> Result<Self, ConfigurationError> {
        Self::assemble(
            needle,
            path,
            configuration,
            DEPTH_AND_ROLL,
            &mut boxed(make_solver),
        )
    }
}

impl<const NX: usize> LinearController<NX> {
    fn assemble(
        needle: Needle,
        path: ReferencePath,
        configuration: LinearConfiguration,
        coordinates: &'static [usize],
        make_solver: MakeSolver<'_, NX>,
    ) -> Result<Self, ConfigurationError> {
        configuration.validate()?;
        if let Some(corridor_mm) = configuration.corridor_mm
            && coordinates == DEPTH_AND_ROLL
        {
            return Err(ConfigurationError::CorridorOfStraightNeedle { corridor_mm });
        }
        let problem = configuration.terminal_problem(needle, &path, coordinates);
        let Chosen {
            choice,
            ingredients,
            refused,
        } = problem.choose(configuration.terminal)?;
        let LinearConfiguration { horizon, dt_s, .. } = configuration;
        let weights = &configuration.weights;
        let mut q = SMatrix::<f64, NX, NX>::zeros();
        for (i, &coordinate) in coordinates.iter().enumerate() {
            q[(i, i)] = weights.error[coordinate];
        }
        let stage = weighted_stage(&q, &weights.of_input(), &weights.of_change());
        let bends = needle.curvature_per_mm() > 0.0;
        let nominal = bends.then(|| Nominal::new(needle, &path, &configuration));
        Ok(Self {
            coordinates,
            nominal: nominal.transpose()?,
            follower: Follower::new(needle, path, configuration.pursuit()),
            linearisation: Linearisation::new(horizon, dt_s),
            regulator: Regulator::new(stage, &configuration, &ingredients, make_solver)?,
            corridor: configuration.corridor(),
            axis: vec![Pose::identity(); horizon + 1],
            ingredients,
            chosen: choice,
            refused,
            predicted: vec![Pose::identity(); horizon + 1],
            present: Vector6::zeros(),
            lag_s: 0.0,
            value: f64::NAN,
            statistics: SolverStatistics::default(),
            configuration,
        })
    }

    /// The configuration.
    #[must_use]
    pub fn configuration(&self) -> &LinearConfiguration {
        &self.configuration
    }

    /// The terminal choice that was made; never [`TerminalChoice::Auto`]. Its set is in force while the reference is.
    #[must_use]
    pub fn terminal(&self) -> TerminalChoice {
        self.chosen
    }

    /// What [`TerminalChoice::Auto`] could not have in full, with the reasons: the stronger choices that it tried, and last the one in
    /// force itself where its cost stands at the end without a set. Empty for a choice by name.
    #[must_use]
    pub fn refused_terminals(&self) -> &[RefusedChoice] {
        &self.refused
    }

    /// What is claimed of the terminal ingredients, check by check; `None` without a terminal set. The claims are about the
    /// model's curvature: from the first estimate that differs by more than 0.1 % the set is left out.
    #[must_use]
    pub fn certificate(&self) -> Option<&Certificate> {
        self.ingredients.certificate.as_ref()
    }

    /// Where the terminal set of the last step wants the tip at the horizon's end; `None` without a set.
    #[must_use]
    pub fn terminal_region(&self) -> Option<TerminalRegion> {
        if self.leaves_set_out() {
            return None;
        }
        let tracker = &self.follower.tracker;
        TerminalRegion::at_horizon_end(tracker, &self.ingredients, self.coordinates)
    }

    /// Optimal cost V_N of the last step that was solved, in the units of the weights, the price of leaving a corridor included; NaN before.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.value
    }
}
