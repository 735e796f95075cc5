//! The optimal control problem: validated when built, refilled in place.
//!
//! Structure (horizon, row counts, kind of terminal set, which groups are soft) is fixed at construction; every number may
//! change afterwards through the `set_*` methods, which check first and then overwrite without allocating. A refill that
//! is refused leaves the problem as it was, so a problem that exists is always valid.

use crate::error::{Place, ProblemError};
use crate::softening::Softening;
use crate::stage::Stage;
use crate::terminal::{Terminal, TerminalSet};
use crate::validation::finite;
use nalgebra::{SMatrix, SVector};

/// A linear time-varying optimal control problem with `NX` states, `NU` inputs and N stages:
///
/// ```text
/// min   sum_{k<N} 1/2 x_k'Q_k x_k + x_k'S_k u_k + 1/2 u_k'R_k u_k + q_k'x_k + r_k'u_k  +  1/2 x_N'P x_N + p'x_N
/// s.t.  x_{k+1} = A_k x_k + B_k u_k + c_k,   x_0 given
///       u_min <= u_k <= u_max,   du_min <= u_k - u_{k-1} <= du_max,   u_{-1} given
///       x_min <= x_k <= x_max  (k >= 1),   G_k x_k + H_k u_k <= g_k,   x_N in the terminal set
/// ```
///
/// An input at the end of the horizon as well (u_0..u_N with N + 1 inputs) is written with one more stage whose dynamics is
/// the identity (A = I, B = 0): `x_{N+1} = x_N` carries the terminal cost and set.
///
/// Upper bounds of 1e20 and more, and lower bounds of -1e20 and less, are absent bounds in public data; they are kept as infinite.
#[derive(Debug, Clone, PartialEq)]
pub struct OcpQp<const NX: usize, const NU: usize> {
    pub(crate) initial_state: SVector<f64, NX>,
    pub(crate) previous_input: SVector<f64, NU>,
    pub(crate) stages: Vec<Stage<NX, NU>>,
    pub(crate) terminal: Terminal<NX>,
    pub(crate) softening: Softening,
    /// L with `shape = L L'`; zero unless the terminal set is an ellipsoid.
    pub(crate) shape_factor: SMatrix<f64, NX, NX>,
}

/// The terminal ellipsoid as the second-order cone `|L'(x - center)| <= radius`.
#[derive(Debug, Clone, Copy)]
pub struct TerminalCone<'a, const NX: usize> {
    /// Lower triangular L with `shape = L L'`.
    pub factor: &'a SMatrix<f64, NX, NX>,
    /// Center of the ellipsoid.
    pub center: &'a SVector<f64, NX>,
    /// Square root of the level.
    pub radius: f64,
}

impl<const NX: usize> TerminalCone<'_, NX> {
    /// `L'(x - center)`, the vector whose norm is bounded.
    #[must_use]
    pub fn offset(&self, x: &SVector<f64, NX>) -> SVector<f64, NX> {
        self.factor.tr_mul(&(x - self.center))
    }
}

impl<const NX: usize, const NU: usize> OcpQp<NX, NU> {
    /// A problem with all constraints hard, from `x_0` and its stages, zero input applied last.
    ///
    /// # Errors
    /// [`ProblemError`] names the stage and the field of the first datum that is not finite, not symmetric, not
    /// positive semidefinite, or a crossed pair of bounds.
    pub fn new(
        initial_state: SVector<f64, NX>,
        mut stages: Vec<Stage<NX, NU>>,
        mut terminal: Terminal<NX>,
    ) -> Result<Self, ProblemError> {
        const {
            assert!(
                NX > 0 && NU > 0,
                "a problem has at least one state and one input"
            );
        };
        if stages.is_empty() {
            return Err(ProblemError::EmptyHorizon);
        }
        finite(Place::Initial, "initial_state", &initial_state)?;
        for (k, stage) in stages.iter().enumerate() {
            stage.validate(Place::Stage(k), None)?;
        }
        let shape_factor = terminal.validate()?;
        stages.iter_mut().for_each(Stage::normalise);
        terminal.normalise();
        let (previous_input, softening) = (SVector::zeros(), Softening::default());
        Ok(Self {
            initial_state,
            previous_input,
            stages,
            terminal,
            softening,
            shape_factor,
        })
    }

    /// The same problem with the groups of `softening` soft.
    ///
    /// # Errors
    /// [`ProblemError::PenaltyWeight`] unless every weight is positive and finite.
    pub fn with_softening(mut self, softening: Softening) -> Result<Self, ProblemError> {
        softening.validate()?;
        self.softening = softening;
        Ok(self)
    }

