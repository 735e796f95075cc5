//! One step of the needle, linearised between two poses that need not be a step apart.
//!
//! With g and g' the poses, u the input and E = g'^-1 g exp(V(u) dt) the defect, right perturbations obey, to first order in
//! them, in the change of the input and in E,
//! ```text
//! delta' = Ad(g'^-1 g) delta + Ad(E) J_r(V dt) dt [V1 V2] (change of u) + log E
//! ```

use nalgebra::{Matrix6, Matrix6x2, Vector6};
use needle_model::{Input, Needle, Pose, StepError, se3};

/// A linearised step: matrices by perturbation and input, and the defect.
pub(crate) struct Link {
    pub(crate) a: Matrix6<f64>,
    pub(crate) b: Matrix6x2<f64>,
    pub(crate) defect: Vector6<f64>,
}

/// Linearises the step from `pose` to `next`.
pub(crate) fn link(
    needle: &Needle,
    pose: &Pose,
    input: Input,
    next: &Pose,
    dt_s: f64,
) -> Result<Link, StepError> {
    let predicted = needle.step(pose, input, dt_s)?;
    let error = next.relative(&predicted);
    let by_input = needle.linearise(input, dt_s)?.b;
    Ok(Link {
        a: se3::adjoint(&next.relative(pose)),
        b: se3::adjoint(&error) * by_input,
        defect: error.log(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn link_is_the_step_residual_solved_for_its_target() {
        let needle = Needle::new(1.0 / 150.0).unwrap();
        let pose = Pose::exp(&Vector6::new(1.0, -2.0, 3.0, 0.4, -0.2, 0.9));
        let input = Input {
            v_mm_s: 5.0,
            omega_rad_s: -3.0,
        };
        let off = Vector6::new(0.1, -0.2, 0.15, 0.05, -0.1, 0.2);
        let next = needle.step(&pose, input, 0.1).unwrap().perturbed(&off);
        let ours = link(&needle, &pose, input, &next, 0.1).unwrap();
        let model = needle
            .step_residual(&pose, input, &next, 0.1)
            .unwrap()
            .solved_for_target();
        // Closed forms of the same matrices; entries are of order one, so rounding is about 1e-15 a product.
        assert!((ours.a - model.a).amax() < 1e-13);
        assert!((ours.b - model.b).amax() < 1e-13);
        assert!((ours.defect - model.c).amax() < 1e-13);
    }
}
