//! The controllers that a scenario can name, as one type that is made once and cloned for each run.

use crate::published::{CONSTANTS, DT_S, PublishedController, PublishedPathError};
use crate::scenario::{ControllerChoice, Patience, Scenario};
use lqr::Certificate;
use needle_control::{
    BaselineError, BaselineSettings, ConfigurationError, Controller, DutyCycledSteering,
    FeedForward, LawController, LinearConfiguration, LtvController, NmpcConfiguration,
    NmpcController, RefusedChoice, SlidingMode, SteeringPid, StraightController, TerminalChoice,
    TerminalRegion, TimeVaryingLqr,
};
use needle_model::{Needle, ReferencePath};

/// Why a scenario has no controller.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// A predictive controller.
    #[error(transparent)]
    Predictive(#[from] ConfigurationError),
    /// An explicit law.
    #[error(transparent)]
    Explicit(#[from] BaselineError),
    /// The published program.
    #[error(transparent)]
    Published(#[from] PublishedPathError),
    /// The published program has its sample time built in.
    #[error("dt_s: the published program samples every {expected} s, the scenario every {found} s")]
    PublishedSampleTime {
        /// The program's, s.
        expected: f64,
        /// The scenario's, s.
        found: f64,
    },
    /// The published program has its needle built in.
    #[error(
        "needle.curvature_per_mm: the published program's is {expected}, the scenario's {found}"
    )]
    PublishedCurvature {
        /// The program's, 1/mm.
        expected: f64,
        /// The scenario's, 1/mm.
        found: f64,
    },
}

/// A controller by name.
#[derive(Debug, Clone)]
pub(crate) enum Steering {
    Nmpc(Box<NmpcController>),
    Ltv(Box<LtvController>),
    Straight(Box<StraightController>),
    Pid(Box<LawController<SteeringPid>>),
    Lqr(Box<LawController<TimeVaryingLqr>>),
    SlidingMode(Box<LawController<SlidingMode>>),
    DutyCycled(Box<LawController<DutyCycledSteering>>),
    FeedForward(Box<FeedForward>),
    Published(Box<PublishedController>),
}

impl Steering {
    /// The controller at the start of `path`.
    pub(crate) fn new(
        scenario: &Scenario,
        needle: Needle,
        path: ReferencePath,
    ) -> Result<Self, ControllerError> {
        let settings = |patience: &Patience| BaselineSettings {
            limits: scenario.limits,
            dt_s: scenario.dt_s,
            patience_s: patience.patience_s,
            jump_mm: patience.jump_mm,
        };
        let linear = |configuration: &LinearConfiguration| LinearConfiguration {
            dt_s: scenario.dt_s,
            limits: scenario.limits,
            ..configuration.clone()
        };
        Ok(match &scenario.controller {
            ControllerChoice::Nmpc(configuration) => {
                let configuration = NmpcConfiguration {
                    dt_s: scenario.dt_s,
                    limits: scenario.limits,
                    ..configuration.clone()
                };
                Self::Nmpc(Box::new(NmpcController::new(needle, path, configuration)?))
            }
            ControllerChoice::Ltv(configuration) => Self::Ltv(Box::new(LtvController::new(
                needle,
                path,
                linear(configuration),
            )?)),
            ControllerChoice::Straight(configuration) => Self::Straight(Box::new(
                StraightController::new(needle, path, linear(configuration))?,
            )),
            ControllerChoice::Pid(patience, gains) => {
                let law = SteeringPid::new(*gains)?;
                Self::Pid(Box::new(LawController::new(
                    path,
                    needle,
                    law,
                    settings(patience),
                )?))
            }
            ControllerChoice::Lqr(patience, weights) => {
                let law = TimeVaryingLqr::new(&path, needle, *weights)?;
                Self::Lqr(Box::new(LawController::new(
                    path,
                    needle,
                    law,
                    settings(patience),
                )?))
            }
            ControllerChoice::SlidingMode(patience, gains) => {
                let law = SlidingMode::new(*gains)?;
                let controller = LawController::new(path, needle, law, settings(patience))?;
                Self::SlidingMode(Box::new(controller))
            }
            ControllerChoice::DutyCycled(patience, gains) => {
                let law = DutyCycledSteering::new(*gains)?;
                let controller = LawController::new(path, needle, law, settings(patience))?;
                Self::DutyCycled(Box::new(controller))
            }
            ControllerChoice::FeedForward => {
                let settings = settings(&Patience::default());
                Self::FeedForward(Box::new(FeedForward::new(path, settings)?))
            }
            ControllerChoice::Published(settings) => {
                published_fits(scenario)?;
                let controller = PublishedController::new(&path, settings.clone())?;
                Self::Published(Box::new(controller))
            }
        })
    }

    pub(crate) fn controller(&mut self) -> &mut dyn Controller {
        match self {
            Self::Nmpc(controller) => controller.as_mut(),
            Self::Ltv(controller) => controller.as_mut(),
            Self::Straight(controller) => controller.as_mut(),
            Self::Pid(controller) => controller.as_mut(),
            Self::Lqr(controller) => controller.as_mut(),
            Self::SlidingMode(controller) => controller.as_mut(),
            Self::DutyCycled(controller) => controller.as_mut(),
            Self::FeedForward(controller) => controller.as_mut(),
            Self::Published(controller) => controller.as_mut(),
        }
    }

    /// Where its terminal set wants the tip at the horizon's end.
    pub(crate) fn terminal_region(&self) -> Option<TerminalRegion> {
        match self {
            Self::Nmpc(controller) => controller.terminal_region(),
            Self::Ltv(controller) => controller.terminal_region(),
            Self::Straight(controller) => controller.terminal_region(),
            _ => None,
        }
    }

    /// Terminal cost and set in force.
    pub(crate) fn terminal(&self) -> Option<TerminalChoice> {
        match self {
            Self::Nmpc(controller) => Some(controller.terminal()),
            Self::Ltv(controller) => Some(controller.terminal()),
            Self::Straight(controller) => Some(controller.terminal()),
            _ => None,
        }
    }

    /// The stronger terminal choices that the path refused.
    pub(crate) fn refused_terminals(&self) -> &[RefusedChoice] {
        match self {
            Self::Nmpc(controller) => controller.refused_terminals(),
            Self::Ltv(controller) => controller.refused_terminals(),
            _ => &[],
        }
    }

    /// What is claimed of its terminal ingredients.
    pub(crate) fn certificate(&self) -> Option<&Certificate> {
        match self {
            Self::Nmpc(controller) => controller.certificate(),
            Self::Ltv(controller) => controller.certificate(),
            Self::Straight(controller) => controller.certificate(),
            _ => None,
        }
    }
}

/// The published program knows one sample time and one needle. The limits that it keeps are its own too: a scenario's do not bind it.
fn published_fits(scenario: &Scenario) -> Result<(), ControllerError> {
    // Decimal numbers of a file, read to the last digit or to ten.
    let same = |expected: f64, found: f64| (expected - found).abs() <= 1e-9 * expected;
    let (expected, found) = (DT_S, scenario.dt_s);
    if !same(expected, found) {
        return Err(ControllerError::PublishedSampleTime { expected, found });
    }
    let (expected, found) = (
        CONSTANTS.bevel.curvature_per_m / 1000.0,
        scenario.curvature_per_mm,
    );
    if !same(expected, found) {
        return Err(ControllerError::PublishedCurvature { expected, found });
    }
    Ok(())
}
