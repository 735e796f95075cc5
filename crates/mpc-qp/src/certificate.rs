//! What proves a problem infeasible.
//!
//! A Farkas ray is a set of multipliers y with A'y = 0, y in the dual cone and b'y < 0 for the constraints
//! `b - A z in K`. Scaled to b'y = -1 with `r = |A'y|_inf` it proves that no feasible point has a 1-norm below 1/r:
//! feasibility would give `0 <= y'(b - A z) = -1 - z'A'y`. Its nonzero entries are the constraints in conflict
//! ([`Blame`]).

use crate::constraints::for_each_scalar;
use crate::infeasibility::{Blame, InfeasibilityCertificate};
use crate::lagrangian::LagrangianGradient;
use crate::multipliers::{Multipliers, TerminalSetMultipliers};
use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// A ray is a proof if no trajectory with a 1-norm up to the reciprocal of this is feasible, in units in which the data's sizes are near
/// one, nor any of ten times the size of the trajectory at hand.
const PROOF: f64 = 1e-6;
const BEYOND_REACH: f64 = 10.0;

/// Wrong signs above which a ray proves nothing.
const PROOF_SIGNS: f64 = 1e-7;

impl InfeasibilityCertificate {
    /// What a ray is worth that proves nothing.
    const NONE: Self = Self {
        residual: f64::INFINITY,
        sign_violation: f64::INFINITY,
    };

    /// Whether the ray refutes enough to be called a proof, the trajectory in `solution` beside it.
    pub(crate) fn is_proof<const NX: usize, const NU: usize>(
        &self,
        solution: &Solution<NX, NU>,
    ) -> bool {
        self.residual <= PROOF
            && self.refutes_beyond(solution)
            && self.sign_violation <= PROOF_SIGNS
    }

    /// Whether the ray refutes ten times the size of the trajectory in `solution`.
    pub(crate) fn refutes_beyond<const NX: usize, const NU: usize>(
        &self,
        solution: &Solution<NX, NU>,
    ) -> bool {
        let of_states: f64 = solution.x[1..].iter().map(|x| x.lp_norm(1)).sum();
        let of_inputs: f64 = solution.u.iter().map(|u| u.lp_norm(1)).sum();
        self.residual.is_finite() && self.residual * BEYOND_REACH * (of_states + of_inputs) <= 1.0
    }
}

/// Takes from each pair of opposite bounds what both multipliers have in common.
///
/// Interior-point rays leave a positive multiplier on every bound. The common part of a pair cancels in A'y and adds
/// `common * (upper - lower) >= 0` to b'y: without it the ray proves more and blames less.
pub fn cancel_opposite_multipliers<const NX: usize, const NU: usize>(
    multipliers: &mut Multipliers<NX, NU>,
) {
    for stage in &mut multipliers.stages {
        cancel(&mut stage.u_min, &mut stage.u_max);
        cancel(&mut stage.du_min, &mut stage.du_max);
        cancel(&mut stage.x_min, &mut stage.x_max);
    }
    cancel(
        &mut multipliers.terminal.x_min,
        &mut multipliers.terminal.x_max,
    );
}

fn cancel<const N: usize>(lower: &mut SVector<f64, N>, upper: &mut SVector<f64, N>) {
    let common = lower.inf(upper);
    *lower -= common;
    *upper -= common;
}

/// Makes the conditions of the states hold exactly and, as far as inputs are bounded, those of the inputs.
///
/// A conic solver's ray leaves a little in every condition, measured against the largest entry of the ray. The adjoint recursion
/// from the end yields costates that leave nothing in the states; what then remains in an input is added to the multiplier of the
/// bound that it pushes against. What it left on soft constraints, which have no part in a contradiction, is dropped first.
pub(crate) fn make_exact<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &mut Solution<NX, NU>,
) {
    drop_soft(problem, &mut solution.multipliers);
    let rest_in_state = |solution: &Solution<NX, NU>, k| {
        LagrangianGradient::of_constraints(problem, solution)
            .state(k)
            .sum
    };
    for k in (1..=problem.horizon()).rev() {
        let rest = rest_in_state(solution, k);
        solution.multipliers.costates[k - 1] += rest;
    }
    for (k, stage) in problem.stages().iter().enumerate() {
        let rest = LagrangianGradient::of_constraints(problem, solution)
            .input(k)
            .sum;
        let multipliers = &mut solution.multipliers.stages[k];
        for i in 0..NU {
            if rest[i] > 0.0 && stage.u_min[i].is_finite() {
                multipliers.u_min[i] += rest[i];
            } else if rest[i] < 0.0 && stage.u_max[i].is_finite() {
                multipliers.u_max[i] -= rest[i];
            }
        }
    }
    cancel_opposite_multipliers(&mut solution.multipliers);
}

