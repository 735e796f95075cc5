//! What proves a problem infeasible, and which constraints are to blame.
//!
//! A Farkas ray is a set of multipliers y with A'y = 0, y in the dual cone and b'y < 0 for the constraints
//! `b - A z in K`. Scaled to b'y = -1 with `r = |A'y|_inf` it proves that no feasible point has a 1-norm below 1/r:
//! feasibility would give `0 <= y'(b - A z) = -1 - z'A'y`. Its nonzero entries are the constraints in conflict.

use crate::constraints::for_each_scalar;
use crate::error::Place;
use crate::multipliers::TerminalSetMultipliers;
use crate::problem::OcpQp;
use crate::residuals::LagrangianGradient;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;
use crate::terminal::TerminalSet;

/// The quality of a Farkas ray; the ray itself is in [`Solution::multipliers`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InfeasibilityCertificate {
    /// `|A'y|_inf` with the ray scaled to `b'y = -1`: no trajectory `(u_0, x_1, ...)` with 1-norm below `1 / residual`
    /// is feasible. Infinite if the ray proves nothing.
    pub residual: f64,
    /// Largest multiplier of the wrong sign, outside the cone, or on a soft constraint, in the same scaling.
    pub sign_violation: f64,
}

/// One line of the blame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlameEntry {
    /// The kind of constraint.
    pub group: ConstraintGroup,
    /// Where it sits.
    pub place: Place,
    /// Its part of the ray, multipliers times coefficient norms, as a fraction of the whole.
    pub share: f64,
}

/// Groups and stages of the constraints in conflict, the largest share first. Fixed size: no allocation in a solve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Blame {
    entries: [Option<BlameEntry>; Self::LENGTH],
}

impl Blame {
    /// How many entries are kept.
    pub const LENGTH: usize = 8;

    /// The entries, the largest share first.
    pub fn entries(&self) -> impl Iterator<Item = &BlameEntry> {
        self.entries.iter().flatten()
    }

    /// True if some entry has this group.
    #[must_use]
    pub fn names(&self, group: ConstraintGroup) -> bool {
        self.entries().any(|entry| entry.group == group)
    }

    fn insert(&mut self, mut entry: BlameEntry) {
        for slot in &mut self.entries {
            match slot {
                Some(kept) if kept.share >= entry.share => {}
                Some(kept) => std::mem::swap(kept, &mut entry),
                None => {
                    *slot = Some(entry);
                    return;
                }
            }
        }
    }
}

/// Share below which a constraint is not named: rounding in a ray of 1e-8.
const LEAST_SHARE: f64 = 1e-4;

/// Judges the ray in `solution.multipliers`; neither the states nor the costs are used.
#[must_use]
pub fn examine_certificate<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &Solution<NX, NU>,
) -> (InfeasibilityCertificate, Blame) {
    let gradient = LagrangianGradient {
        problem,
        solution,
        with_cost: false,
    };
    let adjoint = (0..problem.horizon())
        .map(|k| {
            gradient
                .input(k)
                .sum
                .amax()
                .max(gradient.state(k + 1).sum.amax())
        })
        .fold(0.0, f64::max);
    let mut tally = Tally::default();
    for (stage, costate) in problem.stages().iter().zip(&solution.multipliers.costates) {
        tally.product -= costate.dot(&stage.c);
    }
    let first = &problem.stages()[0];
    tally.product -= solution.multipliers.costates[0].dot(&(first.a * problem.initial_state()));
    for_each_scalar(problem, solution, |constraint| {
        let (group, place) = (constraint.group, constraint.place);
        let multiplier = constraint.multiplier;
        let allowed = constraint.right < f64::INFINITY && !problem.softening().of(group).is_soft();
        tally.sign_violation = tally.sign_violation.max(if allowed {
            -multiplier
        } else {
            multiplier.abs()
        });
        if allowed {
            tally.product += constraint.right * multiplier;
            tally.charge(group, place, multiplier.max(0.0) * constraint.norm);
        }
    });
    tally.terminal_set(problem, solution);
    let separation = -tally.product;
    let certificate = if separation > 0.0 && adjoint.is_finite() {
        InfeasibilityCertificate {
            residual: adjoint / separation,
            sign_violation: tally.sign_violation / separation,
        }
    } else {
        InfeasibilityCertificate {
            residual: f64::INFINITY,
            sign_violation: f64::INFINITY,
        }
    };
    (certificate, tally.blame())
}

/// Running sums over the constraints; charges of one group and stage arrive one after another.
#[derive(Default)]
struct Tally {
    product: f64,
    sign_violation: f64,
    total: f64,
    open: [Option<BlameEntry>; 5],
    ranking: Blame,
}

impl Tally {
    fn charge(&mut self, group: ConstraintGroup, place: Place, amount: f64) {
        self.total += amount;
        let slot = &mut self.open[group as usize];
        match slot {
            Some(entry) if entry.place == place => entry.share += amount,
            _ => {
                if let Some(finished) = slot.replace(BlameEntry {
                    group,
                    place,
                    share: amount,
                }) {
                    self.ranking.insert(finished);
                }
            }
        }
    }

    fn terminal_set<const NX: usize, const NU: usize>(
        &mut self,
        problem: &OcpQp<NX, NU>,
        solution: &Solution<NX, NU>,
    ) {
        let (group, place) = (ConstraintGroup::TerminalSet, Place::Terminal);
        let soft = problem.softening().terminal_set.is_soft();
        match (&problem.terminal().set, &solution.multipliers.terminal.set) {
            (TerminalSet::Equality { target }, TerminalSetMultipliers::Equality(multiplier)) => {
                self.sign_violation =
                    self.sign_violation
                        .max(if soft { multiplier.amax() } else { 0.0 });
                self.product += multiplier.dot(target);
                self.charge(group, place, multiplier.lp_norm(1));
            }
            (
                TerminalSet::Ellipsoid { .. },
                TerminalSetMultipliers::Ellipsoid { radius, offset },
            ) => {
                let Some(cone) = problem.terminal_cone() else {
                    return;
                };
                let beyond = if soft {
                    radius.abs()
                } else {
                    offset.norm() - radius
                };
                self.sign_violation = self.sign_violation.max(beyond);
                let force = cone.factor * offset;
                self.product += cone.radius * radius - force.dot(cone.center);
                self.charge(group, place, force.norm());
            }
            _ => {}
        }
    }

    fn blame(mut self) -> Blame {
        for entry in self.open.into_iter().flatten() {
            self.ranking.insert(entry);
        }
        let total = self.total;
        for slot in &mut self.ranking.entries {
            *slot = slot.filter(|entry| entry.share > LEAST_SHARE * total);
            if let Some(entry) = slot {
                entry.share /= total;
            }
        }
        self.ranking
    }
}
