//! Which unknown is which column, which constraint is which row, and which of them exist.

use super::inequality::{Inequality, candidates};
use crate::problem::OcpQp;
use crate::softening::{Penalty, Softening};
use crate::terminal::TerminalSet;
use nalgebra::SMatrix;

/// Where any stage has a nonzero.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Masks<const NX: usize, const NU: usize> {
    pub(super) a: SMatrix<bool, NX, NX>,
    pub(super) b: SMatrix<bool, NX, NU>,
    pub(super) q: SMatrix<bool, NX, NX>,
    pub(super) r: SMatrix<bool, NU, NU>,
    pub(super) s: SMatrix<bool, NX, NU>,
    pub(super) p: SMatrix<bool, NX, NX>,
}

impl<const NX: usize, const NU: usize> Masks<NX, NU> {
    fn none() -> Self {
        let square = SMatrix::repeat(false);
        let tall = SMatrix::repeat(false);
        Self {
            a: square,
            b: tall,
            q: square,
            r: SMatrix::repeat(false),
            s: tall,
            p: square,
        }
    }

    /// Adds the nonzeros of `problem`; true if there was a new one.
    fn add(&mut self, problem: &OcpQp<NX, NU>) -> bool {
        let mut grown = false;
        for stage in problem.stages() {
            grown |= mark(&mut self.a, &stage.a);
            grown |= mark(&mut self.b, &stage.b);
            grown |= mark(&mut self.q, &stage.q);
            grown |= mark(&mut self.r, &stage.r);
            grown |= mark(&mut self.s, &stage.s);
        }
        grown | mark(&mut self.p, &problem.terminal().p)
    }

    fn covers(&self, problem: &OcpQp<NX, NU>) -> bool {
        let stages = problem.stages().iter().all(|stage| {
            within(&self.a, &stage.a)
                && within(&self.b, &stage.b)
                && within(&self.q, &stage.q)
                && within(&self.r, &stage.r)
                && within(&self.s, &stage.s)
        });
        stages && within(&self.p, &problem.terminal().p)
    }
}

fn mark<const M: usize, const N: usize>(
    mask: &mut SMatrix<bool, M, N>,
    matrix: &SMatrix<f64, M, N>,
) -> bool {
    let mut grown = false;
    for (known, value) in mask.iter_mut().zip(matrix) {
        grown |= *value != 0.0 && !*known;
        *known |= *value != 0.0;
    }
    grown
}

fn within<const M: usize, const N: usize>(
    mask: &SMatrix<bool, M, N>,
    matrix: &SMatrix<f64, M, N>,
) -> bool {
    mask.iter()
        .zip(matrix)
        .all(|(known, value)| *known || *value == 0.0)
}

/// A row of the nonnegative cone.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScalarRow {
    pub(super) inequality: Inequality,
    /// Column of its slack if soft.
    pub(super) slack: Option<usize>,
}

/// Columns and rows of the conic program of one problem structure.
#[derive(Debug, Clone)]
pub(super) struct Layout<const NX: usize, const NU: usize> {
    horizon: usize,
    row_counts: Vec<usize>,
    set_kind: &'static str,
    softening: Softening,
    /// For each candidate, whether it has a row.
    present: Vec<bool>,
    pub(super) masks: Masks<NX, NU>,
    /// The first rows of the nonnegative cone; `-t <= 0` of `priced` columns follow.
    pub(super) scalars: Vec<ScalarRow>,
    /// Columns of slacks with an L1 price.
    pub(super) priced: Vec<usize>,
    /// First column of the terminal set's own slacks (equality or ellipsoid), if soft.
    pub(super) set_slack: Option<usize>,
    columns: usize,
}

impl<const NX: usize, const NU: usize> Layout<NX, NU> {
    pub(super) fn new(problem: &OcpQp<NX, NU>) -> Self {
        let present = candidates(problem)
            .map(|candidate| candidate.right(problem) < f64::INFINITY)
            .collect();
        let mut masks = Masks::none();
        masks.add(problem);
        Self::with(problem, present, masks)
    }

