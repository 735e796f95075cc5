//! Reads Clarabel's vectors back into stages, and its verdict into ours.

use super::inequality::{Inequality, Side};
use super::layout::Layout;
use crate::certificate::{cancel_opposite_multipliers, examine_certificate, make_exact};
use crate::multipliers::{TerminalSetMultipliers, TerminalSetSlacks};
use crate::problem::OcpQp;
use crate::softening::Penalty;
use crate::solution::{Solution, SolveStatus};
use clarabel::solver::{DefaultSolution, SolverStatus};
use nalgebra::SVector;

/// `price` turns Clarabel's multipliers, those of the scaled cost, into the problem's.
pub(super) fn extract<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    found: &DefaultSolution<f64>,
    price: f64,
    solution: &mut Solution<NX, NU>,
) {
    let n = problem.horizon();
    solution.iterations = found.iterations as usize;
    solution.x[0] = *problem.initial_state();
    for k in 0..n {
        solution.u[k] = block(&found.x, layout.input(k));
        solution.x[k + 1] = block(&found.x, layout.state(k + 1));
        // Clarabel adds z'(x_{k+1} - A x_k - ...): the costate with the other sign.
        solution.multipliers.costates[k] = block::<NX>(&found.z, k * NX) * -price;
    }
    clear_scalars(solution);
    for (offset, scalar) in layout.scalars.iter().enumerate() {
        if scalar.inequality.right(problem) == f64::INFINITY {
            continue;
        }
        let multiplier = price * finite(found.z[layout.equalities() + offset]);
        let slack = scalar
            .slack
            .map_or(0.0, |column| finite(found.x[column]).max(0.0));
        place(solution, scalar.inequality, multiplier, slack);
    }
    terminal_set(problem, layout, found, price, solution);
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

fn block<const M: usize>(values: &[f64], first: usize) -> SVector<f64, M> {
    SVector::from_fn(|i, _| finite(values[first + i]))
}

fn clear_scalars<const NX: usize, const NU: usize>(solution: &mut Solution<NX, NU>) {
    for stage in &mut solution.multipliers.stages {
        (stage.u_min, stage.u_max) = (SVector::zeros(), SVector::zeros());
        (stage.du_min, stage.du_max) = (SVector::zeros(), SVector::zeros());
        (stage.x_min, stage.x_max) = (SVector::zeros(), SVector::zeros());
        stage.rows.fill(0.0);
    }
    for stage in &mut solution.slacks.stages {
        (stage.x_min, stage.x_max) = (SVector::zeros(), SVector::zeros());
        stage.rows.fill(0.0);
    }
    let (multipliers, slacks) = (
        &mut solution.multipliers.terminal,
        &mut solution.slacks.terminal,
    );
    (multipliers.x_min, multipliers.x_max) = (SVector::zeros(), SVector::zeros());
    (slacks.x_min, slacks.x_max) = (SVector::zeros(), SVector::zeros());
    if let TerminalSetMultipliers::Polytope(values) = &mut multipliers.set {
        values.fill(0.0);
    }
    if let TerminalSetSlacks::Polytope(values) = &mut slacks.set {
        values.fill(0.0);
    }
}

fn place<const NX: usize, const NU: usize>(
    solution: &mut Solution<NX, NU>,
    inequality: Inequality,
    multiplier: f64,
    slack: f64,
) {
    let (multipliers, slacks) = (&mut solution.multipliers, &mut solution.slacks);
    match inequality {
        Inequality::Input {
            k,
            i,
            side: Side::Lower,
        } => multipliers.stages[k].u_min[i] = multiplier,
        Inequality::Input {
            k,
            i,
            side: Side::Upper,
        } => multipliers.stages[k].u_max[i] = multiplier,
        Inequality::Rate {
            k,
            i,
            side: Side::Lower,
        } => multipliers.stages[k].du_min[i] = multiplier,
        Inequality::Rate {
            k,
            i,
            side: Side::Upper,
        } => multipliers.stages[k].du_max[i] = multiplier,
        Inequality::State { k, i, side } => {
            let (to, violation) = match (multipliers.stages.get_mut(k), slacks.stages.get_mut(k)) {
                (Some(stage), Some(slacks)) => match side {
                    Side::Lower => (&mut stage.x_min, &mut slacks.x_min),
                    Side::Upper => (&mut stage.x_max, &mut slacks.x_max),
                },
                _ => match side {
                    Side::Lower => (&mut multipliers.terminal.x_min, &mut slacks.terminal.x_min),
                    Side::Upper => (&mut multipliers.terminal.x_max, &mut slacks.terminal.x_max),
                },
            };
            (to[i], violation[i]) = (multiplier, slack);
        }
        Inequality::Row { k, i } => {
            (multipliers.stages[k].rows[i], slacks.stages[k].rows[i]) = (multiplier, slack);
        }
        Inequality::Face { i } => {
            if let (TerminalSetMultipliers::Polytope(to), TerminalSetSlacks::Polytope(violations)) =
                (&mut multipliers.terminal.set, &mut slacks.terminal.set)
            {
                (to[i], violations[i]) = (multiplier, slack);
            }
        }
    }
}

fn terminal_set<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    layout: &Layout<NX, NU>,
    found: &DefaultSolution<f64>,
    price: f64,
    solution: &mut Solution<NX, NU>,
) {
    match &mut solution.multipliers.terminal.set {
        TerminalSetMultipliers::Equality(multiplier) => {
            *multiplier = block::<NX>(&found.z, layout.terminal_equality()) * price;
        }
        TerminalSetMultipliers::Ellipsoid { radius, offset } => {
            *radius = price * finite(found.z[layout.cone()]);
            *offset = block::<NX>(&found.z, layout.cone() + 1) * price;
        }
        _ => {}
    }
    let both_signs = matches!(problem.softening().terminal_set, Penalty::Exact { .. });
    match (&mut solution.slacks.terminal.set, layout.set_slack) {
        (TerminalSetSlacks::Equality(violation), Some(first)) => {
            *violation = block(&found.x, first);
            if both_signs {
                *violation -= block::<NX>(&found.x, first + NX);
            }
        }
        (TerminalSetSlacks::Equality(violation), None) => violation.fill(0.0),
        (TerminalSetSlacks::Ellipsoid(growth), column) => {
            *growth = column.map_or(0.0, |column| finite(found.x[column]).max(0.0));
        }
        _ => {}
    }
}