    /// Sets `x_0`.
    ///
    /// # Errors
    /// [`ProblemError::NotFinite`].
    pub fn set_initial_state(
        &mut self,
        initial_state: &SVector<f64, NX>,
    ) -> Result<(), ProblemError> {
        finite(Place::Initial, "initial_state", initial_state)?;
        self.initial_state = *initial_state;
        Ok(())
    }

    /// Sets `u_{-1}`, the input applied last, against which stage 0 limits its rate.
    ///
    /// # Errors
    /// [`ProblemError::NotFinite`].
    pub fn set_previous_input(
        &mut self,
        previous_input: &SVector<f64, NU>,
    ) -> Result<(), ProblemError> {
        finite(Place::Initial, "previous_input", previous_input)?;
        self.previous_input = *previous_input;
        Ok(())
    }

    /// Replaces the values of stage `k`.
    ///
    /// # Errors
    /// As [`Self::new`], and [`ProblemError::StageIndex`], [`ProblemError::RowCount`].
    pub fn set_stage(&mut self, k: usize, stage: &Stage<NX, NU>) -> Result<(), ProblemError> {
        let expected = self.stages.len();
        let current = self
            .stages
            .get_mut(k)
            .ok_or(ProblemError::StageIndex { expected, found: k })?;
        let (rows, found) = (current.rows.len(), stage.rows.len());
        if rows != found {
            return Err(ProblemError::RowCount {
                place: Place::Stage(k),
                expected: rows,
                found,
            });
        }
        stage.validate(Place::Stage(k), Some(current))?;
        current.overwrite(stage);
        Ok(())
    }

    /// Replaces the values of the terminal cost, bounds and set.
    ///
    /// # Errors
    /// As [`Self::new`], and [`ProblemError::TerminalSetKind`], [`ProblemError::RowCount`].
    pub fn set_terminal(&mut self, terminal: &Terminal<NX>) -> Result<(), ProblemError> {
        self.terminal.same_structure(terminal)?;
        self.shape_factor = terminal.validate()?;
        self.terminal.overwrite(terminal);
        Ok(())
    }

    /// Replaces the penalty weights.
    ///
    /// # Errors
    /// [`ProblemError::PenaltyWeight`], [`ProblemError::PenaltyKind`].
    pub fn set_softening(&mut self, softening: Softening) -> Result<(), ProblemError> {
        self.softening.same_kinds(&softening)?;
        softening.validate()?;
        self.softening = softening;
        Ok(())
    }

    /// Number of stages N, equal to the number of inputs.
    #[must_use]
    pub fn horizon(&self) -> usize {
        self.stages.len()
    }

    /// The given state `x_0`.
    #[must_use]
    pub fn initial_state(&self) -> &SVector<f64, NX> {
        &self.initial_state
    }

    /// The input applied last, `u_{-1}`.
    #[must_use]
    pub fn previous_input(&self) -> &SVector<f64, NU> {
        &self.previous_input
    }

    /// The stages 0 to N - 1.
    #[must_use]
    pub fn stages(&self) -> &[Stage<NX, NU>] {
        &self.stages
    }

    /// Cost, bounds and set at `x_N`.
    #[must_use]
    pub fn terminal(&self) -> &Terminal<NX> {
        &self.terminal
    }

    /// Which groups are soft, and at what price.
    #[must_use]
    pub fn softening(&self) -> &Softening {
        &self.softening
    }

    /// The terminal ellipsoid as a cone, if that is the terminal set.
    #[must_use]
    pub fn terminal_cone(&self) -> Option<TerminalCone<'_, NX>> {
        match &self.terminal.set {
            TerminalSet::Ellipsoid { center, level, .. } => Some(TerminalCone {
                factor: &self.shape_factor,
                center,
                radius: level.sqrt(),
            }),
            _ => None,
        }
    }

    /// The states that `inputs` lead to, from `x_0` on. Writes `x_0..=x_n` for n inputs (at most N).
    pub fn rollout(&self, inputs: &[SVector<f64, NU>], states: &mut Vec<SVector<f64, NX>>) {
        states.clear();
        states.push(self.initial_state);
        let mut x = self.initial_state;
        for (stage, u) in self.stages.iter().zip(inputs) {
            x = stage.successor(&x, u);
            states.push(x);
        }
    }
}
