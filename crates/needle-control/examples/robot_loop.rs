//! The loop that runs on a robot: estimator, controller, deadline. Replace `Robot` by yours; everything else stays.

use nalgebra::SVector;
use needle_control::{
    Belief, Controller, FilterSettings, NeedleFilter, NmpcConfiguration, NmpcController,
    Observation, Origin, StopReason, Survival,
};
use needle_model::{
    Input, LaggedState, Needle, PhysicalNeedle, PhysicalState, Pose, ReferencePath,
};
use std::error::Error;
use std::time::Duration;

const SAMPLE_S: f64 = 0.1;
const DEADLINE: Duration = Duration::from_millis(50);

fn main() -> Result<(), Box<dyn Error>> {
    let needle = Needle::new(1.0 / 150.0)?;
    let path = planned_path()?;

    // A plan that is not ready at the deadline is not applied: the controller falls back to the one before and says so.
    let survival = Survival {
        deadline: Some(DEADLINE),
        ..Survival::default()
    };
    let configuration = NmpcConfiguration {
        survival,
        ..NmpcConfiguration::default()
    };
    let mut controller = NmpcController::new(needle, path, configuration)?;

    // At entry: 0.2 mm, 1 degree, bevel known to 0.1 rad, curvature to 30 %, no wind-up.
    let (pose, lag_rad) = (Pose::identity(), 0.0);
    let entry = LaggedState {
        pose,
        needle,
        lag_rad,
    };
    let std = SVector::from([0.2, 0.2, 0.2, 0.02, 0.02, 0.1, 0.002, 0.01]);
    let belief = Belief::independent(entry, &std);
    let mut filter = NeedleFilter::new(FilterSettings::default(), belief, 0.0)?;

    let mut robot = Robot::new(Needle::new(0.8 / 150.0)?);
    let mut held = Input::ZERO;
    loop {
        let now_s = robot.now_s();
        // The belief is that of the first sample.
        if now_s > 0.0 {
            filter.advance(held, now_s);
        }
        for (observation, taken_at_s) in robot.images() {
            filter.observe(observation, taken_at_s);
        }
        let step = controller.step(&filter.measurement(), now_s);
        held = step.input;
        // Other stops are passing ones: of a gap without images, of a plan that came late.
        let over = matches!(
            step.origin,
            Origin::Stop {
                reason: StopReason::PathEnd | StopReason::OutOfTime
            }
        );
        robot.apply(held)?;
        if over && held == Input::ZERO {
            break;
        }
    }
    // The path is 100 mm long and bent.
    assert!(
        robot.depth_mm() > 95.0,
        "stopped at {} mm",
        robot.depth_mm()
    );
    Ok(())
}

/// 100 mm at 5 mm/s with half of the needle's curvature.
fn planned_path() -> Result<ReferencePath, Box<dyn Error>> {
    let input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 0.05,
    };
    let bend = Needle::new(1.0 / 300.0)?;
    let inputs = vec![input; 200];
    Ok(ReferencePath::from_inputs(
        bend,
        Pose::identity(),
        inputs,
        SAMPLE_S,
    )?)
}

/// A simulated robot whose images show the tip 0.1 s late.
struct Robot {
    plant: PhysicalNeedle,
    state: PhysicalState,
    late: Vec<(Observation, f64)>,
    samples: u32,
}

impl Robot {
    fn new(needle: Needle) -> Self {
        let plant = PhysicalNeedle::from(needle);
        let state = plant.at_entry(&Pose::identity());
        Self {
            plant,
            state,
            late: Vec::new(),
            samples: 0,
        }
    }

    fn now_s(&self) -> f64 {
        f64::from(self.samples) * SAMPLE_S
    }

    fn images(&mut self) -> Vec<(Observation, f64)> {
        let (tip, now_s) = (self.plant.tip(&self.state), self.now_s());
        let seen = vec![
            (Observation::Position(tip.position_mm), now_s),
            (Observation::Tangent(tip.tangent()), now_s),
        ];
        std::mem::replace(&mut self.late, seen)
    }

    fn apply(&mut self, input: Input) -> Result<(), Box<dyn Error>> {
        self.state = self.plant.step(&self.state, input, SAMPLE_S)?;
        self.samples += 1;
        Ok(())
    }

    fn depth_mm(&self) -> f64 {
        self.state.inserted_mm
    }
}
