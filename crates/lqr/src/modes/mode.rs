//! What the Hautus tests find: modes that no input reaches, modes that the weight does not see.

use faer::c64;

/// An eigenvalue that rounding moves further than this is one of many that fit the data: a triple one moves by its cube root, 6e-6; of skewed
/// coordinates, in which some pair near the given one always has an unreached mode, 2e-5 was seen.
const SHARP: f64 = 1e-5;

/// A mode that no input reaches, up to the tolerance.
#[derive(Debug, Clone, PartialEq)]
pub struct UncontrollableMode {
    /// The eigenvalue lambda.
    pub eigenvalue: c64,
    /// Unit vector w with w*A = lambda w* and w*B = 0 up to `measure`: the direction in state space that
    /// no input reaches. Length n.
    pub left_eigenvector: Vec<c64>,
    /// Smallest singular value of [A - lambda I, B D] over 1 + |A|.
    pub measure: f64,
    /// A measure below this counts as zero.
    pub tolerance: f64,
    /// Largest entry of |w*(A - lambda I)| and |w*B|, each relative to the length of its column (balanced
    /// coordinates in a solver's error): columns changed by this fraction have exactly this mode.
    pub column_change: f64,
    /// How far rounding of A moves the eigenvalue, to first order: eps |A| / |w*v|, v the right eigenvector. Large in coordinates so
    /// skewed that many modes fit the data; computed only where `measure` is below `tolerance`, else zero.
    pub eigenvalue_shift: f64,
}

impl UncontrollableMode {
    /// Whether rounding of the given columns alone hides the input's effect: then no computation in double
    /// precision can tell the pair from one that this mode makes not stabilisable.
    #[must_use]
    pub fn is_certain(&self) -> bool {
        let by_rounding =
            self.column_change < 16.0 * self.left_eigenvector.len() as f64 * f64::EPSILON;
        // Where the entries are exact the mode is, however sensitive.
        let sharp = self.column_change == 0.0 || self.eigenvalue_shift < SHARP;
        self.measure < self.tolerance && by_rounding && sharp
    }
}

/// A mode on the unit circle that the state weight does not see, up to the tolerance.
#[derive(Debug, Clone, PartialEq)]
pub struct UnobservableMode {
    /// The eigenvalue lambda.
    pub eigenvalue: c64,
    /// Unit vector v with Av = lambda v and Qv = 0 up to `measure`; with a cross term S or a singular R, Av + Bu = lambda v for the
    /// input u that makes the stage cost vanish. Length n, in the caller's coordinates.
    pub right_eigenvector: Vec<c64>,
    /// Smallest singular value of [A - lambda I; D Q] over 1 + |A| (balanced coordinates in a solver's error).
    pub measure: f64,
    /// A measure below this counts as zero.
    pub tolerance: f64,
}

impl std::fmt::Display for UncontrollableMode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "lambda = {:.9}{:+.9}i along {} (measure {:.1e}, tolerance {:.1e})",
            self.eigenvalue.re,
            self.eigenvalue.im,
            direction(&self.left_eigenvector),
            self.measure,
            self.tolerance
        )
    }
}

impl std::fmt::Display for UnobservableMode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "lambda = {:.9}{:+.9}i along {} (measure {:.1e}, tolerance {:.1e})",
            self.eigenvalue.re,
            self.eigenvalue.im,
            direction(&self.right_eigenvector),
            self.measure,
            self.tolerance
        )
    }
}

fn direction(v: &[c64]) -> String {
    let entries: Vec<String> = v
        .iter()
        .map(|z| {
            if z.im == 0.0 {
                format!("{:.4}", z.re)
            } else {
                format!("{:.4}{:+.4}i", z.re, z.im)
            }
        })
        .collect();
    format!("[{}]", entries.join(", "))
}

/// What [`stabilisability`](crate::stabilisability) found.
#[derive(Debug, Clone, PartialEq)]
pub struct Stabilisability {
    /// Modes with |lambda| >= 1 that no input reaches, for certain: no change beyond rounding of the entries separates
    /// the pair from one that has them.
    pub unreached: Vec<UncontrollableMode>,
    /// Modes whose measure is below the tolerance although the entries, as they stand, say otherwise: coordinates
    /// so skewed that the pair's rounding errors decide.
    pub undecided: Vec<UncontrollableMode>,
    /// The mode with the smallest measure among those that need an input, reached or not; `None` when
    /// every eigenvalue lies well inside the unit circle.
    pub weakest: Option<UncontrollableMode>,
}

impl Stabilisability {
    /// Whether some gain K makes A + BK stable, beyond doubt.
    #[must_use]
    pub fn is_stabilisable(&self) -> bool {
        self.unreached.is_empty() && self.undecided.is_empty()
    }
}
