//! The conditions of a certificate, one function each, in floating point and exactly.
//!
//! The margin is always computed in floating point; an exact decision, where there is one, overrides the verdict.

use crate::arithmetic::dense::cholesky;
use crate::arithmetic::exact::Exact;
use crate::certificate::record::{Certificate, Check, Rigour, Witness};
use crate::input::InputError;
use crate::riccati::problem::Problem;
use crate::terminal_set::constraints::{Constraints, LawRow};
use crate::terminal_set::ellipsoid::Ellipsoid;
use faer::{Mat, Side};

/// Exact A_K, stage cost and the change of the input under the law.
#[derive(Debug)]
pub(crate) struct ExactLaw {
    pub(crate) closed_loop: Exact,
    stage: Exact,
    pub(crate) k: Exact,
    pub(crate) change: Exact,
}

impl ExactLaw {
    pub(crate) fn new(problem: &Problem, k: &Mat<f64>) -> Self {
        let k = Exact::of(k);
        let closed_loop = Exact::of(&problem.a).add(&Exact::of(&problem.b).mul(&k));
        let mut stage = Exact::of(&problem.q).add(&Exact::of(&problem.r).congruence(&k));
        if let Some(s) = &problem.s {
            let sk = Exact::of(s).mul(&k);
            stage = stage.add(&sk).add(&sk.transpose());
        }
        let change = k.mul(&closed_loop.sub(&Exact::identity(problem.states())));
        Self {
            closed_loop,
            stage,
            k,
            change,
        }
    }

    /// Whether p - A_K' next A_K - theta l is positive semidefinite.
    pub(crate) fn decrease(&self, p: &Mat<f64>, next: &Mat<f64>, theta: f64) -> bool {
        let fall = Exact::of(p).sub(&Exact::of(next).congruence(&self.closed_loop));
        fall.sub(&self.stage.times(&Exact::number(theta)))
            .is_definite(false)
    }

    /// The rows f of the constraints for u = Kx and u+ - u = change x.
    pub(crate) fn rows(&self, constraints: &Constraints, change: &Exact) -> Vec<Exact> {
        let row = |values: &[f64]| Exact::of(&Mat::from_fn(1, values.len(), |_, j| values[j]));
        constraints
            .rows()
            .iter()
            .map(|c| {
                row(&c.on_x)
                    .add(&row(&c.on_u).mul(&self.k))
                    .add(&row(&c.on_rate).mul(change))
            })
            .collect()
    }
}

/// Says that the data of a claim are no data: nothing else is then tested.
pub(crate) fn malformed(rigour: Rigour, error: &InputError) -> Certificate {
    let check = Check {
        name: "data".to_owned(),
        condition: error.to_string(),
        holds: false,
        margin: f64::NEG_INFINITY,
        tolerance: 0.0,
        witness: None,
    };
    Certificate {
        rigour,
        checks: vec![check],
    }
}

/// h^2 S - c f'f >= 0, decided exactly.
pub(crate) fn admissible(set: &Mat<f64>, level: f64, row: &Exact, bound: f64) -> bool {
    let bound = Exact::number(bound);
    let outer = row.transpose().mul(row).times(&Exact::number(level));
    Exact::of(set)
        .times(&bound.mul(&bound))
        .sub(&outer)
        .is_definite(false)
}

pub(crate) fn admissibility_check(
    set: Option<&Ellipsoid>,
    row: &LawRow,
    proof: Option<bool>,
) -> Check {
    let tolerance = if proof.is_some() { 0.0 } else { 1e-9 };
    let value = set
        .and_then(|set| set.support(&row.row).ok())
        .unwrap_or(f64::INFINITY);
    let factor = if value == 0.0 { 0.0 } else { value / row.bound };
    let margin = 1.0 - factor;
    let holds = proof.unwrap_or(margin >= -tolerance);
    let witness = set
        .filter(|_| !holds)
        .and_then(|set| set.extreme_point(&row.row).ok())
        .map(|state| Witness {
            state,
            value,
            bound: row.bound,
            factor,
        });
    Check {
        name: row.name.clone(),
        condition: format!("max over the set <= {}", row.bound),
        holds,
        margin,
        tolerance,
        witness,
    }
}

/// a <= V / |x|^2 <= b with the extreme eigenvalues, moved outwards past their rounding.
pub(crate) fn bounds_of_cost(p: &Mat<f64>, rigour: Rigour) -> Vec<Check> {
    let n = p.nrows();
    // Without eigenvalues both bounds fail.
    let (least, largest) = match p.self_adjoint_eigenvalues(Side::Lower) {
        Ok(values) => (
            values.iter().copied().fold(f64::INFINITY, f64::min),
            values.iter().copied().fold(0.0, f64::max),
        ),
        Err(_) => (f64::NEG_INFINITY, f64::INFINITY),
    };
    let rounding = 8.0 * n as f64 * f64::EPSILON * largest;
    let (lower, upper) = (least - rounding, largest + rounding);
    let scaled = |c: f64| Exact::identity(n).times(&Exact::number(c));
    let (below, above) = match rigour {
        Rigour::Floating => (cholesky(p).is_some() && least > 0.0, upper.is_finite()),
        Rigour::Exact if lower.is_finite() && upper.is_finite() => (
            // Where rounding hides the least eigenvalue the bound is not shown but P > 0 still is.
            Exact::of(p)
                .sub(&scaled(lower.max(0.0)))
                .is_definite(lower <= 0.0),
            scaled(upper).sub(&Exact::of(p)).is_definite(false),
        ),
        Rigour::Exact => (false, false),
    };
    let check = |name: &str, condition: &str, holds, margin| Check {
        name: name.to_owned(),
        condition: condition.to_owned(),
        holds,
        margin,
        tolerance: 0.0,
        witness: None,
    };
    vec![
        check(
            "lower bound",
            "V(x) >= margin |x|^2, V(x) > 0",
            below,
            lower.max(0.0),
        ),
        check("upper bound", "V(x) <= margin |x|^2", above, upper),
    ]
}

/// A check that `m` is positive semidefinite; `proof` overrides the floating-point verdict.
pub(crate) fn semidefinite(
    name: &str,
    condition: &str,
    m: &Mat<f64>,
    scale: f64,
    proof: Option<bool>,
) -> Check {
    let n = m.nrows();
    let tolerance = if proof.is_some() {
        0.0
    } else {
        64.0 * n as f64 * f64::EPSILON * scale
    };
    let mut margin = f64::NEG_INFINITY;
    let mut state = Vec::new();
    if let Ok(eigen) = m.self_adjoint_eigen(Side::Lower) {
        let values = eigen.S().column_vector();
        if let Some(least) = (0..n).min_by(|&i, &j| values[i].total_cmp(&values[j])) {
            margin = values[least];
            state = (0..n).map(|i| eigen.U()[(i, least)]).collect();
        }
    }
    let holds = proof.unwrap_or(margin >= -tolerance);
    let witness = (!holds).then(|| Witness {
        state,
        value: -margin,
        bound: 0.0,
        factor: f64::INFINITY,
    });
    Check {
        name: name.to_owned(),
        condition: condition.to_owned(),
        holds,
        margin,
        tolerance,
        witness,
    }
}
