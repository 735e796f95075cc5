//! A scenario made ready to run: path and controller are made once, then any of its runs is one closed loop.

use crate::estimation::{Estimator, EstimatorError};
use crate::imaging::{Imaging, Reading};
use crate::path_distance::{Nearest, PathDistance};
use crate::path_source::{PathSourceError, paths};
use crate::record::{
    EllipsoidRecord, InputRecord, OriginRecord, PoseRecord, ReadingRecord, ReferenceRecord,
    RunRecord, RunSummary, StepRecord,
};
use crate::scenario::Scenario;
use crate::simulated_needle::{PlantError, SimulatedNeedle};
use crate::steering::{ControllerError, Steering};
use crate::summary::{Ending, Tally};
use lqr::Certificate;
use needle_control::{
    ControlStep, Measurement, Origin, ReconstructedPath, RefusedChoice, StopReason, TerminalChoice,
};
use needle_model::{Input, InvalidCurvature, Needle, Pose, ReferencePath};
use std::time::{Duration, Instant};

/// Why a scenario cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The path.
    #[error("reference")]
    Path(#[from] PathSourceError),
    /// The needle that the controller believes in.
    #[error("needle")]
    Needle(#[from] InvalidCurvature),
    /// The controller.
    #[error("controller")]
    Controller(#[from] ControllerError),
    /// The estimator.
    #[error("estimator")]
    Estimator(#[from] EstimatorError),
    /// The simulated needle.
    #[error("plant")]
    Plant(#[from] PlantError),
}

/// A run without a duration of its own may last this much longer than the path.
const SPARE_DURATION: f64 = 1.3;

/// A scenario with its path and its controller, ready for any number of runs.
#[derive(Debug, Clone)]
pub struct Experiment {
    scenario: Scenario,
    needle: Needle,
    path: ReferencePath,
    /// What the needle executes along the path, where the scenario asks for that.
    executed: Option<ReconstructedPath>,
    steering: Steering,
}

/// What happened in one sample.
struct Sample<'a> {
    step: usize,
    time_s: f64,
    tip: &'a Pose,
    reading: Option<Reading>,
    measurement: &'a Measurement,
    control: &'a ControlStep<'a>,
    steering: &'a Steering,
    base_input: Input,
    nearest: &'a Nearest,
    took: Duration,
}

impl Experiment {
    /// Reads or makes the path, and makes the controller.
    ///
    /// # Errors
    /// [`RunError`] says which section of the scenario is to blame.
    pub fn new(scenario: &Scenario) -> Result<Self, RunError> {
        let needle = Needle::new(scenario.curvature_per_mm)?;
        let (path, executed) = paths(scenario)?;
        let steered = executed.as_ref().map_or(&path, |executed| &executed.path);
        let steering = Steering::new(scenario, needle, steered.clone())?;
        // What could fail in a run fails here: the numbers drawn in a run make no scenario invalid.
        Estimator::new(scenario, needle, &path.poses()[0])?;
        SimulatedNeedle::new(scenario, 0, &path.poses()[0])?;
        Ok(Self {
            scenario: scenario.clone(),
            needle,
            path,
            executed,
            steering,
        })
    }

    /// The scenario.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The path that distances are to.
    #[must_use]
    pub fn path(&self) -> &ReferencePath {
        &self.path
    }

    /// The path as the controller has it: another one where the scenario asks for what the needle executes.
    #[must_use]
    pub fn steered_path(&self) -> &ReferencePath {
        self.executed
            .as_ref()
            .map_or(&self.path, |executed| &executed.path)
    }

    /// What the needle executes along the path, and how close that comes; `None` where the controller has the path itself.
    #[must_use]
    pub fn executed(&self) -> Option<&ReconstructedPath> {
        self.executed.as_ref()
    }

    /// What is claimed of the controller's terminal ingredients; `None` without any.
    #[must_use]
    pub fn certificate(&self) -> Option<&Certificate> {
        self.steering.certificate()
    }

    /// Terminal cost and set in force; `None` for a controller without.
    #[must_use]
    pub fn terminal(&self) -> Option<TerminalChoice> {
        self.steering.terminal()
    }

    /// The stronger terminal choices that the path refused, and why.
    #[must_use]
    pub fn refused_terminals(&self) -> &[RefusedChoice] {
        self.steering.refused_terminals()
    }

    /// Run `run_index`, every sample recorded.
    ///
    /// # Errors
    /// [`RunError::Plant`] when the numbers drawn make no needle.
    pub fn record(&self, run_index: u64) -> Result<RunRecord, RunError> {
        let mut steps = Vec::new();
        let summary = self.drive(run_index, |sample| steps.push(self.recorded(&sample)))?;
        let path = &self.path;
        Ok(RunRecord {
            scenario_toml: self.scenario.to_toml(),
            run_index,
            reference: ReferenceRecord {
                dt_s: path.dt_s(),
                poses: path.poses().iter().map(PoseRecord::from).collect(),
                inputs: path.inputs().iter().map(|&input| input.into()).collect(),
            },
            steps,
            summary,
            certificate: self.certificate().cloned(),
        })
    }

    /// Run `run_index` in one row.
    ///
    /// # Errors
    /// As [`Experiment::record`].
    pub fn summarise(&self, run_index: u64) -> Result<RunSummary, RunError> {
        self.drive(run_index, |_| {})
    }

    /// The closed loop; `observe` sees each sample.
    fn drive(
        &self,
        run_index: u64,
        mut observe: impl FnMut(Sample<'_>),
    ) -> Result<RunSummary, RunError> {
        let (scenario, dt_s) = (&self.scenario, self.scenario.dt_s);
        let start = &self.path.poses()[0];
        let mut plant = SimulatedNeedle::new(scenario, run_index, start)?;
        let mut imaging = Imaging::new(scenario, run_index);
        let mut estimator = Estimator::new(scenario, self.needle, start)?;
        let mut steering = self.steering.clone();
        let mut distance = PathDistance::new(&self.path);
        let mut tally = Tally::new(distance.length_mm(), dt_s);
        let substep_s = dt_s / scenario.plant.substeps as f64;
        let mut ending = Ending::DurationOver;
        let mut held = Input::ZERO;
        let mut predicted = Vec::new();
        imaging.look(&plant.tip(), 0.0);
        for step in 0..self.most_samples() {
            let time_s = step as f64 * dt_s;
            if step > 0 {
                estimator.advance(held, time_s);
            }
            let mut reading = None;
            while let Some(arrived) = imaging.arrived(time_s) {
                estimator.observe(&arrived, &scenario.sensors);
                reading = Some(arrived);
            }
            let tip = plant.tip();
            let measurement = estimator.measurement(&tip);
            let started = Instant::now();
            let control = steering.controller().step(&measurement, time_s);
            let took = started.elapsed();
            // Copied, for the controller is asked for its terminal set as well.
            predicted.clear();
            predicted.extend_from_slice(control.predicted);
            let ControlStep {
                input,
                origin,
                statistics,
                ..
            } = control;
            let control = ControlStep {
                input,
                origin,
                statistics,
                predicted: &predicted,
            };
            let nearest = distance.nearest(&tip.position_mm);
            let base_input = plant.driven(input);
            held = input;
            tally.add(&control, &nearest, took);
            observe(Sample {
                step,
                time_s,
                tip: &tip,
                reading,
                measurement: &measurement,
                control: &control,
                steering: &steering,
                base_input,
                nearest: &nearest,
                took,
            });
            let ended = match origin {
                Origin::Stop { reason } if held == Input::ZERO => match reason {
                    StopReason::PathEnd => Some(Ending::Finished),
                    StopReason::OutOfTime => Some(Ending::DurationOver),
                    StopReason::NoPlan | StopReason::NoMeasurement => None,
                },
                _ => None,
            };
            if let Some(ended) = ended {
                ending = ended;
                break;
            }
            let first_substep = step as u64 * scenario.plant.substeps;
            let seen = |tip: &Pose, substep: u64| {
                imaging.look(tip, (first_substep + substep) as f64 * substep_s);
            };
            if plant.hold(base_input, seen).is_err() {
                ending = Ending::PlantFailed;
                break;
            }
        }
        let final_mm = distance.to_end_mm(&plant.tip().position_mm);
        Ok(tally.summary(scenario.seed, run_index, ending, final_mm))
    }

    fn most_samples(&self) -> usize {
        let duration_s = self.scenario.duration_s;
        let duration_s = duration_s.unwrap_or(SPARE_DURATION * self.path.duration_s());
        // The cast saturates; the scenario's checks keep it below a million or so.
        ((duration_s / self.scenario.dt_s).round() as usize).max(1)
    }

    fn recorded(&self, sample: &Sample<'_>) -> StepRecord {
        let Sample {
            measurement,
            control,
            nearest,
            ..
        } = *sample;
        let rotation = self.path.poses()[nearest.step].rotation;
        let reference = Pose {
            rotation,
            position_mm: nearest.position_mm,
        };
        let tangent = self.scenario.sensors.tangent_measured;
        let positions = control.predicted.iter().map(|pose| pose.position_mm.into());
        StepRecord {
            step: sample.step,
            time_s: sample.time_s,
            tip: PoseRecord::from(sample.tip),
            measured: sample.reading.map(|reading| ReadingRecord {
                taken_at_s: reading.taken_at_s,
                position_mm: reading.pose.position_mm.into(),
                tangent: tangent.then(|| reading.tangent.into()),
            }),
            estimated: measurement.pose.as_ref().map(PoseRecord::from),
            estimated_curvature_per_mm: measurement.curvature_per_mm,
            reference: PoseRecord::from(&reference),
            input: InputRecord::from(control.input),
            base_input: InputRecord::from(sample.base_input),
            origin: OriginRecord::from(&control.origin),
            distance_mm: nearest.distance_mm,
            progress_mm: nearest.progress_mm,
            iterations: control.statistics.iterations,
            step_us: sample.took.as_secs_f64() * 1e6,
            predicted_mm: positions.collect(),
            terminal: (!control.predicted.is_empty())
                .then(|| sample.steering.terminal_region())
                .flatten()
                .map(EllipsoidRecord::from),
        }
    }
}

/// Run `run_index` of a scenario, every sample recorded. For many runs of one scenario make an [`Experiment`] once.
///
/// # Errors
/// [`RunError`] says which section of the scenario is to blame.
pub fn run(scenario: &Scenario, run_index: u64) -> Result<RunRecord, RunError> {
    Experiment::new(scenario)?.record(run_index)
}
