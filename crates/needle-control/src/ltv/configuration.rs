//! Configuration of the linear controllers.

use crate::configuration::{ConfigurationError, count, not_negative, positive};
use crate::corridor::Corridor;
use crate::follower::Pursuit;
use crate::limits::InputLimits;
use crate::survival::{MOST_STAGES, Survival};
use crate::terminal::{TerminalChoice, TerminalProblem};
use crate::tracking::Tracking;
use nalgebra::{DMatrix, DVector, Matrix2};
use needle_model::{Needle, ReferencePath};

/// Diagonal weights; zero leaves an error out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearWeights {
    /// Of the squared left-invariant error (mm, mm, mm, rad, rad, rad).
    pub error: [f64; 6],
    /// Of the squared deviation from the reference's speed, s^2/mm^2.
    pub v: f64,
    /// Of the squared deviation from the reference's spin, s^2/rad^2.
    pub omega: f64,
    /// Of the squared change of the speed's deviation in a step, s^2/mm^2. Positive: it bounds the terminal set.
    /// Charged at the first sample too, against rest: without error an insertion begins below the reference's speed and settles to it.
    pub v_change: f64,
    /// Of the squared change of the spin's deviation in a step, s^2/rad^2. Positive.
    pub omega_change: f64,
}

impl Default for LinearWeights {
    fn default() -> Self {
        Self {
            error: [1.0, 1.0, 1.0, 10.0, 10.0, 1.0],
            v: 0.1,
            omega: 0.1,
            // A cheap change lets the last input fill the terminal set: with 0.01 it reaches 0.11 mm across a helix, with 1
            // 0.84 mm, and the closed loop is as fast.
            v_change: 1.0,
            omega_change: 1.0,
        }
    }
}

/// Price of a millimetre beyond the corridor at one sample, over the sum of the weights. More pulls a tip that is outside by roll errors of which the
/// linearisation says nothing: at 10, a start 1 mm and 1 rad off in a corridor of 0.3 mm ends 1.5 mm from the path.
const WALL_PRICE_PER_MM: f64 = 1.0;

/// Configuration of a [`LtvController`](crate::LtvController) or [`StraightController`](crate::StraightController).
#[derive(Debug, Clone, PartialEq)]
pub struct LinearConfiguration {
    /// Stages of the horizon.
    pub horizon: usize,
    /// Sample time and length of a stage, s.
    pub dt_s: f64,
    /// Limits of the actuators.
    pub limits: InputLimits,
    /// Half-width of the tissue corridor, mm, where there is one: along both cross axes of the reference's frame no predicted position is
    /// farther than this from the path's, so the tube is square. Soft: a plan that cannot keep it says [`Origin::Degraded`](crate::Origin::Degraded).
    /// In the linearised error; a needle without bevel has no offset across the path, and its controller refuses.
    pub corridor_mm: Option<f64>,
    /// Weights of the cost.
    pub weights: LinearWeights,
    /// Terminal cost and set.
    pub terminal: TerminalChoice,
    /// What fixes the present point of the path.
    pub tracking: Tracking,
    /// Deadline, plans in reserve, outliers.
    pub survival: Survival,
}

impl Default for LinearConfiguration {
    /// 20 stages of 0.1 s, the strongest terminal ingredients that the reference admits.
    fn default() -> Self {
        Self {
            horizon: 20,
            dt_s: 0.1,
            limits: InputLimits::default(),
            corridor_mm: None,
            weights: LinearWeights::default(),
            terminal: TerminalChoice::default(),
            tracking: Tracking::default(),
            survival: Survival::default(),
        }
    }
}

impl LinearConfiguration {
    pub(crate) fn corridor(&self) -> Option<Corridor> {
        let w = &self.weights;
        let inputs = [w.v, w.omega, w.v_change, w.omega_change];
        let all: f64 = w.error.iter().chain(&inputs).sum();
        Corridor::of(self.corridor_mm, WALL_PRICE_PER_MM * all)
    }

    pub(crate) fn pursuit(&self) -> Pursuit {
        Pursuit {
            horizon: self.horizon,
            dt_s: self.dt_s,
            limits: self.limits,
            tracking: self.tracking,
            survival: self.survival,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the first that is out of range.
    pub fn validate(&self) -> Result<(), ConfigurationError> {
        count("horizon", self.horizon, MOST_STAGES)?;
        positive("dt_s", self.dt_s)?;
        self.limits.validate()?;
        self.survival.validate()?;
        self.corridor_mm
            .map_or(Ok(()), |mm| positive("corridor_mm", mm))?;
        for found in self.weights.error {
            not_negative("weights.error", found)?;
        }
        positive("weights.v", self.weights.v)?;
        positive("weights.omega", self.weights.omega)?;
        positive("weights.v_change", self.weights.v_change)?;
        positive("weights.omega_change", self.weights.omega_change)
    }
}

impl LinearWeights {
    pub(crate) fn of_input(&self) -> Matrix2<f64> {
        Matrix2::new(self.v, 0.0, 0.0, self.omega)
    }

    pub(crate) fn of_change(&self) -> Matrix2<f64> {
        Matrix2::new(self.v_change, 0.0, 0.0, self.omega_change)
    }

    /// Weight of the chosen coordinates of the error.
    fn of_error(&self, coordinates: &[usize]) -> DMatrix<f64> {
        let diagonal = coordinates.iter().map(|&i| self.error[i]);
        DMatrix::from_diagonal(&DVector::from_iterator(coordinates.len(), diagonal))
    }
}

impl LinearConfiguration {
    pub(crate) fn terminal_problem<'a>(
        &self,
        needle: Needle,
        path: &'a ReferencePath,
        coordinates: &'static [usize],
    ) -> TerminalProblem<'a> {
        let (weights, n) = (&self.weights, coordinates.len());
        let q = weights.of_error(coordinates);
        let mut end = DMatrix::zeros(n + 2, n + 2);
        end.view_mut((0, 0), (n, n)).copy_from(&q);
        end.view_mut((n, n), (2, 2)).copy_from(&weights.of_input());
        TerminalProblem {
            needle,
            path,
            dt_s: self.dt_s,
            limits: self.limits,
            corridor_mm: self.corridor_mm,
            coordinates,
            q,
            r: weights.of_input(),
            r_rate: Some(weights.of_change()),
            end,
        }
    }
}
