//! From a path to its terminal ingredients: the choice asked for, or the strongest that can be had.

use super::deviation_box::DeviationBox;
use super::ingredients::{Ingredients, LONGEST_CHAIN};
use super::pair::Pair;
use super::{RefusedChoice, TerminalChoice, TerminalError};
use crate::limits::InputLimits;
use lqr::{ConstraintError, Constraints};
use nalgebra::{DMatrix, Matrix2};
use needle_model::{ControllabilityReport, Input, Needle, ReferencePath};

/// Relative difference below which two inputs of a reference are the same: they come from files and arithmetic.
const SAME_INPUT: f64 = 1e-9;

/// Miss of a step, mm and rad, up to which a reference counts as executed by the needle: the rounding of a path file.
const SAME_POSE: f64 = 1e-4;

/// Every coordinate of the error.
pub(crate) const ALL_COORDINATES: &[usize] = &[0, 1, 2, 3, 4, 5];

/// What a straight needle can correct.
pub(crate) const DEPTH_AND_ROLL: &[usize] = &[2, 5];

/// Ingredients with the choice that they belong to; never [`TerminalChoice::Auto`].
#[derive(Debug, Clone)]
pub(crate) struct Chosen {
    pub(crate) choice: TerminalChoice,
    pub(crate) ingredients: Ingredients,
    /// What [`TerminalChoice::Auto`] passed over.
    pub(crate) refused: Vec<RefusedChoice>,
}

/// What terminal ingredients are made from.
#[derive(Debug, Clone)]
pub(crate) struct TerminalProblem<'a> {
    pub(crate) needle: Needle,
    pub(crate) path: &'a ReferencePath,
    pub(crate) dt_s: f64,
    pub(crate) limits: InputLimits,
    /// Half-width of the corridor, which holds the set.
    pub(crate) corridor_mm: Option<f64>,
    /// Coordinates of the error that the model keeps.
    pub(crate) coordinates: &'static [usize],
    /// Weight of the error.
    pub(crate) q: DMatrix<f64>,
    /// Weight of the input deviation.
    pub(crate) r: Matrix2<f64>,
    /// Weight of its change; with it the last deviation is a state.
    pub(crate) r_rate: Option<Matrix2<f64>>,
    /// Weight of the state at the end of the path, and of every horizon without ingredients.
    pub(crate) end: DMatrix<f64>,
}

