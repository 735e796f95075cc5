//! The nonlinear controller's terminal set, checked by code that shares nothing with what certifies it: P and K from finite differences of
//! the needle and a plain Riccati iteration, c from the region that the controller draws, and rollouts of the needle under the law from
//! random points of the set.

use crate::deviates::Deviates;
use crate::linear::{HELIX, needle, path};
use crate::nonlinear_terminal::certified;
use crate::scene::{DT_S, apart};
use nalgebra::{Matrix2, Matrix2x6, Matrix6, Matrix6x2, Vector2, Vector6};
use needle_control::{Controller, InputLimits, Measurement, NmpcController, TerminalChoice};
use needle_model::{Input, Pose};

/// Directions from the set's centre; on each a point of the boundary and one inside.
const DIRECTIONS: usize = 20_000;

/// Steps of the law from each point.
const STEPS: usize = 6;

/// { xi : xi'P xi <= c } about a helix, and the law u = u_r + K xi.
struct Set {
    wanted: Input,
    p: Matrix6<f64>,
    k: Matrix2x6<f64>,
    c: f64,
}

/// Derivatives of the error after a step by error and input, by central differences: wrong by 1e-10.
fn differences(wanted: Input) -> (Matrix6<f64>, Matrix6x2<f64>) {
    let h = 1e-5;
    let reference = needle().step(&Pose::identity(), wanted, DT_S).unwrap();
    let after = |xi: Vector6<f64>, d: Vector2<f64>| {
        let pose = needle()
            .step(&Pose::exp(&xi), plus(wanted, d), DT_S)
            .unwrap();
        pose.error_from(&reference)
    };
    let (mut a, mut b) = (Matrix6::zeros(), Matrix6x2::zeros());
    for i in 0..6 {
        let e = Vector6::ith(i, h);
        let slope = (after(e, Vector2::zeros()) - after(-e, Vector2::zeros())) / (2.0 * h);
        a.set_column(i, &slope);
    }
    for i in 0..2 {
        let e = Vector2::ith(i, h);
        let slope = (after(Vector6::zeros(), e) - after(Vector6::zeros(), -e)) / (2.0 * h);
        b.set_column(i, &slope);
    }
    (a, b)
}

fn plus(wanted: Input, d: Vector2<f64>) -> Input {
    Input {
        v_mm_s: wanted.v_mm_s + d[0],
        omega_rad_s: wanted.omega_rad_s + d[1],
    }
}

impl Set {
    /// The set of a controller along a helix; its weights enter the Riccati equation twice (`docs/controllers.md`).
    fn of(wanted: Input) -> Self {
        let reference = path(needle(), wanted, 100);
        let configuration = certified(TerminalChoice::HelixDare);
        let w = configuration.weights;
        let (horizon, end) = (
            configuration.horizon,
            reference.poses()[configuration.horizon],
        );
        let mut controller = NmpcController::new(needle(), reference, configuration).unwrap();
        assert!(horizon <= 100 && controller.certificate().unwrap().holds());
        controller.step(&Measurement::of(Pose::identity()), 0.0);
        let region = controller.terminal_region().unwrap();

        let q = Vector6::new(
            w.position, w.position, w.position, w.tangent, w.tangent, w.roll,
        );
        let q = Matrix6::from_diagonal(&(2.0 * q));
        let r = Matrix2::new(2.0 * w.v, 0.0, 0.0, 2.0 * w.omega);
        let (a, b) = differences(wanted);
        let (mut p, mut k) = (q, Matrix2x6::zeros());
        // The closed loop's radius is 0.98: 2000 steps leave nothing.
        for _ in 0..2_000 {
            k = -(r + b.tr_mul(&(p * b))).try_inverse().unwrap() * b.tr_mul(&(p * a));
            p = q + a.tr_mul(&(p * (a + b * k)));
            p = (p + p.transpose()) * 0.5;
        }
        // The region is the shadow of the set on the positions: c times a block of P^-1, in the world.
        let shadow = p
            .try_inverse()
            .unwrap()
            .fixed_view::<3, 3>(0, 0)
            .into_owned();
        let to_body = end.rotation.inverse().to_rotation_matrix();
        let axes = to_body * region.half_axes_mm;
        let drawn = axes * axes.transpose();
        let c = drawn.trace() / shadow.trace();
        // Differences of 1e-10 through a P of condition 1e5: the two agree in every entry, or they are not of one set.
        assert!(
            (drawn - shadow * c).norm() < 1e-4 * drawn.norm(),
            "{drawn} {shadow}"
        );
        Self { wanted, p, k, c }
    }

    fn value(&self, xi: &Vector6<f64>) -> f64 {
        xi.dot(&(self.p * xi))
    }

    fn law(&self, xi: &Vector6<f64>) -> Input {
        plus(self.wanted, self.k * xi)
    }

