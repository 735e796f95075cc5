//! Soft constraints out of reach: by how much they give way at their price.

use super::{KnownProblem, projection_onto_disc};
use crate::error::ProblemError;
use crate::problem::OcpQp;
use crate::softening::{Penalty, Softening};
use crate::stage::Stage;
use crate::terminal::Terminal;
use nalgebra::{Matrix1, Vector1, Vector2};

/// `x_1 = u`, cost `|u - (3, 4)|^2 / 2` (constant dropped), and a soft unit disc: with growth t the answer is
/// `(1 + t)(3, 4) / 5`. Exact with weight w: `t = max(4 - w, 0)`. Quadratic: `t = 4 / (1 + w)`.
///
/// # Errors
/// [`ProblemError::PenaltyWeight`].
pub fn soft_disc_out_of_reach(penalty: Penalty) -> Result<KnownProblem<2, 2>, ProblemError> {
    let softening = Softening {
        terminal_set: penalty,
        ..Softening::default()
    };
    let hard = projection_onto_disc(Vector2::new(3.0, 4.0), Vector2::zeros(), 1.0)?;
    let growth = match penalty {
        Penalty::Hard => 0.0,
        Penalty::Exact { weight } => (4.0 - weight).max(0.0),
        Penalty::Quadratic { weight } => 4.0 / (1.0 + weight),
    };
    let length = 1.0 + growth;
    Ok(KnownProblem {
        problem: hard.problem.with_softening(softening)?,
        u: vec![Vector2::new(0.6, 0.8) * length],
        objective: 0.5 * length * length - 5.0 * length + penalty.cost(growth),
    })
}

/// `x_1 = u`, `|u| <= 1`, cost `u^2 / 2`, and a soft wish `x_1 >= 3`. Its violation is `t = 3 - u`.
/// Exact with weight w: `u = min(w, 1)`. Quadratic: `u = min(3 w / (1 + w), 1)`.
///
/// # Errors
/// [`ProblemError::PenaltyWeight`].
pub fn soft_bound_out_of_reach(penalty: Penalty) -> Result<KnownProblem<1, 1>, ProblemError> {
    let mut stage = Stage::new(Matrix1::zeros(), Matrix1::new(1.0));
    stage.r[0] = 1.0;
    (stage.u_min[0], stage.u_max[0]) = (-1.0, 1.0);
    let mut terminal = Terminal::new(Matrix1::zeros());
    terminal.x_min[0] = 3.0;
    let softening = Softening {
        state_bounds: penalty,
        ..Softening::default()
    };
    let problem = OcpQp::new(Vector1::zeros(), vec![stage], terminal)?.with_softening(softening)?;
    let u = match penalty {
        Penalty::Hard => f64::NAN,
        Penalty::Exact { weight } => weight.min(1.0),
        Penalty::Quadratic { weight } => (3.0 * weight / (1.0 + weight)).min(1.0),
    };
    Ok(KnownProblem {
        problem,
        u: vec![Vector1::new(u)],
        objective: 0.5 * u * u + penalty.cost(3.0 - u),
    })
}
