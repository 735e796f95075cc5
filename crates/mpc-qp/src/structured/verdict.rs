//! Whether a guess or an answer can be used at all.

use crate::multipliers::TerminalSetMultipliers;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;

/// Whether every number of a solution is finite.
pub(super) fn all_finite<const NX: usize, const NU: usize>(solution: &Solution<NX, NU>) -> bool {
    let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
    let (multipliers, slacks) = (&solution.multipliers, &solution.slacks);
    let set = match &multipliers.terminal.set {
        TerminalSetMultipliers::None => true,
        TerminalSetMultipliers::Equality(multiplier) => finite(multiplier.as_slice()),
        TerminalSetMultipliers::Polytope(multipliers) => finite(multipliers),
        TerminalSetMultipliers::Ellipsoid { radius, offset } => {
            radius.is_finite() && finite(offset.as_slice())
        }
    };
    let inputs = multipliers.stages.iter().all(|stage| {
        [&stage.u_min, &stage.u_max, &stage.du_min, &stage.du_max]
            .iter()
            .all(|bounds| finite(bounds.as_slice()))
            && finite(&stage.rows)
    });
    let of_states = multipliers
        .stages
        .iter()
        .map(|stage| [&stage.x_min, &stage.x_max])
        .chain([[&multipliers.terminal.x_min, &multipliers.terminal.x_max]])
        .chain(
            slacks
                .stages
                .iter()
                .map(|stage| [&stage.x_min, &stage.x_max]),
        )
        .chain([[&slacks.terminal.x_min, &slacks.terminal.x_max]])
        .flatten();
    set && inputs
        && of_states
            .chain(&solution.x)
            .chain(&multipliers.costates)
            .all(|x| finite(x.as_slice()))
        && slacks.stages.iter().all(|stage| finite(&stage.rows))
        && slacks.largest(ConstraintGroup::TerminalSet).is_finite()
        && solution.u.iter().all(|u| finite(u.as_slice()))
}
