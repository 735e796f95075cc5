//! Soft inequalities: the passes of `bounds` for sign v <= bound + e with a price on the slack e.
//!
//! Quadratic price rho/2 e^2: e = z / rho is eliminated. Exact price rho e, e >= 0: its multiplier is nu = rho - z.
//! Both end as dz = w (sign dv + r + target / z - s + shift) with the weight w = 1 / (s / z + kappa), where
//! kappa = 1 / rho, shift = 0 (quadratic) or kappa = e / nu, shift = e - target_e / nu (exact). The hard
//! constraint is kappa = shift = 0.

use super::bounds::{Lane, Reach};
use super::kernel::larger;

/// The price of a side's slacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Price {
    /// No slack.
    Hard,
    /// rho e.
    Exact(f64),
    /// rho/2 e^2.
    Quadratic(f64),
}

/// Slacks of four soft inequalities.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlackLane {
    /// Slack of the exact penalty, positive.
    pub(super) e: [f64; 4],
    /// Its multiplier, positive.
    pub(super) nu: [f64; 4],
    de: [f64; 4],
    kappa: [f64; 4],
    shift: [f64; 4],
}

impl SlackLane {
    /// Unit slacks.
    pub(super) const ONE: Self = Self {
        e: [1.0; 4],
        nu: [1.0; 4],
        de: [0.0; 4],
        kappa: [0.0; 4],
        shift: [0.0; 4],
    };
}

/// Starts soft bounds on their central path: products `mu`, and no residual however far beyond the bound the value is.
pub(super) fn enter(side: &mut [Lane], slacks: &mut [SlackLane], price: Price, mu: f64) {
    for (lane, soft) in side.iter_mut().zip(slacks) {
        for i in 0..4 {
            if lane.on[i] == 0.0 {
                continue;
            }
            // bound - value
            let room = lane.s[i] - lane.r[i];
            match price {
                Price::Hard => continue,
                // s - z / rho = room
                Price::Quadratic(rho) => lane.z[i] = positive_root(room * rho, mu * rho),
                // s - e = room, z + nu = rho
                Price::Exact(rho) => {
                    let part = |room: f64| mu * rho / (mu + positive_root(-room * rho, mu * mu));
                    (lane.z[i], soft.nu[i]) = (part(room), part(-room));
                    soft.e[i] = mu / soft.nu[i];
                }
            }
            lane.s[i] = mu / lane.z[i];
            lane.r[i] = 0.0;
        }
    }
}

/// The positive root of `t^2 + b t = c`, without cancellation; c > 0.
fn positive_root(b: f64, c: f64) -> f64 {
    let root = (0.5 * b).hypot(c.sqrt());
    if b > 0.0 {
        c / (0.5 * b + root)
    } else {
        root - 0.5 * b
    }
}

/// Weights and affine forces.
pub(super) fn weigh(
    (side, slacks): (&mut [Lane], &mut [SlackLane]),
    sign: f64,
    price: Price,
    weight: &mut [[f64; 4]],
    force: &mut [[f64; 4]],
) {
    for (((lane, slack), weight), force) in side.iter_mut().zip(slacks).zip(weight).zip(force) {
        for i in 0..4 {
            (slack.kappa[i], slack.shift[i]) = match price {
                Price::Exact(_) => (slack.e[i] / slack.nu[i], slack.e[i]),
                Price::Quadratic(rho) => (1.0 / rho, 0.0),
                Price::Hard => (0.0, 0.0),
            };
            lane.inv[i] = 1.0 / lane.s[i];
            lane.w[i] = lane.on[i] / (lane.s[i] / lane.z[i] + slack.kappa[i]);
            weight[i] += lane.w[i];
            let rest = lane.r[i] - lane.s[i] + slack.shift[i];
            force[i] += sign * (lane.on[i] * lane.z[i] + lane.w[i] * rest);
            lane.target[i] = 0.0;
        }
    }
}

