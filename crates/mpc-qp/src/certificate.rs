//! What proves a problem infeasible, and which constraints are to blame.
//!
//! A Farkas ray is a set of multipliers y with A'y = 0, y in the dual cone and b'y < 0 for the constraints
//! `b - A z in K`. Scaled to b'y = -1 with `r = |A'y|_inf` it proves that no feasible point has a 1-norm below 1/r:
//! feasibility would give `0 <= y'(b - A z) = -1 - z'A'y`. Its nonzero entries are the constraints in conflict.

use crate::constraints::for_each_scalar;
use crate::error::Place;
use crate::lagrangian::LagrangianGradient;
use crate::multipliers::{Multipliers, TerminalSetMultipliers};
use crate::problem::OcpQp;
use crate::softening::ConstraintGroup;
use crate::solution::Solution;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

/// The quality of a Farkas ray; the ray itself is in [`Solution::multipliers`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InfeasibilityCertificate {
    /// `|A'y|_inf` with the ray scaled to `b'y = -1`: no trajectory `(u_0, x_1, ...)` with 1-norm below `1 / residual`
    /// is feasible. Infinite if the ray proves nothing.
    pub residual: f64,
    /// Largest multiplier of the wrong sign, outside the cone, or on a soft constraint, in the same scaling.
    pub sign_violation: f64,
}

/// One line of the blame: a group with its part in the conflict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlameEntry {
    /// The kind of constraint.
    pub group: ConstraintGroup,
    /// Its part of the ray, multipliers times coefficient norms, as a fraction of the whole.
    pub share: f64,
    /// Where the group's largest part sits.
    pub worst: Place,
    /// The first place with a part that counts.
    pub first: Place,
    /// The last place with a part that counts.
    pub last: Place,
}

/// The groups of the constraints in conflict, with their stages. Fixed size: no allocation in a solve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Blame {
    entries: [Option<BlameEntry>; 5],
}

impl Blame {
    /// The entries, the largest share first.
    pub fn entries(&self) -> impl Iterator<Item = &BlameEntry> {
        self.entries.iter().flatten()
    }

    /// True if some entry has this group.
    #[must_use]
    pub fn names(&self, group: ConstraintGroup) -> bool {
        self.entries().any(|entry| entry.group == group)
    }
}

/// Part of the largest charge below which a place is not named: an interior point leaves every multiplier positive.
const LEAST_SHARE: f64 = 1e-3;

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
    let mut largest = 0.0_f64;
    for_each_scalar(problem, solution, |constraint| {
        largest = largest.max(constraint.multiplier * constraint.norm);
    });
    let mut tally = Tally::new(LEAST_SHARE * largest);
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

/// Charges of one group: its total, and the place where the most was charged.
#[derive(Default, Clone, Copy)]
struct Account {
    total: f64,
    here: Option<(Place, f64)>,
    worst: Option<(Place, f64)>,
    range: Option<(Place, Place)>,
}

impl Account {
    /// Books what was charged at the present place and moves on.
    fn close(&mut self, negligible: f64) {
        let Some((place, amount)) = self.here.take() else {
            return;
        };
        if amount <= negligible {
            return;
        }
        let first = self.range.map_or(place, |(first, _)| first);
        self.range = Some((first, place));
        if self.worst.is_none_or(|(_, most)| amount > most) {
            self.worst = Some((place, amount));
        }
    }
}

/// Running sums over the constraints; charges of one group and place arrive one after another.
struct Tally {
    product: f64,
    sign_violation: f64,
    /// Amount at one place that does not count.
    negligible: f64,
    accounts: [(ConstraintGroup, Account); 5],
}

impl Tally {
    fn new(negligible: f64) -> Self {
        let groups = [
            ConstraintGroup::InputBounds,
            ConstraintGroup::RateLimits,
            ConstraintGroup::StateBounds,
            ConstraintGroup::Rows,
            ConstraintGroup::TerminalSet,
        ];
        let accounts = groups.map(|group| (group, Account::default()));
        Self {
            product: 0.0,
            sign_violation: 0.0,
            negligible,
            accounts,
        }
    }

    fn charge(&mut self, group: ConstraintGroup, place: Place, amount: f64) {
        let Some((_, account)) = self.accounts.iter_mut().find(|(of, _)| *of == group) else {
            return;
        };
        account.total += amount;
        match &mut account.here {
            Some((at, sum)) if *at == place => *sum += amount,
            _ => {
                account.close(self.negligible);
                account.here = Some((place, amount));
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

    fn blame(self) -> Blame {
        let whole: f64 = self.accounts.iter().map(|(_, account)| account.total).sum();
        let mut entries = self.accounts.map(|(group, ref mut account)| {
            account.close(self.negligible);
            let (worst, range) = (account.worst?, account.range?);
            let share = account.total / whole;
            Some(BlameEntry {
                group,
                share,
                worst: worst.0,
                first: range.0,
                last: range.1,
            })
        });
        let share = |entry: &Option<BlameEntry>| entry.map_or(0.0, |entry| entry.share);
        entries.sort_by(|one, other| share(other).total_cmp(&share(one)));
        Blame { entries }
    }
}
