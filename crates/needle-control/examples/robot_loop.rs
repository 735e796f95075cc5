//! The loop that runs on a robot: estimator, controller, deadline. Replace `Robot` by yours; everything else stays.

use nalgebra::{SVector, Vector3};
use needle_control::{
    BaselineSettings, Belief, Controller, FilterSettings, LawController, NeedleFilter, Observation,
    Origin, SlidingMode, SlidingModeGains,
};
use needle_model::{
    Input, LaggedState, Needle, PhysicalNeedle, PhysicalState, Pose, ReferencePath,
};
use std::error::Error;
use std::time::{Duration, Instant};

const SAMPLE: Duration = Duration::from_millis(100);
const DEADLINE: Duration = Duration::from_millis(50);

fn main() -> Result<(), Box<dyn Error>> {
    let needle = Needle::new(1.0 / 150.0)?;
    let bend = Input {
        v_mm_s: 5.0,
        omega_rad_s: 0.05,
    };
    let path = ReferencePath::from_inputs(
        Needle::new(1.0 / 300.0)?,
        Pose::identity(),
        vec![bend; 200],
        0.1,
    )?;

    // At entry: 0.2 mm, 1 degree, bevel known to 0.1 rad, curvature to 30 %, no wind-up.
    let state = LaggedState {
        pose: Pose::identity(),
        needle,
        lag_rad: 0.0,
    };
    let std = SVector::from([0.2, 0.2, 0.2, 0.02, 0.02, 0.1, 0.002, 0.01]);
    let mut filter = NeedleFilter::new(
        FilterSettings::default(),
        Belief::independent(state, &std),
        0.0,
    )?;
    let law = SlidingMode::new(SlidingModeGains::default())?;
    let mut controller = LawController::new(path, needle, law, BaselineSettings::default())?;

    let mut robot = Robot::new(Needle::new(0.8 / 150.0)?);
    let mut held = Input::ZERO;
    loop {
        let now_s = robot.now_s();
        filter.advance(held, now_s);
        for (position_mm, taken_at_s) in robot.images() {
            filter.observe(Observation::Position(position_mm), taken_at_s);
        }
        let started = Instant::now();
        let step = controller.step(&filter.measurement(), now_s);
        // The input is inside the limits whatever its origin. A late one is not to be trusted with more insertion.
        held = if started.elapsed() < DEADLINE {
            step.input
        } else {
            Input::ZERO
        };
        robot.apply(held)?;
        if let Origin::Stop { .. } = step.origin {
            break;
        }
    }
    assert!(
        robot.distance_mm(&Vector3::new(0.0, 0.0, 0.0)) > 90.0,
        "the needle is in"
    );
    Ok(())
}

/// A simulated robot whose images show the tip 0.1 s late.
struct Robot {
    plant: PhysicalNeedle,
    state: PhysicalState,
    late: Vec<(Vector3<f64>, f64)>,
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
        f64::from(self.samples) * SAMPLE.as_secs_f64()
    }

    fn images(&mut self) -> Vec<(Vector3<f64>, f64)> {
        let now = (self.plant.tip(&self.state).position_mm, self.now_s());
        std::mem::replace(&mut self.late, vec![now])
    }

    fn apply(&mut self, input: Input) -> Result<(), Box<dyn Error>> {
        self.state = self.plant.step(&self.state, input, SAMPLE.as_secs_f64())?;
        self.samples += 1;
        Ok(())
    }

    fn distance_mm(&self, from: &Vector3<f64>) -> f64 {
        (self.plant.tip(&self.state).position_mm - from).norm()
    }
}
