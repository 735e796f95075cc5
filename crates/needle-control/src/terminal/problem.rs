//! From a path to its terminal ingredients: the choice asked for, or the strongest that can be had.

use super::ingredients::Ingredients;
use super::pair::Pair;
use super::{TerminalChoice, TerminalError};
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
}

/// What terminal ingredients are made from.
#[derive(Debug, Clone)]
pub(crate) struct TerminalProblem<'a> {
    pub(crate) needle: Needle,
    pub(crate) path: &'a ReferencePath,
    pub(crate) dt_s: f64,
    pub(crate) limits: InputLimits,
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
    /// Ingredients along a path of a bevel-tip needle.
    pub(crate) fn choose(&self, wanted: TerminalChoice) -> Result<Chosen, TerminalError> {
        let attempts: &[TerminalChoice] = match wanted {
            TerminalChoice::Auto => &[TerminalChoice::HelixDare, TerminalChoice::RiccatiChain],
            ref other => std::slice::from_ref(other),
        };
        let mut refusal = None;
        for &choice in attempts {
            match self.attempt(choice) {
                Ok(ingredients) => {
                    let chosen = Chosen {
                        choice,
                        ingredients,
                    };
                    return match choice {
                        TerminalChoice::None => Ok(chosen),
                        _ => chosen.with_interior(wanted, || self.exhausted()),
                    };
                }
                Err(reason) => refusal = Some(reason),
            }
        }
        match refusal {
            Some(reason) if wanted != TerminalChoice::Auto => Err(reason),
            _ => Ok(self.without()),
        }
    }

    /// Ingredients of a straight needle: its pair is the same whatever the inputs.
    pub(crate) fn choose_straight(&self, wanted: TerminalChoice) -> Result<Chosen, TerminalError> {
        let curvature_per_mm = self.needle.curvature_per_mm();
        if curvature_per_mm != 0.0 {
            return Err(TerminalError::Bent { curvature_per_mm });
        }
        let stationary = || -> Result<Chosen, TerminalError> {
            self.executable()?;
            let pair = self.pair(Input::ZERO)?;
            let ingredients = Ingredients::stationary(&pair, self.deviation_limits()?)?;
            let chosen = Chosen {
                // One pair at every step: chain and period have the same fixed point.
                choice: match wanted {
                    TerminalChoice::Auto => TerminalChoice::HelixDare,
                    other => other,
                },
                ingredients: ingredients.until(self.path.inputs().len()),
            };
            chosen.with_interior(wanted, || self.exhausted())
        };
        match wanted {
            TerminalChoice::None => Ok(self.without()),
            TerminalChoice::Auto => Ok(stationary().unwrap_or_else(|_| self.without())),
            _ => stationary(),
        }
    }

    /// The weights at the end and no set.
    pub(crate) fn without(&self) -> Chosen {
        Chosen {
            choice: TerminalChoice::None,
            ingredients: Ingredients::none(self.end.clone()),
        }
    }

    fn attempt(&self, choice: TerminalChoice) -> Result<Ingredients, TerminalError> {
        if choice == TerminalChoice::None {
            return Ok(Ingredients::none(self.end.clone()));
        }
        self.executable()?;
        let inputs = self.path.inputs();
        let limits = self.deviation_limits()?;
        let pairs = |inputs: &[Input]| -> Result<Vec<Pair>, TerminalError> {
            inputs.iter().map(|&input| self.pair(input)).collect()
        };
        let ingredients = match choice {
            TerminalChoice::HelixDare => self.stationary(limits)?,
            TerminalChoice::Periodic { period } => {
                repeats(inputs, period)?;
                let of_period = pairs(inputs.get(..period).ok_or(TerminalError::NoStep)?)?;
                Ingredients::periodic(&of_period, limits)?
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

    /// Limits on deviations from every one of the reference's inputs at once.
    fn deviation_limits(&self) -> Result<Constraints, ConstraintError> {
        let DeviationBox { lower, upper, rate } = self.deviation_box();
        Constraints::new(self.coordinates.len(), 2)
            .with_input_box(&lower, &upper)?
            .with_rate_box(&rate.map(|r| -r), &rate)
    }

    /// The limit of which the reference leaves least, in a word.
    fn exhausted(&self) -> &'static str {
        let DeviationBox { lower, upper, rate } = self.deviation_box();
        let limits = [
            ("the insertion speed", upper[0].min(-lower[0])),
            ("the spin", upper[1].min(-lower[1])),
            ("the change of the insertion speed", rate[0]),
            ("the change of the spin", rate[1]),
        ];
        let least = limits.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        least.map_or("the limits", |(name, _)| name)
    }

    fn deviation_box(&self) -> DeviationBox {
        let (limits, inputs) = (&self.limits, self.path.inputs());
        let extreme = |of: fn(&Input) -> f64, pick: fn(f64, f64) -> f64| {
            inputs.iter().map(of).reduce(pick).unwrap_or(0.0)
        };
        let change = |of: fn(&Input) -> f64| {
            let steps = inputs
                .windows(2)
                .map(|pair| (of(&pair[1]) - of(&pair[0])).abs());
            steps.fold(0.0, f64::max)
        };
        let v: fn(&Input) -> f64 = |u| u.v_mm_s;
        let omega: fn(&Input) -> f64 = |u| u.omega_rad_s;
        let lower = [
            limits.v_min_mm_s - extreme(v, f64::min),
            -limits.omega_max_rad_s - extreme(omega, f64::min),
        ];
        let upper = [
            limits.v_max_mm_s - extreme(v, f64::max),
            limits.omega_max_rad_s - extreme(omega, f64::max),
        ];
        let rate = [
            limits.v_rate_max_mm_s2 * self.dt_s - change(v),
            limits.omega_rate_max_rad_s2 * self.dt_s - change(omega),
        ];
        DeviationBox { lower, upper, rate }
    }
}

/// Room for deviations (v, omega) from every input of a reference, mm/s and rad/s, and for their change in a step.
struct DeviationBox {
    lower: [f64; 2],
    upper: [f64; 2],
    rate: [f64; 2],
}

impl Chosen {
    /// The same if it has a set. Without one the cost alone is left to [`TerminalChoice::Auto`], and nothing is claimed of it.
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
            let constraint = constraint();
            return Err(TerminalError::NoInterior { constraint });
        }
        self.ingredients.certificate = None;
        Ok(self)
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    const HELIX: Input = Input {
        v_mm_s: 5.0,
        omega_rad_s: 1.0,
    };

    /// Largest value over bound that a row of the law takes on the set: by Cauchy-Schwarz sqrt(level f P^-1 f').
    fn fullest(p: &DMatrix<f64>, level: f64, rows: &DMatrix<f64>, bounds: &[f64]) -> f64 {
        let factor = p.clone().cholesky().unwrap();
        let of = |i: usize| {
            let f: DVector<f64> = rows.row(i).transpose();
            (level * f.dot(&factor.solve(&f))).sqrt() / bounds[i]
        };
        (0..bounds.len()).map(of).fold(0.0, f64::max)
    }

    #[test]
    fn set_is_as_large_as_the_law_keeps_inputs_and_their_changes_within_the_limits() {
        let needle = Needle::new(1.0 / 150.0).unwrap();
        let path = ReferencePath::from_inputs(
            needle,
            needle_model::Pose::identity(),
            vec![HELIX; 20],
            0.1,
        )
        .unwrap();
        let limits = InputLimits::default();
        // Of the box the nearer side: 5 of 0 to 10 mm/s, and up to the largest spin. Changes in 0.1 s.
        let boxes = [5.0, limits.omega_max_rad_s - 1.0];
        let changes = [
            0.1 * limits.v_rate_max_mm_s2,
            0.1 * limits.omega_rate_max_rad_s2,
        ];
        let bounds = [boxes, changes].concat();
        for r_rate in [None, Some(Matrix2::identity())] {
            let states = if r_rate.is_some() { 8 } else { 6 };
            let problem = TerminalProblem {
                needle,
                path: &path,
                dt_s: 0.1,
                limits,
                coordinates: ALL_COORDINATES,
                q: DMatrix::identity(6, 6),
                r: Matrix2::identity() * 0.1,
                r_rate,
                end: DMatrix::identity(states, states),
            };
            let chosen = problem.choose(TerminalChoice::HelixDare).unwrap();
            let end = chosen.ingredients.at(7);
            let (k, level) = (end.k.unwrap(), end.level.unwrap());
            let jacobians = needle.linearise(HELIX, 0.1).unwrap();
            let mut rows = DMatrix::zeros(4, states);
            if r_rate.is_some() {
                // The law gives the change; the input is the last one and the change.
                rows.view_mut((0, 0), (2, 8)).copy_from(k);
                rows[(0, 6)] += 1.0;
                rows[(1, 7)] += 1.0;
                rows.view_mut((2, 0), (2, 8)).copy_from(k);
            } else {
                let a = DMatrix::from_fn(6, 6, |i, j| jacobians.a[(i, j)]);
                let b = DMatrix::from_fn(6, 2, |i, j| jacobians.b[(i, j)]);
                let step = a + b * k - DMatrix::identity(6, 6);
                rows.view_mut((0, 0), (2, 6)).copy_from(k);
                rows.view_mut((2, 0), (2, 6)).copy_from(&(k * step));
            }
            // One row is met with equality, none is passed; rounding of P, whose condition is 1e5.
            let fullest = fullest(end.p, level, &rows, &bounds);
            assert!((fullest - 1.0).abs() < 1e-6, "{states}: {fullest}");
        }
    }
}
