//! Constraints on states, inputs and input rates, and what they become under a linear law.
//!
//! A row says `on_x x + on_u u + on_rate (u+ - u) <= bound` with bound >= 0, so that the origin is admissible. Under
//! u = Kx in closed loop A_K = A + BK it becomes one half-space of the state,
//! on_x + on_u K + on_rate K(A_K - I). That rate is between two inputs *of the law*: the step from the last input outside a terminal set to the
//! first one inside is not in it. [`RateAugmented`](crate::RateAugmented) makes the last input a state and
//! its change the input; sized there, a set covers that step too.

use crate::arithmetic::dense::{add_scaled, identity, mul};
use crate::input::{self, InputError};
use faer::{Mat, MatRef};

/// What a constraint limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum ConstraintKind {
    /// A combination of states.
    State,
    /// An input.
    Input,
    /// The change of an input from one step to the next.
    Rate,
}

/// One row `on_x x + on_u u + on_rate (u+ - u) <= bound`.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint {
    /// How reports call it.
    pub name: String,
    /// What it limits.
    pub kind: ConstraintKind,
    /// Coefficients of the state, length n.
    pub on_x: Vec<f64>,
    /// Coefficients of the input, length m.
    pub on_u: Vec<f64>,
    /// Coefficients of the change of the input, length m.
    pub on_rate: Vec<f64>,
    /// Right side, >= 0.
    pub bound: f64,
}

/// Why a constraint was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConstraintError {
    /// Wrong lengths, NaN, infinities.
    #[error("constraint {name}: {source}")]
    Input {
        /// Name of the constraint.
        name: String,
        /// What is wrong.
        source: InputError,
    },
    /// The origin violates it, so no set around the origin is admissible.
    #[error("constraint {name} excludes the origin: bound {bound}")]
    ExcludesOrigin {
        /// Name of the constraint.
        name: String,
        /// Its right side.
        bound: f64,
    },
}

/// A half-space `row x <= bound` of the state under a law.
#[derive(Debug, Clone, PartialEq)]
pub struct LawRow {
    /// Name of the constraint it came from.
    pub name: String,
    /// Kind of the constraint it came from.
    pub kind: ConstraintKind,
    /// Coefficients, length n.
    pub row: Vec<f64>,
    /// Right side, >= 0.
    pub bound: f64,
}

/// Constraints of a system with n states and m inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraints {
    pub(crate) states: usize,
    pub(crate) inputs: usize,
    pub(crate) rows: Vec<Constraint>,
}

impl Constraints {
    /// No constraint yet.
    #[must_use]
    pub fn new(states: usize, inputs: usize) -> Self {
        Self {
            states,
            inputs,
            rows: Vec::new(),
        }
    }

    /// The rows in the order in which they were added.
    #[must_use]
    pub fn rows(&self) -> &[Constraint] {
        &self.rows
    }

    /// Adds one row.
    ///
    /// # Errors
    /// [`ConstraintError`] for wrong lengths, non-finite numbers or a negative bound.
    pub fn with(mut self, constraint: Constraint) -> Result<Self, ConstraintError> {
        let parts = [
            ("on_x", &constraint.on_x, self.states),
            ("on_u", &constraint.on_u, self.inputs),
            ("on_rate", &constraint.on_rate, self.inputs),
            ("bound", &vec![constraint.bound], 1),
        ];
        for (part, values, expected) in parts {
            let row = MatRef::from_row_major_slice(values, 1, values.len());
            input::matrix(part, row, (1, expected)).map_err(|source| ConstraintError::Input {
                name: constraint.name.clone(),
                source,
            })?;
        }
        if constraint.bound < 0.0 {
            return Err(ConstraintError::ExcludesOrigin {
                name: constraint.name,
                bound: constraint.bound,
            });
        }
        self.rows.push(constraint);
        Ok(self)
    }

    /// lower <= u <= upper, entry by entry; an infinite bound is no constraint. Rows are named `u0 <= ..`, `u0 >= ..`.
    ///
    /// # Errors
    /// As [`Constraints::with`].
    pub fn with_input_box(self, lower: &[f64], upper: &[f64]) -> Result<Self, ConstraintError> {
        self.with_box(ConstraintKind::Input, lower, upper)
    }

