//! What a proof of infeasibility says: how good it is, and which constraints it holds together.

use crate::error::Place;
use crate::softening::ConstraintGroup;

/// The quality of a Farkas ray; the ray itself is in [`Solution::multipliers`](crate::Solution::multipliers).
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
    /// Its part of the ray: the sum of its weights as a fraction of all groups' sum. Independent of units.
    pub share: f64,
    /// Where the group's largest weight sits.
    pub worst: Place,
    /// The first place with a weight that counts.
    pub first: Place,
    /// The last place with a weight that counts.
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

/// Weights of one group: their sum, the largest with its place, and the range of places.
#[derive(Default, Clone, Copy)]
struct Account {
    total: f64,
    worst: Option<(Place, f64)>,
    range: Option<(Place, Place)>,
}

/// The accounts of all groups, in the order of [`Tally::GROUPS`].
#[derive(Default)]
pub(crate) struct Tally {
    accounts: [Account; 5],
}

impl Tally {
    const GROUPS: [ConstraintGroup; 5] = [
        ConstraintGroup::InputBounds,
        ConstraintGroup::RateLimits,
        ConstraintGroup::StateBounds,
        ConstraintGroup::Rows,
        ConstraintGroup::TerminalSet,
    ];

    /// Books a weight; places come in their order.
    pub(crate) fn charge(&mut self, group: ConstraintGroup, place: Place, weight: f64) {
        if weight == 0.0 {
            return;
        }
        for (of, account) in Self::GROUPS.iter().zip(&mut self.accounts) {
            if *of == group {
                account.total += weight;
                account.range = Some((account.range.map_or(place, |(first, _)| first), place));
                if account.worst.is_none_or(|(_, most)| weight > most) {
                    account.worst = Some((place, weight));
                }
            }
        }
    }

    /// The accounts as shares of their sum.
    pub(crate) fn blame(self) -> Blame {
        let whole: f64 = self.accounts.iter().map(|account| account.total).sum();
        let mut entries = [None; 5];
        for ((entry, account), group) in entries.iter_mut().zip(self.accounts).zip(Self::GROUPS) {
            *entry = account
                .worst
                .zip(account.range)
                .map(|((worst, _), (first, last))| BlameEntry {
                    group,
                    share: account.total / whole,
                    worst,
                    first,
                    last,
                });
        }
        let share = |entry: &Option<BlameEntry>| entry.map_or(0.0, |entry| entry.share);
        entries.sort_by(|one, other| share(other).total_cmp(&share(one)));
        Blame { entries }
    }
}
