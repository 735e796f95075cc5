//! Whether a guess or an answer can be used at all.

use crate::multipliers::TerminalSetMultipliers;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;

/// Whether every number of a solution is finite.
pub(super) fn all_finite<const NX: usize, const NU: usize>(solution: &Solution<NX, NU>) -> bool {
    let mut all = true;
    // Without an early end, so that several numbers are looked at at a time.
    let mut look = |values: &[f64]| {
        all &= values
            .iter()
            .fold(true, |all, value| all & value.is_finite());
    };
    let (multipliers, slacks) = (&solution.multipliers, &solution.slacks);
    for stage in &multipliers.stages {
        for of_inputs in [&stage.u_min, &stage.u_max, &stage.du_min, &stage.du_max] {
            look(of_inputs.as_slice());
        }
        look(stage.x_min.as_slice());
        look(stage.x_max.as_slice());
        look(&stage.rows);
    }
    for stage in &slacks.stages {
        look(stage.x_min.as_slice());
        look(stage.x_max.as_slice());
        look(&stage.rows);
    }
    for x in solution.x.iter().chain(&multipliers.costates) {
        look(x.as_slice());
    }
    for u in &solution.u {
        look(u.as_slice());
    }
    let (at_end, slack) = (&multipliers.terminal, &slacks.terminal);
    for of_state in [&at_end.x_min, &at_end.x_max, &slack.x_min, &slack.x_max] {
        look(of_state.as_slice());
    }
    match &at_end.set {
        TerminalSetMultipliers::None => {}
        TerminalSetMultipliers::Equality(multiplier) => look(multiplier.as_slice()),
        TerminalSetMultipliers::Polytope(multipliers) => look(multipliers),
        TerminalSetMultipliers::Ellipsoid { radius, offset } => {
            look(&[*radius]);
            look(offset.as_slice());
        }
    }
    look(&[slacks.largest(ConstraintGroup::TerminalSet)]);
    all
}