/// The direction for the present targets, and how far it may go.
pub(super) fn aim(
    (side, slacks): (&mut [Lane], &mut [SlackLane]),
    sign: f64,
    price: Price,
    dv: &[[f64; 4]],
) -> Reach {
    let mut reach = Reach::FREE;
    for ((lane, slack), dv) in side.iter_mut().zip(slacks).zip(dv) {
        for i in 0..4 {
            let (s, z) = (lane.s[i], lane.z[i]);
            let aim = lane.on[i] * lane.target[i] / z;
            let rest = sign * dv[i] + lane.r[i] + aim - s + slack.shift[i];
            let dz = lane.w[i] * rest;
            let ds = lane.on[i] * (aim - s - s / z * dz);
            reach.ratio = larger(reach.ratio, larger(-ds / s, -dz / z));
            reach.product += ds * dz;
            if let Price::Exact(_) = price {
                let de = lane.on[i] * (slack.kappa[i] * dz - slack.shift[i]);
                reach.ratio = larger(reach.ratio, larger(-de / slack.e[i], dz / slack.nu[i]));
                reach.product -= de * dz;
                slack.de[i] = de;
            }
            lane.ds[i] = ds;
            lane.dz[i] = dz;
        }
    }
    reach
}

/// Forces of the corrector; without a target the products stay what they are.
pub(super) fn correct(
    (side, slacks): (&mut [Lane], &mut [SlackLane]),
    sign: f64,
    price: Price,
    target_mu: Option<f64>,
    force: &mut [[f64; 4]],
) {
    for ((lane, slack), force) in side.iter_mut().zip(slacks).zip(force) {
        for i in 0..4 {
            (lane.target[i], slack.shift[i]) = match (target_mu, price) {
                (None, _) => (lane.on[i] * lane.s[i] * lane.z[i], 0.0),
                (Some(mu), Price::Exact(_)) => (
                    lane.on[i] * (mu - lane.ds[i] * lane.dz[i]),
                    slack.e[i] - (mu + slack.de[i] * lane.dz[i]) / slack.nu[i],
                ),
                (Some(mu), _) => (lane.on[i] * (mu - lane.ds[i] * lane.dz[i]), 0.0),
            };
            let rest = lane.r[i] + lane.target[i] / lane.z[i] - lane.s[i] + slack.shift[i];
            force[i] += sign * (lane.on[i] * lane.z[i] + lane.w[i] * rest);
        }
    }
}

