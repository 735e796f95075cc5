//! The end of the nonlinear controller's horizon: its cost, the set that it is to reach, and the rows that tie its last input to
//! the law that takes over.
//!
//! With terminal ingredients the cost is xi'P xi of the left-invariant error, the set xi'P xi <= c, and |K xi_N + r_N - u_{N-1}| stays
//! within the rate limits: so the law K may go on from any plan that ends in the set, and inside the set its own changes are within the
//! limits by the size of c. The state needs no input in it. In the perturbation delta of the plan's last pose xi = xi_0 + J delta
//! to first order, J = J_r(xi_0)^-1.

use super::cost::PoseWeights;
use crate::program::Goal;
use crate::terminal;
use mpc_qp::{Row, Stage};
use nalgebra::{Matrix2x6, Matrix6, SVector, Vector2, Vector6};
use needle_model::{Input, Pose, StepError, pose_residual};

/// Part of the set's size by which its linearisation may miss it.
const SECOND_ORDER: f64 = 1e-3;

/// Cost and set at the end of the horizon.
#[derive(Debug, Clone)]
#[expect(
    clippy::large_enum_variant,
    reason = "a boxed form would allocate inside a step"
)]
pub(crate) enum HorizonEnd {
    /// A cost of the same form as the stages', and no set.
    Weights(PoseWeights),
    /// Terminal ingredients.
    Form(Form),
}

/// Terminal ingredients at one step of the path.
#[derive(Debug, Clone)]
pub(crate) struct Form {
    p: Matrix6<f64>,
    law: Matrix2x6<f64>,
    level: Option<f64>,
}

impl From<terminal::End<'_>> for Form {
    fn from(end: terminal::End<'_>) -> Self {
        let law = end
            .k
            .map_or(Matrix2x6::zeros(), |k| Matrix2x6::from_fn(|i, j| k[(i, j)]));
        Self {
            p: Matrix6::from_fn(|i, j| end.p[(i, j)]),
            law,
            level: end.level,
        }
    }
}

impl Form {
    /// The cost alone.
    pub(crate) fn without_set(self) -> Self {
        Self {
            level: None,
            ..self
        }
    }
}

/// What the rows of the last stage are made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Takeover {
    /// Input of the reference where the law takes over.
    pub(crate) wanted: Input,
    /// Largest change of each input in a step.
    pub(crate) change: Vector2<f64>,
}

impl HorizonEnd {
    /// Whether the horizon is to end in a set.
    pub(crate) fn has_set(&self) -> bool {
        matches!(self, Self::Form(Form { level: Some(_), .. }))
    }

    /// Cost of the last pose.
    pub(crate) fn of_pose(&self, pose: &Pose, reference: &Pose) -> f64 {
        match self {
            Self::Weights(weights) => weights.of_pose(pose, reference),
            Self::Form(Form { p, .. }) => {
                let xi = pose.error_from(reference);
                xi.dot(&(p * xi))
            }
        }
    }

    /// Gradient and Gauss-Newton Hessian of *half* the cost by the perturbation of the pose.
    ///
    /// # Errors
    /// [`StepError`] for a pose that is not finite.
    pub(crate) fn model(
        &self,
        pose: &Pose,
        reference: &Pose,
    ) -> Result<(Vector6<f64>, Matrix6<f64>), StepError> {
        match self {
            Self::Weights(weights) => Ok(weights.model(pose, reference)),
            Self::Form(Form { p, .. }) => {
                let residual = pose_residual(pose, reference)?;
                let weighted = p * residual.by_pose;
                let hessian = residual.by_pose.tr_mul(&weighted);
                Ok((
                    weighted.tr_mul(&residual.value),
                    (hessian + hessian.transpose()) * 0.5,
                ))
            }
        }
    }

    /// How far a pose is outside the set, in `sqrt(xi'P xi)`; zero within what linearising the set leaves out.
    pub(crate) fn outside(&self, pose: &Pose, reference: &Pose) -> f64 {
        let Self::Form(Form {
            level: Some(level), ..
        }) = self
        else {
            return 0.0;
        };
        let excess = self.of_pose(pose, reference).max(0.0).sqrt() - level.sqrt();
        if excess > SECOND_ORDER * level.sqrt() {
            excess
        } else {
            0.0
        }
    }

