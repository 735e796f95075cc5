//! How well a point satisfies the optimality conditions: violations in the units of the conditions and relative to their terms.

/// How far conditions are violated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// Largest violation, in the unit of its condition.
    pub absolute: f64,
    /// Largest violation relative to the terms of its own condition.
    ratio: f64,
    /// Largest term of all conditions of the kind.
    largest: f64,
}

/// Part of the largest term of all gradients below which no gradient is measured in [`Residuals::worst`]: solvers converge relative to
/// the norm of all of them, some in a scaling of their own.
const LEAST_PART: f64 = 0.1;

impl Residual {
    /// The largest of `violation / max(1, terms)` over the scalar conditions, with the largest term that should have cancelled in
    /// that very condition: a huge component hides nothing of a small one beside it. Infinite unless all are finite.
    #[must_use]
    pub fn relative(&self) -> f64 {
        self.ratio
    }

    /// NaN and infinite terms count as infinite violations; a condition without a limit comes as minus infinity and holds.
    #[inline]
    pub(crate) fn record(&mut self, violation: f64, terms: f64) {
        let size = if terms > 1.0 { terms } else { 1.0 };
        // There are many conditions, and few set a record.
        if violation <= self.absolute && violation <= self.ratio * size && terms <= self.largest {
            return;
        }
        if violation < f64::INFINITY && terms.is_finite() {
            self.absolute = self.absolute.max(violation);
            self.largest = self.largest.max(terms);
            if violation > self.ratio * size {
                self.ratio = violation / size;
            }
        } else {
            (self.absolute, self.ratio) = (f64::INFINITY, f64::INFINITY);
        }
    }
}

/// The optimality conditions at a solution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residuals {
    /// Gradient of the Lagrangian with respect to `x_1..x_N`, `u_0..u_{N-1}` and quadratic slacks.
    pub stationarity: Residual,
    /// `A x_k + B u_k + c - x_{k+1}`, and the terminal equality.
    pub dynamics: Residual,
    /// Violation of the inequalities beyond their slacks, and negative slacks.
    pub constraints: Residual,
    /// Multipliers below zero, outside the cone, or above the price of an exact penalty.
    pub multiplier_signs: Residual,
    /// Sum of multiplier times distance to the constraint, the duality gap; relative to the objective.
    pub complementarity: Residual,
}

impl Residuals {
    /// The largest of the relative residuals, that of stationarity relative to a tenth of the largest term of all gradients at least.
    #[must_use]
    pub fn worst(&self) -> f64 {
        let Residual {
            absolute,
            ratio,
            largest,
        } = self.stationarity;
        let stationarity = ratio.min(absolute / (LEAST_PART * largest).max(1.0));
        [
            self.dynamics,
            self.constraints,
            self.multiplier_signs,
            self.complementarity,
        ]
        .iter()
        .map(Residual::relative)
        .fold(stationarity, f64::max)
    }
}
