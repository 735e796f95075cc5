//! How many random problems of each kind both solvers settle as asked: a feasible one solved, an infeasible one proved to be so with a residual below 1e-7
//! (Clarabel: any proof). What is left over comes with seed, size and horizon, so that it can be looked at. Prints the table of `docs/performance.md`.

#![allow(clippy::print_stdout, reason = "the table is the product")]

use mpc_qp::problems::random::{self, Recipe};
use mpc_qp::{
    ClarabelSolver, OcpQp, OcpSolver, Solution, SolveError, SolveStatus, SolverSettings, Start,
    StructuredSolver,
};

const SEEDS: std::ops::Range<u64> = 2000..2250;

const LONGEST: usize = 60;

/// Recipe of a seed with at most so many stages.
type RecipeOf = fn(u64, usize) -> Recipe;

/// Residual that a proof may have: ours are exact but for rounding where inputs are bounded.
const PROOFS: [f64; 2] = [1e-7, 1e-4];

const FEASIBLE: &str = "recipes have a stage at least, and weights in range";

#[derive(Default)]
struct Account {
    settled: usize,
    iterations: Vec<usize>,
    left_over: Vec<String>,
}

impl Account {
    fn enter<const NX: usize, const NU: usize>(
        &mut self,
        (seed, recipe): (u64, &Recipe),
        proof: f64,
        solution: &Solution<NX, NU>,
    ) {
        self.iterations.push(solution.iterations);
        let (kind, settled) = match solution.status {
            SolveStatus::Solved => ("Solved".to_owned(), recipe.is_feasible()),
            SolveStatus::PrimalInfeasible { certificate, .. } => (
                format!("proof to {:.0e}", certificate.residual),
                !recipe.is_feasible() && certificate.residual <= proof,
            ),
            status => (format!("{status:?}"), false),
        };
        if settled {
            self.settled += 1;
        } else {
            let horizon = recipe.horizon;
            self.left_over
                .push(format!("{kind} ({NX}/{NU}, N = {horizon}, seed {seed})"));
        }
    }

    fn print(&mut self, kind: &str, solver: &str) {
        self.iterations.sort_unstable();
        let (count, sum) = (self.iterations.len(), self.iterations.iter().sum::<usize>());
        println!(
            "| {kind} | {solver} | {} of {count} | {} | {} | {:.0} | {} |",
            self.settled,
            self.left_over.join("; "),
            self.iterations[count / 2],
            sum as f64 / count as f64,
            self.iterations[count - 1],
        );
    }
}

fn both<const NX: usize, const NU: usize>(
    accounts: &mut [Account; 2],
    recipe_of: RecipeOf,
) -> Result<(), SolveError> {
    let settings = SolverSettings::default();
    for seed in SEEDS {
        let recipe = recipe_of(seed, LONGEST);
        let problem: OcpQp<NX, NU> = random::problem(seed, &recipe).expect(FEASIBLE);
        let mut solution = Solution::new(&problem);
        StructuredSolver::new(&problem, settings)?.solve(&problem, Start::Cold, &mut solution)?;
        accounts[0].enter((seed, &recipe), PROOFS[0], &solution);
        ClarabelSolver::new(&problem, settings)?.solve(&problem, Start::Cold, &mut solution)?;
        accounts[1].enter((seed, &recipe), PROOFS[1], &solution);
    }
    Ok(())
}

fn main() -> Result<(), SolveError> {
    let kinds: [(&str, RecipeOf); 4] = [
        ("feasible, solved", Recipe::feasible),
        ("softened, solved", Recipe::softened),
        ("badly scaled, solved", Recipe::badly_scaled),
        ("infeasible, proved", Recipe::infeasible),
    ];
    println!("| kind | solver | settled as asked | left over | iterations: median | mean | most |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for (kind, recipe_of) in kinds {
        let mut accounts = <[Account; 2]>::default();
        both::<4, 2>(&mut accounts, recipe_of)?;
        both::<9, 3>(&mut accounts, recipe_of)?;
        both::<12, 4>(&mut accounts, recipe_of)?;
        accounts[0].print(kind, "structured");
        accounts[1].print(kind, "Clarabel");
    }
    Ok(())
}
