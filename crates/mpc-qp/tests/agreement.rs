//! The structured solver against Clarabel and against closed forms.

#![expect(clippy::unwrap_used, reason = "helpers of tests may fail loudly")]

use mpc_qp::problems::known::{self, KnownProblem};
use mpc_qp::problems::random::{self, Recipe, SetKind};
use mpc_qp::problems::tracking::Tracking;
use mpc_qp::{
    ClarabelSolver, OcpQp, OcpSolver, ProblemError, Solution, SolveStatus, SolverSettings, Start,
    StructuredSolver, TerminalSetMultipliers,
};
use nalgebra::{Vector2, Vector6};

fn structured<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> Solution<NX, NU> {
    let mut solution = Solution::new(problem);
    let mut solver = StructuredSolver::new(problem, SolverSettings::default()).unwrap();
    solver.solve(problem, Start::Cold, &mut solution).unwrap();
    solution
}

fn clarabel<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> Solution<NX, NU> {
    let mut solution = Solution::new(problem);
    let mut solver = ClarabelSolver::new(problem, SolverSettings::default()).unwrap();
    solver.solve(problem, Start::Cold, &mut solution).unwrap();
    solution
}

/// Objectives to 1e-7 relative, each solver stopping at 1e-8. Where the two first inputs differ by more than 1e-5 the
/// cost must be flat between them, which equal objectives of two feasible points show.
fn agree<const NX: usize, const NU: usize>(seeds: std::ops::Range<u64>) -> (usize, usize) {
    let (mut compared, mut close) = (0, 0);
    for seed in seeds {
        let problem = random::problem::<NX, NU>(seed, &Recipe::feasible(seed, 20)).unwrap();
        let (ours, theirs) = (structured(&problem), clarabel(&problem));
        if ours.status != SolveStatus::Solved || theirs.status != SolveStatus::Solved {
            continue;
        }
        compared += 1;
        let size = theirs.objective.abs().max(1.0);
        assert!(
            (ours.objective - theirs.objective).abs() <= 1e-7 * size,
            "NX {NX} NU {NU} seed {seed}: {} and {}",
            ours.objective,
            theirs.objective
        );
        assert!(
            ours.residuals.worst() <= 1e-6,
            "seed {seed}: {:?}",
            ours.residuals
        );
        close += usize::from((ours.u[0] - theirs.u[0]).amax() <= 1e-5);
    }
    (compared, close)
}

#[test]
fn both_solvers_find_the_same_cost_and_first_input() {
    let counts = [
        agree::<1, 1>(0..40),
        agree::<2, 1>(0..40),
        agree::<4, 2>(0..40),
        agree::<6, 2>(0..40),
    ];
    let (compared, close) = counts
        .iter()
        .fold((0, 0), |sum, count| (sum.0 + count.0, sum.1 + count.1));
    assert!(compared >= 152, "only {compared} of 160 solved by both");
    // Near-degenerate problems leave the first input to rounding.
    assert!(
        close * 100 >= compared * 95,
        "first inputs agree on {close} of {compared}"
    );
}

fn infeasible_for_us<const NX: usize, const NU: usize>(seeds: std::ops::Range<u64>) -> usize {
    seeds
        .filter(|&seed| {
            let problem = random::problem::<NX, NU>(seed, &Recipe::infeasible(seed, 20)).unwrap();
            let solution = structured(&problem);
            assert!(!solution.status.has_solution(), "seed {seed}: {:?}", solution.status);
            matches!(solution.status, SolveStatus::PrimalInfeasible { certificate, .. } if certificate.residual <= 1e-7)
        })
        .count()
}

#[test]
fn planted_contradictions_are_never_solved_and_mostly_proved() {
    let proved = infeasible_for_us::<1, 1>(0..40)
        + infeasible_for_us::<2, 1>(0..40)
        + infeasible_for_us::<4, 2>(0..40);
    // The rest ends as numerical trouble, never as a solution.
    assert!(proved >= 108, "proved {proved} of 120");
}

fn matches_known<const NX: usize, const NU: usize>(
    known: Result<KnownProblem<NX, NU>, ProblemError>,
) {
    let known = known.unwrap();
    let solution = structured(&known.problem);
    assert_eq!(solution.status, SolveStatus::Solved);
    let error = (solution.objective - known.objective).abs();
    assert!(
        error <= 1e-7 * known.objective.abs().max(1.0),
        "{} for {}",
        solution.objective,
        known.objective
    );
    for (found, exact) in solution.u.iter().zip(&known.u) {
        // As in `known_answers`: inputs of a transfer reach 300.
        assert!((found - exact).amax() <= 1e-5, "{found} for {exact}");
    }
}

#[test]
fn scalar_steps_equal_their_closed_forms() {
    matches_known(known::one_scalar_step(1.0, 1.0, 3.0, 1.0));
    matches_known(known::one_scalar_step(10.0, 1.0, 3.0, 1.0));
}

