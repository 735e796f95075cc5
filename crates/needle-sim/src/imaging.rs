//! The sensors of a scenario: readings at their own rate, with noise, late, some of them lost, alone or in outages.

use crate::random::{Purpose, Stream};
use crate::scenario::{Scenario, Sensors};
use nalgebra::{Vector3, Vector6};
use needle_model::Pose;
use std::collections::VecDeque;

/// Rounding of times, s.
const TIME_TOLERANCE_S: f64 = 1e-9;

/// A reading: the pose with its noise. What is not measured of it, whoever reads it must leave alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    pub(crate) pose: Pose,
    /// Direction of the pose, before the roll's noise: rounding would otherwise carry the roll into it.
    pub(crate) tangent: Vector3<f64>,
    pub(crate) taken_at_s: f64,
}

/// Takes readings and hands them over late.
#[derive(Debug)]
pub(crate) struct Imaging {
    sensors: Sensors,
    noise: Stream,
    /// Readings taken so far, lost ones included.
    taken: u64,
    /// Readings that the present outage has yet to take.
    outage: u64,
    on_their_way: VecDeque<Reading>,
}

impl Imaging {
    pub(crate) fn new(scenario: &Scenario, run_index: u64) -> Self {
        Self {
            sensors: scenario.sensors,
            noise: Stream::new(scenario.seed, run_index, Purpose::Sensors),
            taken: 0,
            outage: 0,
            on_their_way: VecDeque::new(),
        }
    }

    /// Shows the tip at `now_s`; a reading is taken when one is due. A sensor faster than the calls reads at each call.
    pub(crate) fn look(&mut self, tip: &Pose, now_s: f64) {
        let Sensors {
            period_s,
            position_std_mm,
            tangent_std_rad: tilt,
            roll_std_rad: roll,
            dropout_probability,
            dropout_readings,
            ..
        } = self.sensors;
        let due = (now_s + TIME_TOLERANCE_S) / period_s;
        if due < self.taken as f64 {
            return;
        }
        // The cast truncates: the reading of this period.
        self.taken = due as u64 + 1;
        // As many numbers for every reading, so that scenarios that differ in noise draw alike.
        let linear = self.noise.normals() * position_std_mm;
        let angular = self
            .noise
            .normals()
            .component_mul(&Vector3::new(tilt, tilt, roll));
        if self.noise.uniform() < dropout_probability {
            self.outage = dropout_readings;
        }
        if self.outage > 0 {
            self.outage -= 1;
            return;
        }
        // The roll last, about the measured tangent.
        let tilted = tip.perturbed(&Vector6::new(0.0, 0.0, 0.0, angular.x, angular.y, 0.0));
        let pose = Pose {
            position_mm: tip.position_mm + linear,
            ..tilted.perturbed(&Vector6::ith(5, angular.z))
        };
        self.on_their_way.push_back(Reading {
            pose,
            tangent: tilted.tangent(),
            taken_at_s: now_s,
        });
    }

    /// The next reading that has arrived by `now_s`, oldest first.
    pub(crate) fn arrived(&mut self, now_s: f64) -> Option<Reading> {
        let arrives_at_s = self.on_their_way.front()?.taken_at_s + self.sensors.delay_s;
        match arrives_at_s <= now_s + TIME_TOLERANCE_S {
            true => self.on_their_way.pop_front(),
            false => None,
        }
    }
}