impl TerminalProblem<'_> {
    /// Ingredients along the path. [`TerminalChoice::Auto`] takes the strongest that can be had and keeps why the others cannot.
    pub(crate) fn choose(&self, wanted: TerminalChoice) -> Result<Chosen, TerminalError> {
        let curvature_per_mm = self.needle.curvature_per_mm();
        if self.is_straight() && curvature_per_mm != 0.0 {
            return Err(TerminalError::Bent { curvature_per_mm });
        }
        let attempts: &[TerminalChoice] = match wanted {
            TerminalChoice::None => return Ok(self.without()),
            TerminalChoice::Auto if self.is_straight() => &[TerminalChoice::HelixDare],
            TerminalChoice::Auto => &[TerminalChoice::HelixDare, TerminalChoice::RiccatiChain],
            ref other => std::slice::from_ref(other),
        };
        let mut refused = Vec::new();
        for &choice in attempts {
            match self.attempt(choice) {
                Ok(ingredients) => {
                    let chosen = Chosen {
                        choice,
                        ingredients,
                        refused,
                    };
                    return chosen.with_interior(wanted, || self.room().exhausted());
                }
                Err(reason) if wanted != TerminalChoice::Auto => return Err(reason),
                Err(reason) => refused.push(RefusedChoice { choice, reason }),
            }
        }
        Ok(Chosen {
            refused,
            ..self.without()
        })
    }

    fn room(&self) -> DeviationBox {
        DeviationBox::of(self.path.inputs(), &self.limits, self.dt_s)
    }

    /// Whether the model is that of a straight needle: one pair at every step, whatever the inputs.
    fn is_straight(&self) -> bool {
        self.coordinates == DEPTH_AND_ROLL
    }

    /// The weights at the end and no set.
    pub(crate) fn without(&self) -> Chosen {
        Chosen {
            choice: TerminalChoice::None,
            ingredients: Ingredients::none(self.end.clone()),
            refused: Vec::new(),
        }
    }

    /// The same where every choice is refused for one reason.
    pub(crate) fn refusing(&self, reason: TerminalError) -> Chosen {
        let refused = |choice| RefusedChoice {
            choice,
            reason: reason.clone(),
        };
        Chosen {
            refused: vec![
                refused(TerminalChoice::HelixDare),
                refused(TerminalChoice::RiccatiChain),
            ],
            ..self.without()
        }
    }

    fn attempt(&self, choice: TerminalChoice) -> Result<Ingredients, TerminalError> {
        self.executable()?;
        let inputs = self.path.inputs();
        let mut limits = self.room().constraints(self.coordinates.len())?;
        if let Some(corridor_mm) = self.corridor_mm {
            limits = within_corridor(limits, self.coordinates.len(), corridor_mm)?;
        }
        let pairs = |inputs: &[Input]| -> Result<Vec<Pair>, TerminalError> {
            inputs.iter().map(|&input| self.pair(input)).collect()
        };
        let ingredients = match choice {
            _ if self.is_straight() => Ingredients::stationary(&self.pair(Input::ZERO)?, limits)?,
            TerminalChoice::HelixDare => self.stationary(limits)?,
            TerminalChoice::Periodic { period } => {
                repeats(inputs, period)?;
                let of_period = pairs(inputs.get(..period).ok_or(TerminalError::NoStep)?)?;
                Ingredients::periodic(&of_period, limits)?
            }
            _ if inputs.len() > LONGEST_CHAIN => {
                return Err(TerminalError::TooLong {
                    steps: inputs.len(),
                    most: LONGEST_CHAIN,
                });
            }
            _ => Ingredients::chain(&pairs(inputs)?, limits, &self.end)?,
        };
        Ok(ingredients.until(inputs.len()))
    }

    fn stationary(&self, limits: Constraints) -> Result<Ingredients, TerminalError> {
        let inputs = self.path.inputs();
        let &input = inputs.first().ok_or(TerminalError::NoStep)?;
        repeats(inputs, 1)?;
        match Ingredients::stationary(&self.pair(input)?, limits) {
            Err(TerminalError::Straight(source)) => Err(TerminalError::Dare {
                report: Box::new(ControllabilityReport::of_reference_input(
                    self.needle,
                    input,
                )?),
                source,
            }),
            other => other,
        }
    }

    fn pair(&self, input: Input) -> Result<Pair, TerminalError> {
        let jacobians = self.needle.linearise(input, self.dt_s)?;
        let (at, n) = (self.coordinates, self.coordinates.len());
        Ok(Pair {
            a: DMatrix::from_fn(n, n, |i, j| jacobians.a[(at[i], at[j])]),
            b: DMatrix::from_fn(n, 2, |i, j| jacobians.b[(at[i], j)]),
            q: self.q.clone(),
            r: self.r,
            r_rate: self.r_rate,
        })
    }

    /// Refuses a path of another time step, and one that the needle leaves by itself.
    fn executable(&self) -> Result<(), TerminalError> {
        let (path_dt_s, dt_s) = (self.path.dt_s(), self.dt_s);
        if (path_dt_s - dt_s).abs() > SAME_INPUT * dt_s {
            return Err(TerminalError::TimeStep { path_dt_s, dt_s });
        }
        let poses = self.path.poses();
        for (step, &input) in self.path.inputs().iter().enumerate() {
            let missed = self
                .needle
                .step(&poses[step], input, dt_s)?
                .error_from(&poses[step + 1]);
            let squares = self.coordinates.iter().map(|&i| missed[i] * missed[i]);
            let defect = squares.sum::<f64>().sqrt();
            if defect.is_nan() || defect > SAME_POSE {
                return Err(TerminalError::NotExecutable { step, defect });
            }
        }
        Ok(())
    }
}

impl Chosen {
    /// The same if it has a set. Without one the cost alone is left to [`TerminalChoice::Auto`], nothing is claimed of it, and the
    /// refusal is kept.
    ///
    /// # Errors
    /// [`TerminalError::NoInterior`] for a choice that was asked for by name.
    pub(crate) fn with_interior(
        mut self,
        wanted: TerminalChoice,
        constraint: impl FnOnce() -> &'static str,
    ) -> Result<Self, TerminalError> {
        if self.ingredients.has_sets() {
            return Ok(self);
        }
        if wanted != TerminalChoice::Auto {
            return Err(TerminalError::NoInterior {
                constraint: constraint(),
            });
        }
        self.ingredients.certificate = None;
        self.refused.push(RefusedChoice {
            choice: self.choice,
            reason: TerminalError::NoInterior {
                constraint: constraint(),
            },
        });
        Ok(self)
    }
}

/// Offsets along the reference's cross axes, the first two coordinates of the error, within the corridor.
fn within_corridor(
    mut limits: Constraints,
    states: usize,
    corridor_mm: f64,
) -> Result<Constraints, ConstraintError> {
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        for (sign, relation) in [(1.0, "<= "), (-1.0, ">= -")] {
            let mut row = vec![0.0; states];
            row[axis] = sign;
            let name = format!("corridor: {name} {relation}{corridor_mm} mm");
            limits = limits.with_state_half_space(&name, &row, corridor_mm)?;
        }
    }
    Ok(limits)
}

fn repeats(inputs: &[Input], period: usize) -> Result<(), TerminalError> {
    let same = |a: f64, b: f64| (a - b).abs() <= SAME_INPUT * a.abs().max(b.abs());
    if period == 0 {
        return Err(TerminalError::NoStep);
    }
    for (k, (now, later)) in inputs.iter().zip(inputs.iter().skip(period)).enumerate() {
        if !(same(now.v_mm_s, later.v_mm_s) && same(now.omega_rad_s, later.omega_rad_s)) {
            return Err(TerminalError::NotPeriodic {
                step: k + period,
                period,
            });
        }
    }
    Ok(())
}
