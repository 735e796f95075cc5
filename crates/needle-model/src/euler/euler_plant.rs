//! The plant in the paper's chart: equation (5) with three integrators. Kept to compare with the
//! paper and as a plant for its replication; [`crate::Needle::step`] is exact and has no singularity.

use nalgebra::Vector6;

use crate::euler::chart::{ChartError, EulerState};
use crate::plant::needle::{Input, Needle, check_step, finite};

/// How equation (5) is integrated over one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EulerIntegrator {
    /// Forward Euler as equation (1) prints it.
    ForwardEuler,
    /// Forward Euler with the updates in the order of the program that made the paper's figures:
    /// position, alpha, beta, then gamma with the *new* beta.
    PaperOrder,
    /// Classical Runge-Kutta of fourth order.
    Rk4,
}

/// Equation (5) in the chart, for one needle and one integrator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerPlant {
    /// The needle.
    pub needle: Needle,
    /// The integrator of each step.
    pub integrator: EulerIntegrator,
}

impl EulerPlant {
    /// Right-hand side of (5), (mm/s, rad/s), in the order of [`EulerState::to_vector`].
    ///
    /// # Errors
    /// [`ChartError`] near beta = +-pi/2 or when something is not finite.
    pub fn rate(&self, state: &EulerState, input: Input) -> Result<Vector6<f64>, ChartError> {
        check_step(true, input, 0.0)?;
        state.check()?;
        let (sa, ca) = state.alpha_rad.sin_cos();
        let (sb, cb) = state.beta_rad.sin_cos();
        let (sg, cg) = state.gamma_rad.sin_cos();
        let v = input.v_mm_s;
        let bend = self.needle.curvature_per_mm() * v;
        let rate = Vector6::new(
            v * sb,
            -v * cb * sa,
            v * ca * cb,
            bend * cg / cb,
            bend * sg,
            input.omega_rad_s - bend * cg * sb / cb,
        );
        Ok(finite(rate, [rate.sum()])?)
    }

    /// State after `input` is held for `dt_s`.
    ///
    /// # Errors
    /// [`ChartError`] when the state, or a stage of the integrator, is near beta = +-pi/2 or not
    /// finite, the time step is negative, or the result overflows.
    pub fn step(
        &self,
        state: &EulerState,
        input: Input,
        dt_s: f64,
    ) -> Result<EulerState, ChartError> {
        check_step(true, input, dt_s)?;
        let x = state.to_vector();
        let next = match self.integrator {
            EulerIntegrator::ForwardEuler => x + self.rate(state, input)? * dt_s,
            EulerIntegrator::PaperOrder => self.paper_order_step(state, input, dt_s)?,
            EulerIntegrator::Rk4 => {
                let at = |offset: Vector6<f64>| {
                    self.rate(&EulerState::from_vector(&(x + offset)), input)
                };
                let k1 = at(Vector6::zeros())?;
                let k2 = at(k1 * (0.5 * dt_s))?;
                let k3 = at(k2 * (0.5 * dt_s))?;
                let k4 = at(k3 * dt_s)?;
                x + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (dt_s / 6.0)
            }
        };
        Ok(EulerState::from_vector(&finite(next, [next.sum()])?))
    }

    fn paper_order_step(
        &self,
        state: &EulerState,
        input: Input,
        dt_s: f64,
    ) -> Result<Vector6<f64>, ChartError> {
        let mut next = state.to_vector() + self.rate(state, input)? * dt_s;
        let new_beta = EulerState {
            beta_rad: next[4],
            ..*state
        };
        next[5] = state.gamma_rad + self.rate(&new_beta, input)?[5] * dt_s;
        Ok(next)
    }
}
