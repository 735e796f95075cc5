//! The paper's linearisation exactly as (20) and (21) print it, errors included, so that an audit
//! can put it next to the derivative. Do not control a needle with it.
//!
//! Its errors: the derivative of sin(beta) stands in the alpha column (row 0, column 3 in place of
//! column 4), A lacks the identity, and A lacks dt. The right matrices are
//! [`EulerPlant::linearise`] with [`EulerIntegrator::ForwardEuler`](crate::EulerIntegrator).

use crate::euler::chart::{ChartError, EulerState};
use crate::euler::euler_jacobian::EulerJacobians;
use crate::euler::euler_plant::EulerPlant;
use crate::plant::needle::{Input, check_step};

/// A of (20), without identity and without dt, and B of (21), in mm and rad.
///
/// # Errors
/// As [`EulerPlant::step`].
pub fn printed_linearisation(
    plant: &EulerPlant,
    state: &EulerState,
    input: Input,
    dt_s: f64,
) -> Result<EulerJacobians, ChartError> {
    check_step(true, input, dt_s)?;
    let mut printed = plant.rate_jacobians(state, input)?;
    printed.a[(0, 3)] = printed.a[(0, 4)];
    printed.a[(0, 4)] = 0.0;
    printed.b *= dt_s;
    printed.checked()
}
