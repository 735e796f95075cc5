//! Terminal weight, law and level at every step of a path, with the certificate of the whole.

use super::TerminalError;
use super::pair::{Pair, Regulation, dense, dynamic, limits_of};
use lqr::{
    BackwardChain, Certificate, ChainClaim, Check, Constraint, ConstraintKind, Constraints,
    Ellipsoid, InputError, LawRow, PeriodicSolution, TerminalClaim,
};
use nalgebra::DMatrix;

/// Longest path for which a chain is made: its memory and time grow with the path.
pub(super) const LONGEST_CHAIN: usize = 5_000;

/// Share of a limit that is rounding.
const ROUNDING: f64 = 1e-9;

/// Terminal weight, law and level at the steps of the path.
#[derive(Debug, Clone)]
pub(crate) struct Ingredients {
    p: Vec<DMatrix<f64>>,
    /// Gains of u = Kx; fewer than weights by the last one of a chain.
    k: Vec<DMatrix<f64>>,
    /// Levels; `None` for a cost without a set.
    levels: Option<Vec<f64>>,
    periodic: bool,
    /// Last step of the path for which the levels hold.
    last_step: usize,
    pub(crate) certificate: Option<Certificate>,
}

/// What holds at the end of a horizon.
#[derive(Debug, Clone, Copy)]
pub(crate) struct End<'a> {
    /// Weight of x'Px.
    pub(crate) p: &'a DMatrix<f64>,
    /// Gain of the law that takes over, where there is one.
    pub(crate) k: Option<&'a DMatrix<f64>>,
    /// Level of the set x'Px <= level, where there is one.
    pub(crate) level: Option<f64>,
}

impl Ingredients {
    /// The stage weights at the end, no set.
    pub(crate) fn none(weight: DMatrix<f64>) -> Self {
        Self {
            p: vec![weight],
            k: Vec::new(),
            levels: None,
            periodic: false,
            last_step: 0,
            certificate: None,
        }
    }

    /// One Riccati solution with its largest admissible level set.
    pub(crate) fn stationary(pair: &Pair, limits: Constraints) -> Result<Self, TerminalError> {
        let regulation = Regulation::of(pair)?;
        let solution = regulation.solve()?;
        let limits = limits_of(pair, limits);
        let claim = TerminalClaim::largest(&regulation.dare(), &solution, limits)?;
        // A set without interior would make the controller's problem infeasible.
        let level = (claim.level > 0.0).then(|| vec![claim.level]);
        Ok(Self {
            p: vec![dynamic(&claim.cost)],
            k: vec![dynamic(&claim.k)],
            levels: level,
            periodic: false,
            last_step: usize::MAX,
            certificate: Some(claim.certify()),
        })
    }

    /// The chain back from the end of the path, where the state costs `end`.
    pub(crate) fn chain(
        pairs: &[Pair],
        limits: Constraints,
        end: &DMatrix<f64>,
    ) -> Result<Self, TerminalError> {
        let regulations = Regulation::of_all(pairs)?;
        let stages: Vec<_> = regulations.iter().map(Regulation::stage).collect();
        let chain = BackwardChain::solve(&stages, dense(end).as_ref())?;
        let limits = limits_of(first(pairs)?, limits);
        // After the last stage no law follows that could break a limit of inputs.
        let of_state: Vec<_> = limits.rows().iter().filter_map(state_row).collect();
        let last = Ellipsoid::largest(dense(end).as_ref(), &of_state)?;
        let claim = ChainClaim::largest(&stages, &chain, limits, last.level)?;
        let mut ingredients = Self::of_claim(claim, false);
        if let Some(certificate) = &mut ingredients.certificate {
            let checks = at_the_end(&last, &of_state, pairs.len())?;
            certificate.checks.extend(checks);
        }
        Ok(ingredients)
    }

    /// The periodic solution, with one level for the whole period.
    pub(crate) fn periodic(pairs: &[Pair], limits: Constraints) -> Result<Self, TerminalError> {
        let regulations = Regulation::of_all(pairs)?;
        let stages: Vec<_> = regulations.iter().map(Regulation::stage).collect();
        let PeriodicSolution { mut p, k, .. } = PeriodicSolution::solve(&stages)?;
        p.push(first(&p)?.clone());
        let limits = limits_of(first(pairs)?, limits);
        let mut claim =
            ChainClaim::largest(&stages, &BackwardChain { p, k }, limits, f64::INFINITY)?;
        let least = claim.levels.iter().copied().fold(f64::INFINITY, f64::min);
        claim.levels.fill(least);
        Ok(Self::of_claim(claim, true))
    }

    fn of_claim(mut claim: ChainClaim, periodic: bool) -> Self {
        // Nothing limits the last set of a chain but its own stage; an infinite level is no level.
        let largest = claim
            .levels
            .iter()
            .copied()
            .filter(|c| c.is_finite())
            .fold(0.0, f64::max);
        for level in &mut claim.levels {
            *level = level.min(largest);
        }
        let usable = claim.levels.iter().all(|level| *level > 0.0);
        Self {
            certificate: Some(claim.certify()),
            p: claim.p.iter().map(dynamic).collect(),
            k: claim.k.iter().map(dynamic).collect(),
            levels: usable.then_some(claim.levels),
            periodic,
            last_step: usize::MAX,
        }
    }

    /// Whether there is a set, and not only a cost.
    pub(crate) fn has_sets(&self) -> bool {
        self.levels.is_some()
    }

    /// The same, with levels up to a step only: past the end of the path the reference is another.
    pub(crate) fn until(self, last_step: usize) -> Self {
        Self { last_step, ..self }
    }

    /// Scales every level; nested levels stay nested. Zero leaves the cost without a set.
    pub(crate) fn shrink_levels(&mut self, factor: f64) {
        match &mut self.levels {
            Some(levels) if factor > 0.0 => levels.iter_mut().for_each(|level| *level *= factor),
            levels => *levels = None,
        }
    }

    /// What holds for a horizon that ends at `step` of the path.
    pub(crate) fn at(&self, step: usize) -> End<'_> {
        let last = self.p.len() - 1;
        let index = match self.periodic {
            true => step % last.max(1),
            false => step.min(last),
        };
        let levels = self.levels.as_ref().filter(|_| step <= self.last_step);
        End {
            p: &self.p[index],
            // After the last set of a chain its own gain is taken to go on.
            k: self.k.get(index).or(self.k.last()),
            level: levels.map(|levels| levels[index]),
        }
    }
}

/// A constraint that needs no law to be a half-space of the state.
fn state_row(constraint: &Constraint) -> Option<LawRow> {
    (constraint.kind == ConstraintKind::State).then(|| LawRow {
        name: constraint.name.clone(),
        kind: constraint.kind,
        row: constraint.on_x.clone(),
        bound: constraint.bound,
    })
}

/// What the certificate of a chain, which checks the limits under each of its laws, does not say of the last set.
fn at_the_end(set: &Ellipsoid, rows: &[LawRow], last: usize) -> Result<Vec<Check>, InputError> {
    let check = |row: &LawRow| {
        let margin = 1.0 - set.support(&row.row)? / row.bound;
        Ok(Check {
            name: format!("{} at {last}", row.name),
            condition: "f x <= h in the last set".to_owned(),
            holds: margin >= -ROUNDING,
            margin,
            tolerance: ROUNDING,
            witness: None,
        })
    };
    rows.iter().map(check).collect()
}

fn first<T>(items: &[T]) -> Result<&T, TerminalError> {
    items.first().ok_or(TerminalError::NoStep)
}
