//! Certificates: each condition of a stability argument as a named check with its margin.
//!
//! [`Rigour::Floating`] compares eigenvalues with zero up to rounding. [`Rigour::Exact`] decides every matrix inequality in integer arithmetic on the
//! stored doubles: a proof, with no tolerance. What the conditions are is the business of the claims,
//! [`TerminalClaim`](crate::TerminalClaim) and [`ChainClaim`](crate::ChainClaim).

use serde::{Deserialize, Deserializer, Serialize};

/// What a verdict rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Rigour {
    /// Floating-point eigenvalues, with a tolerance of the size of their rounding.
    Floating,
    /// Integer arithmetic on the stored doubles: proved or refuted, no tolerance.
    Exact,
}

/// A state that shows by how much a condition fails.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Witness {
    /// The state, length n.
    pub state: Vec<f64>,
    /// What is bounded, at that state.
    #[serde(deserialize_with = "infinite_if_null")]
    pub value: f64,
    /// Its bound.
    pub bound: f64,
    /// value / bound; infinite for a bound of zero, which JSON writes as null.
    #[serde(deserialize_with = "infinite_if_null")]
    pub factor: f64,
}

fn infinite_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let factor = Option::<f64>::deserialize(deserializer)?;
    Ok(factor.unwrap_or(f64::INFINITY))
}

fn minus_infinite_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    infinite_if_null(deserializer).map(|x| if x == f64::INFINITY { -x } else { x })
}

/// One condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Its name, that of the constraint for admissibility.
    pub name: String,
    /// What was tested, as a formula.
    pub condition: String,
    /// The verdict, at the certificate's level of rigour.
    pub holds: bool,
    /// Distance from failing, in floating point: the least eigenvalue of the matrix in `condition`, the bound itself for
    /// `lower bound` and `upper bound`, and for a constraint 1 - (largest value in the set) / limit. Minus infinity, for a limit of zero
    /// or data that are none (check `data`), is null in JSON.
    #[serde(deserialize_with = "minus_infinite_if_null")]
    pub margin: f64,
    /// Negative margins down to here counted as rounding; zero in an exact certificate.
    pub tolerance: f64,
    /// A state that violates the condition, where it fails.
    pub witness: Option<Witness>,
}

/// The checks of one claim.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// What the verdicts rest on.
    pub rigour: Rigour,
    /// The conditions in the order of the argument.
    pub checks: Vec<Check>,
}

impl Certificate {
    /// Whether every condition holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.checks.iter().all(|check| check.holds)
    }

    /// The conditions that fail.
    pub fn failures(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| !check.holds)
    }
}

impl std::fmt::Display for Certificate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let width = self
            .checks
            .iter()
            .map(|check| check.name.len())
            .max()
            .unwrap_or(0)
            .max(5);
        let level = match self.rigour {
            Rigour::Floating => "floating point",
            Rigour::Exact => "exact",
        };
        writeln!(f, "{:width$} | {level:14} | margin    | condition", "check")?;
        for check in &self.checks {
            let verdict = if check.holds { "holds" } else { "FAILS" };
            write!(
                f,
                "{:width$} | {verdict:14} | {:9.2e} | {}",
                check.name, check.margin, check.condition
            )?;
            if let Some(witness) = &check.witness {
                write!(
                    f,
                    "; {:.4e} against {:.4e}, factor {:.4e}, at {:.4?}",
                    witness.value, witness.bound, witness.factor, witness.state
                )?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_infinite_factor_survives_json() {
        let witness = Witness {
            state: vec![1.0, -2.0],
            value: 0.5,
            bound: 0.0,
            factor: f64::INFINITY,
        };
        let text = serde_json::to_string(&witness).unwrap();
        assert_eq!(serde_json::from_str::<Witness>(&text).unwrap(), witness);
    }
}