fn drop_soft<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    multipliers: &mut Multipliers<NX, NU>,
) {
    let (softening, terminal) = (problem.softening(), &mut multipliers.terminal);
    for stage in &mut multipliers.stages {
        if softening.state_bounds.is_soft() {
            stage.x_min.fill(0.0);
            stage.x_max.fill(0.0);
        }
        if softening.rows.is_soft() {
            stage.rows.fill(0.0);
        }
    }
    if softening.state_bounds.is_soft() {
        terminal.x_min.fill(0.0);
        terminal.x_max.fill(0.0);
    }
    if softening.terminal_set.is_soft() {
        match &mut terminal.set {
            TerminalSetMultipliers::None => {}
            TerminalSetMultipliers::Equality(multiplier) => multiplier.fill(0.0),
            TerminalSetMultipliers::Polytope(multipliers) => multipliers.fill(0.0),
            TerminalSetMultipliers::Ellipsoid { radius, offset } => {
                *radius = 0.0;
                offset.fill(0.0);
            }
        }
    }
}

/// Judges the ray in `solution.multipliers`; neither the states nor the costs are used. One that is laid out for another problem
/// proves nothing.
#[must_use]
pub fn examine_certificate<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
) -> (InfeasibilityCertificate, Blame) {
    if solution.check_shape(problem).is_err() {
        return (InfeasibilityCertificate::NONE, Blame::default());
    }
    let gradient = LagrangianGradient::of_constraints(problem, solution);
    let adjoint = (0..problem.horizon())
        .map(|k| {
            let (input, state) = (gradient.input(k).sum, gradient.state(k + 1).sum);
            input.amax().max(state.amax())
        })
        .fold(0.0, f64::max);
    let mut ray = Ray::default();
    for (stage, costate) in problem.stages().iter().zip(&solution.multipliers.costates) {
        ray.product -= costate.dot(&stage.c);
    }
    let first = &problem.stages()[0];
    ray.product -= solution.multipliers.costates[0].dot(&(first.a * problem.initial_state()));
    for_each_scalar(problem, solution, |constraint| {
        let soft = problem.softening().of(constraint.group).is_soft();
        let multiplier = constraint.multiplier;
        if constraint.right < f64::INFINITY && !soft {
            ray.product += constraint.right * multiplier;
            ray.require(-multiplier);
        } else {
            ray.require(multiplier.abs());
        }
    });
    ray.add_terminal_set(problem, solution);
    let separation = -ray.product;
    if !(separation > 0.0 && adjoint.is_finite()) {
        return (InfeasibilityCertificate::NONE, Blame::default());
    }
    let certificate = InfeasibilityCertificate {
        residual: adjoint / separation,
        sign_violation: ray.sign_violation / separation,
    };
    let blame = if certificate.residual.is_finite() {
        Blame::of_ray(problem, solution)
    } else {
        Blame::default()
    };
    (certificate, blame)
}

/// Running `b'y` and the worst sign.
#[derive(Default)]
struct Ray {
    product: f64,
    sign_violation: f64,
}

impl Ray {
    fn require(&mut self, violation: f64) {
        self.sign_violation = self.sign_violation.max(violation);
    }

    fn add_terminal_set<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        let group = ConstraintGroup::TerminalSet;
        let soft = problem.softening().of(group).is_soft();
        match (&problem.terminal().set, &solution.multipliers.terminal.set) {
            (TerminalSet::Equality { target }, TerminalSetMultipliers::Equality(multiplier)) => {
                self.require(if soft { multiplier.amax() } else { 0.0 });
                self.product += multiplier.dot(target);
            }
            (
                TerminalSet::Ellipsoid { .. },
                TerminalSetMultipliers::Ellipsoid { radius, offset },
            ) => {
                let Some(cone) = problem.terminal_cone() else {
                    return;
                };
                self.require(if soft {
                    radius.abs()
                } else {
                    offset.norm() - radius
                });
                self.product += cone.radius * radius - (cone.factor * offset).dot(cone.center);
            }
            _ => {}
        }
    }
}