/// Clarabel's verdict, checked against the problem where it claims a proof or stopped early; `usable` is the worst shared
/// residual of an answer that is of use. What it ends with in a breakdown may be a ray all the same.
pub(super) fn status<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    verdict: SolverStatus,
    usable: f64,
    solution: &mut Solution<NX, NU>,
) -> SolveStatus {
    match verdict {
        SolverStatus::Solved | SolverStatus::AlmostSolved => SolveStatus::Solved,
        SolverStatus::MaxIterations => SolveStatus::IterationLimit,
        SolverStatus::MaxTime => SolveStatus::TimeLimit,
        SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
            proof(problem, solution).unwrap_or(SolveStatus::NumericalTrouble)
        }
        _ if solution.residuals.worst() <= usable => SolveStatus::SolvedInaccurate,
        _ => proof(problem, solution).unwrap_or(SolveStatus::NumericalTrouble),
    }
}

/// The multipliers as they came or made exact, whichever proves more; as they came if neither proves anything.
fn proof<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    solution: &mut Solution<NX, NU>,
) -> Option<SolveStatus> {
    let found = solution.multipliers.clone();
    cancel_opposite_multipliers(&mut solution.multipliers);
    let as_found = examine_certificate(problem, solution);
    let cancelled = solution.multipliers.clone();
    make_exact(problem, solution);
    let exact = examine_certificate(problem, solution);
    let rays = [(exact, None), (as_found, Some(cancelled))];
    let proofs = rays
        .into_iter()
        .filter(|((ray, _), _)| ray.is_proof(solution));
    let best =
        proofs.min_by(|((one, _), _), ((other, _), _)| one.residual.total_cmp(&other.residual));
    match best {
        Some(((certificate, blame), multipliers)) => {
            if let Some(multipliers) = multipliers {
                solution.multipliers = multipliers;
            }
            Some(SolveStatus::PrimalInfeasible { certificate, blame })
        }
        None => {
            solution.multipliers = found;
            None
        }
    }
}
