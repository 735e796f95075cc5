//! Analytic derivatives of the discrete steps in the Euler chart: equation (5) by hand, then the
//! chain rule of each integrator. The forward-Euler case, A = I + dt df/dx, is what (8) to (13)
//! and (20) of the paper should say; what they print is in [`crate::printed_linearisation`].

use nalgebra::{Matrix6, Matrix6x2, Vector6};

use crate::euler::chart::{ChartError, EulerState};
use crate::euler::euler_plant::{EulerIntegrator, EulerPlant};
use crate::plant::needle::{Input, check_step, finite};

/// Derivatives in the chart, in the order (x, y, z, alpha, beta, gamma), mm and rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerJacobians {
    /// 6x6, by the state.
    pub a: Matrix6<f64>,
    /// 6x2, by (v in mm/s, omega in rad/s).
    pub b: Matrix6x2<f64>,
}

impl EulerJacobians {
    /// Refuses entries that overflowed.
    pub(crate) fn checked(self) -> Result<Self, ChartError> {
        Ok(finite(self, [self.a.sum(), self.b.sum()])?)
    }
}

impl EulerPlant {
    /// Derivatives of the rate (5) by state and input.
    ///
    /// # Errors
    /// As [`EulerPlant::rate`].
    pub fn rate_jacobians(
        &self,
        state: &EulerState,
        input: Input,
    ) -> Result<EulerJacobians, ChartError> {
        check_step(true, input, 0.0)?;
        state.check()?;
        let (sa, ca) = state.alpha_rad.sin_cos();
        let (sb, cb) = state.beta_rad.sin_cos();
        let (sg, cg) = state.gamma_rad.sin_cos();
        let (v, kappa) = (input.v_mm_s, self.needle.curvature_per_mm());
        let bend = kappa * v;
        let tb = sb / cb;
        let mut a = Matrix6::zeros();
        a[(0, 4)] = v * cb;
        a[(1, 3)] = -v * cb * ca;
        a[(1, 4)] = v * sb * sa;
        a[(2, 3)] = -v * sa * cb;
        a[(2, 4)] = -v * ca * sb;
        a[(3, 4)] = bend * cg * tb / cb;
        a[(3, 5)] = -bend * sg / cb;
        a[(4, 5)] = bend * cg;
        a[(5, 4)] = -bend * cg / (cb * cb);
        a[(5, 5)] = bend * sg * tb;
        let by_v = Vector6::new(
            sb,
            -cb * sa,
            ca * cb,
            kappa * cg / cb,
            kappa * sg,
            -kappa * cg * tb,
        );
        let by_omega = Vector6::ith(5, 1.0);
        EulerJacobians {
            a,
            b: Matrix6x2::from_columns(&[by_v, by_omega]),
        }
        .checked()
    }

    /// Derivatives of [`EulerPlant::step`], exact for the plant's integrator.
    ///
    /// # Errors
    /// As [`EulerPlant::step`].
    pub fn linearise(
        &self,
        state: &EulerState,
        input: Input,
        dt_s: f64,
    ) -> Result<EulerJacobians, ChartError> {
        check_step(true, input, dt_s)?;
        let jacobians = match self.integrator {
            EulerIntegrator::ForwardEuler => {
                let f = self.rate_jacobians(state, input)?;
                EulerJacobians {
                    a: Matrix6::identity() + f.a * dt_s,
                    b: f.b * dt_s,
                }
            }
            EulerIntegrator::PaperOrder => self.paper_order_jacobians(state, input, dt_s)?,
            EulerIntegrator::Rk4 => self.rk4_jacobians(state, input, dt_s)?,
        };
        jacobians.checked()
    }

    fn paper_order_jacobians(
        &self,
        state: &EulerState,
        input: Input,
        dt_s: f64,
    ) -> Result<EulerJacobians, ChartError> {
        let f = self.rate_jacobians(state, input)?;
        let mut a = Matrix6::identity() + f.a * dt_s;
        let mut b = f.b * dt_s;
        let new_beta = EulerState {
            beta_rad: state.beta_rad + self.rate(state, input)?[4] * dt_s,
            ..*state
        };
        // gamma+ = gamma + dt h(beta+, gamma, u): beta enters only through beta+.
        let h = self.rate_jacobians(&new_beta, input)?;
        let by_new_beta = h.a[(5, 4)] * dt_s;
        let mut gamma_row = a.row(4) * by_new_beta;
        gamma_row[5] += 1.0 + h.a[(5, 5)] * dt_s;
        let gamma_input_row = b.row(4) * by_new_beta + h.b.row(5) * dt_s;
        a.set_row(5, &gamma_row);
        b.set_row(5, &gamma_input_row);
        Ok(EulerJacobians { a, b })
    }

    fn rk4_jacobians(
        &self,
        state: &EulerState,
        input: Input,
        dt_s: f64,
    ) -> Result<EulerJacobians, ChartError> {
        let x = state.to_vector();
        let mut slope = Vector6::zeros();
        // Derivatives of the previous stage's slope by the state and the input.
        let (mut by_state, mut by_input) = (Matrix6::zeros(), Matrix6x2::zeros());
        let (mut a, mut b) = (Matrix6::identity(), Matrix6x2::zeros());
        for (fraction, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            let h = fraction * dt_s;
            let stage = EulerState::from_vector(&(x + slope * h));
            let f = self.rate_jacobians(&stage, input)?;
            slope = self.rate(&stage, input)?;
            by_state = f.a * (Matrix6::identity() + by_state * h);
            by_input = f.b + f.a * by_input * h;
            a += by_state * (weight * dt_s / 6.0);
            b += by_input * (weight * dt_s / 6.0);
        }
        Ok(EulerJacobians { a, b })
    }
}
