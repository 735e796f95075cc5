//! Which constraints an infeasibility certificate holds together, in numbers without a unit.
//!
//! A multiplier has the unit of its constraint, so multipliers of a force and of an angle cannot be compared. What can is their
//! *weight*: the term that a constraint puts into a stationarity condition of the ray, `a_ij y_i`, relative to the largest term in
//! the conditions of that component over the whole horizon. Scaling a state, an input or a row changes both alike.

use crate::error::Place;
use crate::infeasibility::{Blame, Tally};
use crate::lagrangian::LagrangianGradient;
use crate::multipliers::TerminalSetMultipliers;
use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;
use crate::stage::Row;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// Part of a condition's largest term below which a constraint is not named: an interior point leaves every multiplier positive.
const LEAST_PART: f64 = 1e-3;

/// Weight below which a constraint is not named: far from the conflict all terms of a condition are such remains. Not larger, because
/// the costates of an unstable system span many decades over a long horizon.
const LEAST_WEIGHT: f64 = 1e-7;

impl Blame {
    /// The constraints with a part in the ray in `solution.multipliers`.
    pub(crate) fn of_ray<const NX: usize, const NU: usize>(
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) -> Self {
        let gradient = LagrangianGradient::of_constraints(problem, solution);
        let (mut of_states, mut of_inputs) = (SVector::zeros(), SVector::zeros());
        for k in 0..problem.horizon() {
            of_inputs = gradient.input(k).scale.sup(&of_inputs);
            of_states = gradient.state(k + 1).scale.sup(&of_states);
        }
        let mut tally = Tally::default();
        for (k, stage) in problem.stages().iter().enumerate() {
            let multipliers = &solution.multipliers.stages[k];
            let inputs = Conditions {
                here: gradient.input(k).scale,
                anywhere: of_inputs,
            };
            let mut charge = |group, weight| tally.charge(group, Place::Stage(k), weight);
            charge(
                ConstraintGroup::InputBounds,
                inputs.weight(&multipliers.u_min.sup(&multipliers.u_max)),
            );
            charge(
                ConstraintGroup::RateLimits,
                inputs.weight(&multipliers.du_min.sup(&multipliers.du_max)),
            );
            let states = (k > 0).then(|| Conditions {
                here: gradient.state(k).scale,
                anywhere: of_states,
            });
            if let Some(states) = &states {
                charge(
                    ConstraintGroup::StateBounds,
                    states.weight(&multipliers.x_min.sup(&multipliers.x_max)),
                );
            }
            for (row, multiplier) in stage.rows.iter().zip(&multipliers.rows) {
                if *multiplier > 0.0 && contradicts_itself(problem, k, row) {
                    charge(ConstraintGroup::Rows, 1.0);
                    continue;
                }
                let of_state = states
                    .as_ref()
                    .map_or(0.0, |states| states.weight(&(row.g_x * *multiplier).abs()));
                let of_input = inputs.weight(&(row.h_u * *multiplier).abs());
                charge(ConstraintGroup::Rows, of_input.max(of_state));
            }
        }
        tally.end(
            problem,
            solution,
            &Conditions {
                here: gradient.state(problem.horizon()).scale,
                anywhere: of_states,
            },
        );
        tally.blame()
    }
}

/// Whether a row without any unknown fails: it has a part in no condition, and is a proof by itself.
fn contradicts_itself<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    k: usize,
    row: &Row<NX, NU>,
) -> bool {
    let given = match k {
        0 => row.g_x.dot(problem.initial_state()),
        _ if row.g_x.amax() == 0.0 => 0.0,
        _ => return false,
    };
    row.h_u.amax() == 0.0 && given > row.upper
}

/// Largest terms in the stationarity conditions of the components at one stage and over the horizon.
struct Conditions<const N: usize> {
    here: SVector<f64, N>,
    anywhere: SVector<f64, N>,
}

impl<const N: usize> Conditions<N> {
    /// The largest weight of these terms, zero if none of them counts.
    fn weight(&self, terms: &SVector<f64, N>) -> f64 {
        (0..N)
            .filter(|&i| terms[i] > LEAST_PART * self.here[i])
            .map(|i| terms[i] / self.anywhere[i])
            .filter(|&weight| weight > LEAST_WEIGHT)
            .fold(0.0, f64::max)
    }
}

impl Tally {
    /// Books the constraints at the end of the horizon.
    fn end<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
        states: &Conditions<NX>,
    ) {
        let multipliers = &solution.multipliers.terminal;
        let bounds = states.weight(&multipliers.x_min.sup(&multipliers.x_max));
        self.charge(ConstraintGroup::StateBounds, Place::Terminal, bounds);
        let mut charge = |terms: &SVector<f64, NX>| {
            let weight = states.weight(&terms.abs());
            self.charge(ConstraintGroup::TerminalSet, Place::Terminal, weight);
        };
        match (&problem.terminal().set, &multipliers.set) {
            (_, TerminalSetMultipliers::Equality(multiplier)) => charge(multiplier),
            (TerminalSet::Polytope { faces }, TerminalSetMultipliers::Polytope(multipliers)) => {
                for (face, &multiplier) in faces.iter().zip(multipliers) {
                    charge(&(face.normal * multiplier));
                }
            }
            (_, TerminalSetMultipliers::Ellipsoid { offset, .. }) => {
                if let Some(cone) = problem.terminal_cone() {
                    charge(&(cone.factor * offset));
                }
            }
            _ => {}
        }
    }
}
