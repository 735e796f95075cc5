//! Backward Riccati chains over a finite horizon.
//!
//! P_T is given; P_i is the stage cost under K_i plus (A_i + B_iK_i)'P_{i+1}(A_i + B_iK_i), K_i the minimiser for P_{i+1}: the Joseph form,
//! symmetric by construction. V(i, x) = x'P_i x then falls by exactly the stage cost along the law, which no sequence
//! of Riccati solutions frozen at each i provides.

use crate::arithmetic::definiteness::indefinite_cost;
use crate::arithmetic::dense::norm;
use crate::chain::error::ChainError;
use crate::input::{self, InputError};
use crate::riccati::problem::Problem;
use faer::{Mat, MatRef};

/// One stage: x_{i+1} = A x_i + B u_i at the cost x'Qx + 2x'Su + u'Ru. Shapes n x n, n x m, n x n, m x m; m may change from stage to stage.
#[derive(Debug, Clone, Copy)]
pub struct Stage<'a> {
    /// State transition, n x n.
    pub a: MatRef<'a, f64>,
    /// Input matrix, n x m.
    pub b: MatRef<'a, f64>,
    /// State weight, n x n, positive semidefinite.
    pub q: MatRef<'a, f64>,
    /// Input weight, m x m, positive semidefinite.
    pub r: MatRef<'a, f64>,
    /// Cross term, n x m, with [Q S; S' R] positive semidefinite; none is zero.
    pub s: Option<MatRef<'a, f64>>,
}

impl<'a> Stage<'a> {
    /// A stage without cross term.
    #[must_use]
    pub fn new(
        a: MatRef<'a, f64>,
        b: MatRef<'a, f64>,
        q: MatRef<'a, f64>,
        r: MatRef<'a, f64>,
    ) -> Self {
        let s = None;
        Self { a, b, q, r, s }
    }

    /// Adds 2x'Su to the stage cost, S n x m.
    #[must_use]
    pub fn with_cross(mut self, s: MatRef<'a, f64>) -> Self {
        self.s = Some(s);
        self
    }
}

/// P_0..P_T and K_0..K_{T-1} of a finite horizon.
#[derive(Debug, Clone)]
pub struct BackwardChain {
    /// Cost-to-go matrices, T + 1 of n x n; the last is the terminal weight.
    pub p: Vec<Mat<f64>>,
    /// Gains of u_i = K_i x_i, T of m x n.
    pub k: Vec<Mat<f64>>,
}

pub(crate) fn validated(stages: &[Stage<'_>]) -> Result<Vec<Problem>, ChainError> {
    if stages.is_empty() {
        return Err(ChainError::Input {
            stage: 0,
            source: InputError::Empty { name: "stages" },
        });
    }
    let n = stages[0].a.nrows();
    let mut problems = Vec::with_capacity(stages.len());
    for (stage, data) in stages.iter().enumerate() {
        let problem = Problem::read(data.a, data.b, data.q, data.r, data.s)
            .map_err(|source| ChainError::Input { stage, source })?;
        let found = (problem.states(), problem.states());
        if found != (n, n) {
            let source = InputError::Shape {
                name: "A",
                expected: (n, n),
                found,
            };
            return Err(ChainError::Input { stage, source });
        }
        if let Some((name, eigenvalue, _)) = problem.indefinite_weight() {
            return Err(ChainError::IndefiniteWeight {
                stage,
                name,
                eigenvalue,
            });
        }
        problems.push(problem);
    }
    Ok(problems)
}

pub(crate) fn backward(
    problems: &[Problem],
    terminal: Mat<f64>,
) -> Result<BackwardChain, ChainError> {
    let mut p = vec![terminal];
    let mut k = Vec::with_capacity(problems.len());
    for (stage, problem) in problems.iter().enumerate().rev() {
        let step = problem
            .backward(&p[p.len() - 1])
            .filter(|step| norm(&step.before).is_finite())
            .ok_or(ChainError::SingularInputHessian { stage })?;
        p.push(step.before);
        k.push(step.k);
    }
    p.reverse();
    k.reverse();
    Ok(BackwardChain { p, k })
}

impl BackwardChain {
    /// Runs the chain back from `terminal` (n x n, positive semidefinite).
    ///
    /// # Errors
    /// [`ChainError`], naming the stage.
    pub fn solve(stages: &[Stage<'_>], terminal: MatRef<'_, f64>) -> Result<Self, ChainError> {
        let problems = validated(stages)?;
        let stage = stages.len();
        let terminal = input::symmetric("P", terminal, problems[0].states())
            .map_err(|source| ChainError::Input { stage, source })?;
        if let Some((eigenvalue, _)) = indefinite_cost(&terminal) {
            return Err(ChainError::IndefiniteWeight {
                stage,
                name: "P",
                eigenvalue,
            });
        }
        backward(&problems, terminal)
    }
}