    /// lower <= u+ - u <= upper, entry by entry, a step; named `du0 <= ..`.
    ///
    /// # Errors
    /// As [`Constraints::with`].
    pub fn with_rate_box(self, lower: &[f64], upper: &[f64]) -> Result<Self, ConstraintError> {
        self.with_box(ConstraintKind::Rate, lower, upper)
    }

    /// row x <= bound.
    ///
    /// # Errors
    /// As [`Constraints::with`].
    pub fn with_state_half_space(
        self,
        name: &str,
        row: &[f64],
        bound: f64,
    ) -> Result<Self, ConstraintError> {
        let inputs = self.inputs;
        self.with(Constraint {
            name: name.to_owned(),
            kind: ConstraintKind::State,
            on_x: row.to_vec(),
            on_u: vec![0.0; inputs],
            on_rate: vec![0.0; inputs],
            bound,
        })
    }

    fn with_box(
        self,
        kind: ConstraintKind,
        lower: &[f64],
        upper: &[f64],
    ) -> Result<Self, ConstraintError> {
        let (states, inputs) = (self.states, self.inputs);
        let symbol = if kind == ConstraintKind::Rate {
            "du"
        } else {
            "u"
        };
        for (part, found) in [("lower", lower.len()), ("upper", upper.len())] {
            if found != inputs {
                let source = InputError::Shape {
                    name: part,
                    expected: (inputs, 1),
                    found: (found, 1),
                };
                return Err(ConstraintError::Input {
                    name: format!("box of {symbol}"),
                    source,
                });
            }
        }
        let mut constraints = self;
        for i in 0..inputs {
            for (sign, limit, relation) in [(1.0, upper[i], "<="), (-1.0, lower[i], ">=")] {
                if limit == sign * f64::INFINITY {
                    continue;
                }
                let mut unit = vec![0.0; inputs];
                unit[i] = sign;
                let (on_u, on_rate) = if kind == ConstraintKind::Rate {
                    (vec![0.0; inputs], unit)
                } else {
                    (unit, vec![0.0; inputs])
                };
                let name = format!("{symbol}{i} {relation} {limit}");
                // Adding zero turns the -0 of a zero lower limit into a plain zero.
                let bound = sign * limit + 0.0;
                constraints = constraints.with(Constraint {
                    name,
                    kind,
                    on_x: vec![0.0; states],
                    on_u,
                    on_rate,
                    bound,
                })?;
            }
        }
        Ok(constraints)
    }

    /// The half-spaces of the state under u = Kx in x+ = Ax + Bu.
    ///
    /// # Errors
    /// [`InputError`] where A, B, K do not fit the constraints.
    pub fn under_law(
        &self,
        a: MatRef<'_, f64>,
        b: MatRef<'_, f64>,
        k: MatRef<'_, f64>,
    ) -> Result<Vec<LawRow>, InputError> {
        let (n, m) = (self.states, self.inputs);
        let a = input::matrix("A", a, (n, n))?;
        let b = input::matrix("B", b, (n, m))?;
        let k = input::matrix("K", k, (m, n))?;
        let step = add_scaled(&add_scaled(&a, 1.0, &mul(&b, &k)), -1.0, &identity(n));
        Ok(self.half_spaces(&k, &mul(&k, &step)))
    }

    /// Rows for u = `law` x and u+ - u = `change` x.
    pub(crate) fn half_spaces(&self, law: &Mat<f64>, change: &Mat<f64>) -> Vec<LawRow> {
        let combine = |c: &Constraint, j: usize| {
            (0..self.inputs).fold(c.on_x[j], |sum, i| {
                sum + c.on_u[i] * law[(i, j)] + c.on_rate[i] * change[(i, j)]
            })
        };
        self.rows
            .iter()
            .map(|c| LawRow {
                name: c.name.clone(),
                kind: c.kind,
                row: (0..self.states).map(|j| combine(c, j)).collect(),
                bound: c.bound,
            })
            .collect()
    }
}