    /// The layout with what `problem` has and this one lacks.
    pub(super) fn extended_to(&self, problem: &OcpQp<NX, NU>) -> Self {
        let mut extended = Self::new(problem);
        if self.same_structure(problem) {
            let present: Vec<bool> = self
                .present
                .iter()
                .zip(&extended.present)
                .map(|(old, new)| *old || *new)
                .collect();
            let mut masks = self.masks.clone();
            masks.add(problem);
            extended = Self::with(problem, present, masks);
        }
        extended
    }

    fn with(problem: &OcpQp<NX, NU>, present: Vec<bool>, masks: Masks<NX, NU>) -> Self {
        let mut layout = Self {
            horizon: problem.horizon(),
            row_counts: problem
                .stages()
                .iter()
                .map(|stage| stage.rows.len())
                .collect(),
            set_kind: problem.terminal().set.kind(),
            softening: *problem.softening(),
            masks,
            scalars: Vec::new(),
            priced: Vec::new(),
            set_slack: None,
            columns: problem.horizon() * (NX + NU),
            present,
        };
        let rows = candidates(problem)
            .zip(layout.present.clone())
            .filter(|(_, present)| *present);
        for (inequality, _) in rows {
            let slack = layout.add_slacks(problem.softening().of(inequality.group()), 1);
            layout.scalars.push(ScalarRow { inequality, slack });
        }
        let penalty = problem.softening().terminal_set;
        layout.set_slack = match (&problem.terminal().set, penalty) {
            // |violation| is the sum of its two parts, a violation of either sign has one square.
            (TerminalSet::Equality { .. }, Penalty::Exact { .. }) => {
                layout.add_slacks(penalty, 2 * NX)
            }
            (TerminalSet::Equality { .. }, _) => layout.add_slacks(penalty, NX),
            (TerminalSet::Ellipsoid { .. }, _) => layout.add_slacks(penalty, 1),
            _ => None,
        };
        layout
    }

    fn add_slacks(&mut self, penalty: Penalty, count: usize) -> Option<usize> {
        let first = self.columns;
        match penalty {
            Penalty::Hard => return None,
            Penalty::Exact { .. } => self.priced.extend(first..first + count),
            Penalty::Quadratic { .. } => {}
        }
        self.columns += count;
        Some(first)
    }

    fn same_structure(&self, problem: &OcpQp<NX, NU>) -> bool {
        let counts = problem.stages().iter().map(|stage| stage.rows.len());
        self.horizon == problem.horizon()
            && self.row_counts.iter().copied().eq(counts)
            && self.set_kind == problem.terminal().set.kind()
            && self.softening.same_kinds(problem.softening()).is_ok()
            && self.present.len() == candidates(problem).count()
    }

    /// True if the present values of `problem` fit without a rebuild.
    pub(super) fn covers(&self, problem: &OcpQp<NX, NU>) -> bool {
        self.same_structure(problem)
            && candidates(problem)
                .zip(&self.present)
                .all(|(candidate, present)| *present || candidate.right(problem) == f64::INFINITY)
            && self.masks.covers(problem)
    }

    /// First column of `u_k`, k from 0 to N - 1.
    pub(super) fn input(&self, k: usize) -> usize {
        k * (NX + NU)
    }

    /// First column of `x_k`, k from 1 to N.
    pub(super) fn state(&self, k: usize) -> usize {
        (k - 1) * (NX + NU) + NU
    }

    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// First row of the terminal equality.
    pub(super) fn terminal_equality(&self) -> usize {
        self.horizon * NX
    }

    pub(super) fn equalities(&self) -> usize {
        self.horizon * NX + if self.set_kind == "equality" { NX } else { 0 }
    }

    pub(super) fn scalar_rows(&self) -> usize {
        self.scalars.len() + self.priced.len()
    }

    pub(super) fn has_cone(&self) -> bool {
        self.set_kind == "ellipsoid"
    }

    /// First row of the second-order cone.
    pub(super) fn cone(&self) -> usize {
        self.equalities() + self.scalar_rows()
    }

    pub(super) fn rows(&self) -> usize {
        self.cone() + if self.has_cone() { NX + 1 } else { 0 }
    }
}