/// Moves the slacks (the lanes are moved by `bounds::advance`); returns the sum of e nu.
pub(super) fn advance(
    (side, slacks): (&[Lane], &mut [SlackLane]),
    price: Price,
    alpha: f64,
) -> f64 {
    let Price::Exact(_) = price else { return 0.0 };
    let mut gap = 0.0;
    for (lane, slack) in side.iter().zip(slacks) {
        for i in 0..4 {
            slack.e[i] += alpha * slack.de[i];
            slack.nu[i] -= alpha * lane.dz[i];
            gap += lane.on[i] * slack.e[i] * slack.nu[i];
        }
    }
    gap
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structured::StructuredSolver;
    use crate::{
        OcpQp, OcpSolver, Penalty, Softening, Solution, SolveStatus, SolverSettings, Stage, Start,
        Terminal, TerminalSet,
    };
    use nalgebra::{Matrix1, Matrix2, Vector1, Vector2};

    fn solve<const NX: usize>(problem: &OcpQp<NX, 1>) -> Solution<NX, 1> {
        let mut solution = Solution::new(problem);
        let mut solver = StructuredSolver::new(problem, SolverSettings::default()).unwrap();
        solver.solve(problem, Start::Cold, &mut solution).unwrap();
        solution
    }

    #[test]
    fn soft_bounds_start_on_their_central_path_wherever_the_value_is() {
        for price in [Price::Exact(1.0), Price::Exact(1e6), Price::Quadratic(1e6)] {
            for (room, mu) in [
                (-1e9, 1.0),
                (-3.0, 1e-6),
                (0.0, 1.0),
                (2.0, 1e6),
                (1e9, 1.0),
            ] {
                let mut lane = Lane::OFF;
                (lane.on, lane.s, lane.r) = ([1.0; 4], [1.0; 4], [1.0 - room; 4]);
                let mut slack = SlackLane::ONE;
                let (side, slacks) = (&mut [lane], &mut [slack]);
                enter(side, slacks, price, mu);
                (lane, slack) = (side[0], slacks[0]);
                let (s, z) = (lane.s[0], lane.z[0]);
                let growth = match price {
                    Price::Exact(rho) => {
                        let (e, nu) = (slack.e[0], slack.nu[0]);
                        assert!((e * nu - mu).abs() <= 1e-12 * mu && e > 0.0, "{room} {mu}");
                        assert!((z + nu - rho).abs() <= 1e-12 * rho, "{room} {mu}");
                        e
                    }
                    Price::Quadratic(rho) => z / rho,
                    Price::Hard => 0.0,
                };
                // A few roundings of the larger of the two.
                assert!((s * z - mu).abs() <= 1e-12 * mu && s > 0.0, "{room} {mu}");
                let missed = (s - growth - room).abs();
                assert!(missed <= 1e-12 * (s + growth), "{room} {mu}: {missed:e}");
            }
        }
    }

    // The set is up to 1e9 away from where any input within its bounds leads. One of the nine ends as trouble.
    #[test]
    fn unstable_lag_with_every_state_constraint_soft_is_never_refused() {
        let mut solved = 0;
        for growth in [1.05, 1.1, 1.2] {
            for horizon in [20, 50, 100] {
                let mut stage = Stage::new(Matrix1::new(growth), Matrix1::new(0.05));
                (stage.q, stage.r) = (Matrix1::new(1.0), Matrix1::new(1e-4));
                (stage.u_min[0], stage.u_max[0]) = (-1.0, 1.0);
                (stage.x_min[0], stage.x_max[0]) = (-10.0, 10.0);
                let mut terminal = Terminal::new(Matrix1::new(1.0));
                terminal.set = TerminalSet::Ellipsoid {
                    shape: Matrix1::new(1.0),
                    center: Vector1::zeros(),
                    level: 0.1,
                };
                let problem = OcpQp::new(Vector1::new(9.0), vec![stage; horizon], terminal);
                let penalty = Penalty::Exact { weight: 30.0 };
                let softening = Softening {
                    state_bounds: penalty,
                    rows: penalty,
                    terminal_set: penalty,
                };
                let problem = problem.unwrap().with_softening(softening).unwrap();
                let status = solve(&problem).status;
                let refused = matches!(status, SolveStatus::PrimalInfeasible { .. });
                assert!(!refused, "{growth}, N = {horizon}: {status:?}");
                solved += usize::from(status == SolveStatus::Solved);
            }
        }
        assert!(solved >= 6, "{solved} of 9 solved");
    }

    // One input cannot mend position and speed in one stage: 100 iterations before the ray was tried.
    #[test]
    fn contradictory_equalities_are_refused_at_once() {
        for start in [0.02, 1.0, 50.0] {
            let mut stage = Stage::new(Matrix2::new(1.0, 0.5, 0.0, 1.0), Vector2::new(0.125, 0.5));
            (stage.q, stage.r) = (Matrix2::identity(), Matrix1::new(0.1));
            (stage.u_min[0], stage.u_max[0]) = (-1.0, 1.0);
            let mut terminal = Terminal::new(Matrix2::zeros());
            terminal.set = TerminalSet::Equality {
                target: Vector2::zeros(),
            };
            let problem = OcpQp::new(Vector2::new(start, 0.0), vec![stage], terminal);
            let solution = solve(&problem.unwrap());
            let refused = matches!(solution.status, SolveStatus::PrimalInfeasible { .. });
            assert!(refused, "{start}: {:?}", solution.status);
            assert!(
                solution.iterations <= 20,
                "{start}: {}",
                solution.iterations
            );
        }
    }
}