#[test]
fn double_integrator_saturates_as_in_the_closed_form() {
    matches_known(known::saturated_double_integrator(60));
}

#[test]
fn least_effort_transfer_equals_its_closed_form() {
    for horizon in [2, 3, 10, 40] {
        matches_known(known::least_effort_double_integrator(horizon));
    }
}

#[test]
fn straight_needle_equals_its_riccati_cost() {
    matches_known(known::straight_needle(Vector2::new(3.0, -2.0), 30));
}

#[test]
fn degenerate_problems_equal_their_closed_forms() {
    matches_known(known::redundant_rows());
    matches_known(known::start_on_terminal_boundary(5));
}

#[test]
fn unconstrained_problem_takes_one_sweep() {
    for seed in 0..20 {
        let recipe = Recipe {
            input_bounds: false,
            rate_limits: false,
            state_bounds: false,
            rows: 0,
            set: SetKind::None,
            ..Recipe::feasible(seed, 40)
        };
        let problem = random::problem::<6, 2>(seed, &recipe).unwrap();
        let solution = structured(&problem);
        assert_eq!(
            (solution.status, solution.iterations),
            (SolveStatus::Solved, 1)
        );
        assert!(
            solution.residuals.worst() <= 1e-9,
            "{:?}",
            solution.residuals
        );
    }
}

#[test]
fn refilled_equals_freshly_made() {
    let tracking = Tracking::default();
    let first = tracking.problem(Tracking::start(0), 12, true).unwrap();
    let mut solver = StructuredSolver::new(&first, SolverSettings::default()).unwrap();
    let mut solution = Solution::new(&first);
    for seed in 1..30 {
        let problem = tracking.problem(Tracking::start(seed), 12, true).unwrap();
        solver.solve(&problem, Start::Cold, &mut solution).unwrap();
        let fresh = structured(&problem);
        // The same arithmetic on the same numbers: nothing may be left over from the problem before.
        assert_eq!(solution.u, fresh.u, "seed {seed}");
        assert_eq!(solution.multipliers, fresh.multipliers, "seed {seed}");
    }
}

#[test]
fn warm_closed_loop_gives_the_cold_answers_in_fewer_sweeps() {
    let tracking = Tracking::default();
    let (mut x, mut last) = (Tracking::start(3), Vector2::zeros());
    let mut problem = tracking.problem(x, 20, false).unwrap();
    let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
    let mut warm = Solution::new(&problem);
    let (mut warm_sweeps, mut cold_sweeps) = (0, 0);
    for step in 0..70 {
        problem.set_initial_state(&x).unwrap();
        problem.set_previous_input(&last).unwrap();
        let start = if step == 0 { Start::Cold } else { Start::Warm };
        solver.solve(&problem, start, &mut warm).unwrap();
        let cold = structured(&problem);
        assert_eq!(warm.status, SolveStatus::Solved);
        // Both are active-set answers: exact but for rounding times the conditioning.
        assert!((warm.u[0] - cold.u[0]).amax() <= 1e-7, "step {step}");
        warm_sweeps += warm.iterations;
        cold_sweeps += cold.iterations;
        last = warm.u[0];
        x = tracking.stage.successor(&x, &last) + Tracking::start(1000 + step) * 0.01;
        warm.shift(&problem).unwrap();
    }
    assert!(warm_sweeps < cold_sweeps, "{warm_sweeps} and {cold_sweeps}");
}

#[test]
fn active_ellipsoid_has_its_multiplier_on_the_boundary_of_the_cone() {
    let tracking = Tracking::default();
    let mut active = 0;
    for seed in 0..20 {
        let problem = tracking.problem(Tracking::start(seed), 8, true).unwrap();
        let solution = structured(&problem);
        assert_eq!(solution.status, SolveStatus::Solved, "seed {seed}");
        let TerminalSetMultipliers::Ellipsoid { radius, offset } =
            solution.multipliers.terminal.set
        else {
            panic!("the set is an ellipsoid");
        };
        if radius > 1e-4 {
            active += 1;
            assert!((offset.norm() - radius).abs() <= 1e-6 * radius);
        }
    }
    assert!(active > 0, "no problem reached the ellipsoid");
}

#[test]
fn a_lone_bad_guess_does_not_change_the_answer() {
    let tracking = Tracking::default();
    let problem = tracking.problem(Tracking::start(5), 20, false).unwrap();
    let cold = structured(&problem);
    let mut solution = cold.clone();
    for (k, stage) in solution.multipliers.stages.iter_mut().enumerate() {
        stage.u_max[k % 2] += 1e3;
        stage.du_min[(k + 1) % 2] += 1e3;
    }
    solution.x.fill(Vector6::repeat(1e3));
    let mut solver = StructuredSolver::new(&problem, SolverSettings::default()).unwrap();
    solver.solve(&problem, Start::Warm, &mut solution).unwrap();
    assert_eq!(solution.status, SolveStatus::Solved);
    assert!((solution.u[0] - cold.u[0]).amax() <= 1e-7);
}
