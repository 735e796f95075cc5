//! One step of a linear controller: linearise along the reference, solve for the deviation, and keep or fall back.

use super::nominal::Nominal;
use super::{LinearController, LtvController, StraightController};
use crate::controller::{
    ControlStep, Controller, Measurement, Origin, Softened, SolverStatistics, StopReason,
};
use crate::follower::Follower;
use crate::survival::Sample;
use nalgebra::{SVector, Vector2, Vector3};
use needle_model::{Input, Pose, StepError};
use std::time::Instant;

impl<const NX: usize> LinearController<NX> {
    fn decide(
        &mut self,
        measurement: &Measurement,
        time_s: f64,
        started: Instant,
    ) -> (Input, Origin) {
        let sample = self.follower.observe(measurement, time_s);
        self.shift(sample.elapsed_s);
        if let Some(step) = self.follower.without_plan(&sample) {
            return step;
        }
        let origin = sample
            .pose
            .and_then(|pose| self.solve(&pose, &sample, started));
        let Follower { tracker, guard, .. } = &mut self.follower;
        match origin {
            Some(origin) if !guard.late(started.elapsed()) => {
                let (wanted, solution) = (&tracker.inputs, self.regulator.solution());
                let planned = wanted.iter().zip(&solution.u).map(|(u, d)| absolute(*u, d));
                guard.keep(planned);
                let input = guard.apply(absolute(wanted[0], &solution.u[0]), &sample);
                self.predict();
                (input, origin)
            }
            _ => guard.fall_back(&sample, StopReason::NoPlan),
        }
    }

    /// Moves guesses by the whole steps that have passed since the last sample.
    fn shift(&mut self, elapsed_s: f64) {
        let (dt_s, horizon) = (self.configuration.dt_s, self.configuration.horizon);
        let steps = ((self.lag_s + elapsed_s) / dt_s)
            .round()
            .clamp(0.0, horizon as f64);
        self.lag_s = (self.lag_s + elapsed_s - steps * dt_s).clamp(-dt_s, dt_s);
        self.regulator.shift(steps as usize);
    }