    /// How a rollout from a point goes: the least (V - V+ - l) / V of its steps, or minus infinity where an input or its change breaks a
    /// limit.
    fn margin_from(&self, xi: &Vector6<f64>) -> f64 {
        let w = certified(TerminalChoice::HelixDare).weights;
        let limits = InputLimits::default();
        let beyond = |input: Input, held: Input| {
            let nearest = limits.admissible(input, held, DT_S);
            // P and K by differences are wrong by 1e-8 of themselves.
            apart(input, nearest) > 1e-6
        };
        let (mut reference, mut pose) = (Pose::identity(), Pose::exp(xi));
        let (mut value, mut input) = (self.value(xi), self.law(xi));
        let mut least = f64::INFINITY;
        if beyond(input, input) {
            return f64::NEG_INFINITY;
        }
        for _ in 0..STEPS {
            let apart = reference.relative(&pose);
            // The twist of the relative rotation about the tangent.
            let roll = 2.0 * f64::atan2(apart.rotation.k, apart.rotation.w);
            let spent = w.position * apart.position_mm.norm_squared()
                + w.tangent * (pose.tangent() - reference.tangent()).norm_squared()
                + w.roll * roll * roll
                + w.v * (input.v_mm_s - self.wanted.v_mm_s).powi(2)
                + w.omega * (input.omega_rad_s - self.wanted.omega_rad_s).powi(2);
            reference = needle().step(&reference, self.wanted, DT_S).unwrap();
            pose = needle().step(&pose, input, DT_S).unwrap();
            let xi = pose.error_from(&reference);
            let (after, next) = (self.value(&xi), self.law(&xi));
            if beyond(next, input) {
                return f64::NEG_INFINITY;
            }
            least = least.min((value - after - spent) / value);
            (value, input) = (after, next);
        }
        least
    }

    /// Errors in which an input, or its first change, is the largest of all in the unit set: P^-1 f for each row f.
    fn fullest(&self) -> Vec<Vector6<f64>> {
        let (a, b) = differences(self.wanted);
        let change = self.k * (a + b * self.k - Matrix6::identity());
        let inverse = self.p.try_inverse().unwrap();
        let rows = [self.k.row(0), self.k.row(1), change.row(0), change.row(1)];
        let errors = rows.map(|row| inverse * row.transpose());
        errors.into_iter().flat_map(|xi| [xi, -xi]).collect()
    }

    /// The least margin over a set that much larger: at random points of its boundary and inside, where the inputs are largest, and
    /// downhill from the worst of them.
    fn least_margin(&self, enlarged: f64, directions: usize) -> f64 {
        let level = self.c * enlarged;
        let on_boundary = |xi: Vector6<f64>| xi * (level / self.value(&xi)).sqrt();
        let factor = self.p.cholesky().unwrap().l();
        let mut deviates = Deviates::seeded(41);
        let mut direction = || {
            let point = Vector6::from_fn(|_, _| deviates.normal()).normalize();
            (
                factor.tr_solve_lower_triangular(&point).unwrap(),
                deviates.uniform(),
            )
        };
        let mut worst = (f64::INFINITY, Vector6::zeros());
        let visit = |xi: Vector6<f64>, worst: &mut (f64, Vector6<f64>)| {
            let margin = self.margin_from(&xi);
            if !(margin >= worst.0) {
                *worst = (margin, xi);
            }
        };
        for xi in self.fullest() {
            visit(on_boundary(xi), &mut worst);
        }
        for _ in 0..directions {
            let (xi, inside) = direction();
            visit(on_boundary(xi), &mut worst);
            visit(on_boundary(xi) * inside.sqrt(), &mut worst);
        }
        for radius in [0.3, 0.1, 0.03, 0.01, 0.003] {
            for _ in 0..400 {
                let from = worst.1 / level.sqrt();
                visit(on_boundary(from + direction().0 * radius), &mut worst);
            }
        }
        worst.0
    }
}

#[test]
fn from_every_point_of_the_terminal_set_the_needle_keeps_limits_and_the_cost_falls() {
    for (v_mm_s, omega_rad_s) in [(HELIX.v_mm_s, HELIX.omega_rad_s), (3.0, -2.5), (7.9, -1.0)] {
        let set = Set::of(Input {
            v_mm_s,
            omega_rad_s,
        });
        let margin = set.least_margin(1.0, DIRECTIONS);
        assert!(margin > 0.0, "v {v_mm_s}, omega {omega_rad_s}: {margin}");
        // Not so of a set twice as large, for want of descent: the check can fail.
        let beyond = set.least_margin(2.0, DIRECTIONS / 10);
        assert!(beyond < 0.0, "v {v_mm_s}, omega {omega_rad_s}: {beyond}");
    }
}