    /// Writes the set and rows in the perturbation of the last pose; false where there is no set at this step.
    pub(crate) fn aim(
        &self,
        goal: &mut Goal<6>,
        [pose, reference]: [&Pose; 2],
        last: &Stage<6, 2>,
        takeover: &Takeover,
    ) -> bool {
        let Self::Form(Form {
            p,
            law,
            level: Some(level),
        }) = self
        else {
            return false;
        };
        let Ok(residual) = pose_residual(pose, reference) else {
            return false;
        };
        let (xi, by_pose) = (residual.value, residual.by_pose);
        let shape = by_pose.tr_mul(&(p * by_pose));
        goal.shape = (shape + shape.transpose()) * 0.5;
        goal.center = -xi;
        goal.level = *level;
        // The law's first input less the plan's last: m (A x + B u + c) + K xi_0 + r_N - u.
        let m = law * by_pose;
        let wanted = Vector2::new(takeover.wanted.v_mm_s, takeover.wanted.omega_rad_s);
        let (by_x, by_u) = (m * last.a, m * last.b);
        let offset = law * xi + m * last.c + wanted;
        for (row, (i, sign)) in goal
            .rows
            .iter_mut()
            .zip([(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)])
        {
            row.g_x = by_x.row(i).transpose() * sign;
            row.h_u = by_u.row(i).transpose() * sign;
            row.h_u[i] -= sign;
            row.upper = takeover.change[i] - sign * offset[i];
        }
        true
    }
}

/// A goal to be filled by [`HorizonEnd::aim`].
pub(crate) fn blank_goal() -> Goal<6> {
    let row = Row {
        g_x: SVector::zeros(),
        h_u: SVector::zeros(),
        upper: f64::INFINITY,
    };
    Goal {
        shape: Matrix6::identity(),
        center: SVector::zeros(),
        level: 1.0,
        rows: vec![row; 4],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_of_the_terminal_form_is_the_derivative_of_the_cost() {
        let reference = Pose::exp(&Vector6::new(1.0, -2.0, 3.0, 0.4, -0.2, 0.9));
        let pose = reference.perturbed(&Vector6::new(0.3, 0.2, -0.4, 0.3, -0.25, 0.8));
        let root =
            Matrix6::from_fn(|i, j| f64::from(u8::try_from((3 * i + 5 * j) % 7).unwrap_or(0)));
        let end = HorizonEnd::Form(Form {
            p: root.tr_mul(&root),
            law: Matrix2x6::zeros(),
            level: Some(1.0),
        });
        let (gradient, _) = end.model(&pose, &reference).unwrap();
        let h = 1e-5;
        for i in 0..6 {
            let cost = |s: f64| end.of_pose(&pose.perturbed(&Vector6::ith(i, s)), &reference);
            let slope = 0.5 * (cost(h) - cost(-h)) / (2.0 * h);
            // Central differences: h^2 times third derivatives of the size of P, about 500.
            assert!(
                (gradient[i] - slope).abs() < 1e-5,
                "{i}: {} {slope}",
                gradient[i]
            );
        }
    }

    #[test]
    fn rows_hold_the_laws_first_input_to_what_the_last_one_can_reach() {
        let reference = Pose::exp(&Vector6::new(1.0, -2.0, 3.0, 0.4, -0.2, 0.9));
        let pose = reference.perturbed(&Vector6::new(0.3, 0.2, -0.4, 0.3, -0.25, 0.8));
        let law = Matrix2x6::from_fn(|i, j| 0.3 * (i as f64 + 1.0) - 0.2 * j as f64);
        let end = HorizonEnd::Form(Form {
            p: Matrix6::identity(),
            law,
            level: Some(2.0),
        });
        let b = nalgebra::Matrix6x2::from_fn(|i, j| 1e-5 * (i as f64 - 2.0 * j as f64));
        let mut last = Stage::new(Matrix6::identity() * 0.9, b);
        last.c = Vector6::repeat(2e-5);
        let takeover = Takeover {
            wanted: Input {
                v_mm_s: 5.0,
                omega_rad_s: 1.0,
            },
            change: Vector2::new(10.0, 5.0),
        };
        let mut goal = blank_goal();
        assert!(end.aim(&mut goal, [&pose, &reference], &last, &takeover));
        let (x, u) = (Vector6::repeat(-3e-5), Vector2::new(4.0, -0.7));
        let end_pose = pose.perturbed(&(last.a * x + last.b * u + last.c));
        let first = law * end_pose.error_from(&reference) + Vector2::new(5.0, 1.0);
        let step = first - u;
        let slack = |row: &Row<6, 2>| row.upper - row.g_x.dot(&x) - row.h_u.dot(&u);
        let expected = [10.0 - step[0], 10.0 + step[0], 5.0 - step[1], 5.0 + step[1]];
        for (row, expected) in goal.rows.iter().zip(expected) {
            // Second order of perturbations of 1e-4.
            assert!(
                (slack(row) - expected).abs() < 1e-6,
                "{} {expected}",
                slack(row)
            );
        }
        // The centre is the perturbation that brings the pose to the reference.
        let there = pose.perturbed(&goal.center).error_from(&reference);
        assert!(there.norm() < 1e-9, "{there}");
    }
}