    /// Solves from a pose; `None` without a usable answer.
    fn solve(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> Option<Origin> {
        // The deviation applied last was one from the reference's input at that time.
        if let Some(corridor) = &mut self.corridor {
            self.axis.copy_from_slice(&self.follower.tracker.poses);
            // At the linear price no needle stands still for a wall: its heading may be left out.
            corridor.enclose(pose, &self.axis[0], f64::INFINITY, &Vector3::zeros());
        }
        let before = self.refer(pose, sample, started);
        self.linearise().ok()?;
        let Follower { tracker, guard, .. } = &self.follower;
        self.regulator
            .set_limits(before, &tracker.inputs, sample.reach_s);
        let xi = pose.error_from(&tracker.poses[0]);
        self.present = xi;
        let mut error = SVector::<f64, NX>::zeros();
        for (i, &coordinate) in self.coordinates.iter().enumerate() {
            error[i] = xi[coordinate];
        }
        let previous = guard.previous();
        let previous = Vector2::new(
            previous.v_mm_s - before.v_mm_s,
            previous.omega_rad_s - before.omega_rad_s,
        );
        let mut end = self
            .ingredients
            .at(tracker.step() + self.configuration.horizon);
        if self.leaves_set_out() {
            end.level = None;
        }
        let answer = self
            .regulator
            .solve(&error, &previous, end, guard.remaining(started))
            .ok()?;
        self.statistics.status = Some(answer.status);
        self.statistics.solves += answer.solves;
        self.statistics.iterations += answer.iterations;
        let usable =
            answer.status.has_solution() && self.regulator.solution().u[0].sum().is_finite();
        if !usable {
            return None;
        }
        // The programs carry the factor 1/2 of `mpc-qp`.
        self.value = 2.0 * self.regulator.solution().objective;
        let softened = Softened {
            corridor_mm: self
                .corridor
                .map_or(0.0, |it| it.left_by_mm(self.planned(), &self.axis)),
            terminal_set: answer.violation,
        };
        Some(softened.origin())
    }

    /// Puts the nominal needle's plan in the reference's place where the estimated curvature is not the model's; returns the input one
    /// step before.
    fn refer(&mut self, pose: &Pose, sample: &Sample, started: Instant) -> Input {
        let differs = self.follower.needle_differs();
        let Follower {
            needle, tracker, ..
        } = &mut self.follower;
        let nominal = self.nominal.as_mut();
        let wanted = nominal.filter(|nominal| differs || nominal.in_force());
        let stood_in = wanted.and_then(|nominal| {
            let before = nominal.stand_in(needle, pose, sample, tracker, started);
            let SolverStatistics {
                solves, iterations, ..
            } = nominal.statistics();
            self.statistics.solves += solves;
            self.statistics.iterations += iterations;
            before
        });
        stood_in.unwrap_or_else(|| tracker.input_before())
    }

    /// Whether the terminal set says nothing: it is about the reference, where a nominal needle may stand in, and the model's curvature.
    pub(super) fn leaves_set_out(&self) -> bool {
        self.nominal.as_ref().is_some_and(Nominal::in_force) || self.follower.needle_differs()
    }

    fn linearise(&mut self) -> Result<(), StepError> {
        let Follower {
            needle, tracker, ..
        } = &self.follower;
        for (k, step) in self.linearisation.of(needle, tracker)?.enumerate() {
            let stage = self.regulator.stage_mut(k);
            for (i, &row) in self.coordinates.iter().enumerate() {
                for (j, &column) in self.coordinates.iter().enumerate() {
                    stage.a[(i, j)] = step.a[(row, column)];
                }
                for j in 0..2 {
                    stage.b[(i, j)] = step.b[(row, j)];
                }
                stage.c[i] = step.c[row];
            }
            if let Some(corridor) = &self.corridor {
                corridor.write(stage, &tracker.poses[k + 1], &self.axis[k + 1]);
            }
        }
        Ok(())
    }

    /// Takes the plan's poses for those of the plan applied.
    fn predict(&mut self) {
        let mut predicted = std::mem::take(&mut self.predicted);
        for (pose, planned) in predicted.iter_mut().zip(self.planned()) {
            *pose = planned;
        }
        self.predicted = predicted;
    }

    /// Poses of the plan; coordinates outside the model keep the present error.
    fn planned(&self) -> impl Iterator<Item = Pose> {
        let errors = self.regulator.solution().x.iter();
        errors
            .zip(&self.follower.tracker.poses)
            .map(|(x, reference)| {
                let mut xi = self.present;
                for (i, &coordinate) in self.coordinates.iter().enumerate() {
                    xi[coordinate] = x[i];
                }
                reference.perturbed(&xi)
            })
    }

    fn decided(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        let started = Instant::now();
        self.statistics = SolverStatistics::default();
        let (input, origin) = self.decide(measurement, time_s, started);
        self.statistics.time = started.elapsed();
        ControlStep {
            input,
            origin,
            predicted: origin.ahead(&self.predicted),
            statistics: self.statistics,
        }
    }

    fn forget(&mut self) {
        self.follower.reset();
        if let Some(nominal) = &mut self.nominal {
            nominal.reset();
        }
        self.regulator.shift(usize::MAX);
        self.lag_s = 0.0;
        self.value = f64::NAN;
    }
}

// One for each, not one for all `NX`: so both are compiled here and not again in every crate that uses them.
impl Controller for LtvController {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        self.decided(measurement, time_s)
    }

    fn applied(&mut self, input: Input) {
        self.follower.guard.hold(input);
    }

    fn reset(&mut self) {
        self.forget();
    }
}

impl Controller for StraightController {
    fn step(&mut self, measurement: &Measurement, time_s: f64) -> ControlStep<'_> {
        self.decided(measurement, time_s)
    }

    fn applied(&mut self, input: Input) {
        self.follower.guard.hold(input);
    }

    fn reset(&mut self) {
        self.forget();
    }
}

fn absolute(wanted: Input, deviation: &Vector2<f64>) -> Input {
    Input {
        v_mm_s: wanted.v_mm_s + deviation[0],
        omega_rad_s: wanted.omega_rad_s + deviation[1],
    }
}
