//! The controllers, each with its defaults. Those that need a path which the needle executes get the one that the trajectory
//! optimisation finds through the positions of the curve.

use super::cases::{CURVATURE_PER_MM, Case, CaseError, DT_S, SPEED_MM_S};
use needle_control::{
    BaselineSettings, Controller, DutyCycledGains, DutyCycledSteering, FeedForward, LawController,
    LinearConfiguration, LqrWeights, LtvController, NmpcConfiguration, NmpcController, PidGains,
    SlidingMode, SlidingModeGains, SteeringPid, TimeVaryingLqr, reconstruct_path,
};
use needle_model::{
    Needle, PositionCurve, PositionPathProblem, PositionPathSettings, ReferencePath,
};

/// Names in the order of the table.
pub(super) const NAMES: [&str; 7] = [
    "nmpc",
    "ltv",
    "lqr",
    "pid",
    "sliding mode",
    "duty-cycled",
    "feed-forward",
];

/// Executed paths found so far: most cases share one curve.
#[derive(Debug, Default)]
pub(super) struct ExecutedPaths(Vec<(ReferencePath, ReferencePath)>);

impl ExecutedPaths {
    /// The path of a case as the needle executes it.
    pub(super) fn of(&mut self, case: &Case) -> Result<ReferencePath, CaseError> {
        if case.executable {
            return Ok(case.path.clone());
        }
        if let Some((_, executed)) = self.0.iter().find(|(path, _)| *path == case.path) {
            return Ok(executed.clone());
        }
        let executed = executed(case)?;
        self.0.push((case.path.clone(), executed.clone()));
        Ok(executed)
    }
}

fn executed(case: &Case) -> Result<ReferencePath, CaseError> {
    let positions: Vec<_> = case
        .path
        .poses()
        .iter()
        .map(|pose| pose.position_mm)
        .collect();
    let settings = PositionPathSettings {
        speed_mm_s: SPEED_MM_S,
        dt_s: DT_S,
        ..PositionPathSettings::default()
    };
    let curve = PositionCurve::through(&positions, 0.0)?;
    let needle = Needle::new(CURVATURE_PER_MM)?;
    let problem = PositionPathProblem::new(needle, curve, settings)?;
    Ok(reconstruct_path(&problem)?.path)
}

/// A controller by name.
pub(super) fn make(
    name: &str,
    case: &Case,
    executed: &ReferencePath,
) -> Result<Box<dyn Controller>, CaseError> {
    let (needle, settings) = (Needle::new(CURVATURE_PER_MM)?, BaselineSettings::default());
    let (path, executed) = (case.path.clone(), executed.clone());
    Ok(match name {
        "nmpc" => Box::new(NmpcController::new(
            needle,
            path,
            NmpcConfiguration::default(),
        )?),
        "ltv" => Box::new(LtvController::new(
            needle,
            executed,
            LinearConfiguration::default(),
        )?),
        "lqr" => {
            let law = TimeVaryingLqr::new(&executed, needle, LqrWeights::default())?;
            Box::new(LawController::new(executed, needle, law, settings)?)
        }
        "pid" => {
            let law = SteeringPid::new(PidGains::default())?;
            Box::new(LawController::new(path, needle, law, settings)?)
        }
        "sliding mode" => {
            let law = SlidingMode::new(SlidingModeGains::default())?;
            Box::new(LawController::new(path, needle, law, settings)?)
        }
        "duty-cycled" => {
            let law = DutyCycledSteering::new(DutyCycledGains::default())?;
            Box::new(LawController::new(path, needle, law, settings)?)
        }
        _ => Box::new(FeedForward::new(executed, settings)?),
    })
}
