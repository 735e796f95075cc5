//! What can be said of a scenario before anything moves: does the path suit the needle and its limits, which errors can be corrected,
//! what is claimed of the controller's terminal ingredients.

use crate::SUCCESS_MM;
use crate::experiment::{Experiment, RunError};
use crate::scenario::{ControllerChoice, EstimatorChoice, Scenario, Sensors};
use lqr::{Certificate, Check};
use needle_control::{InputLimits, ReconstructedPath, TerminalChoice};
use needle_model::{ControllabilityReport, ControllabilityWarning, Needle, ReferencePath};
use serde::Serialize;

/// Excess over the needle's curvature that is rounding of poses and no bend, as a fraction of it.
const CURVATURE_MARGIN: f64 = 1e-3;

/// Defect from which on the needle does not execute the path's own inputs, mm and rad alike.
const EXECUTABLE: f64 = 1e-6;

/// Excess over a limit that is rounding.
const LIMIT_ROUNDING: f64 = 1e-9;

/// Rows of a certificate that a screen holds.
const SCREEN: usize = 24;

/// Samples of the path that are judged for controllability: a window longer than that is no controller's.
const WINDOW: usize = 200;

/// How the path bends against how the needle does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CurvatureMargin {
    /// Curvature of the needle, 1/mm.
    pub needle_per_mm: f64,
    /// Largest curvature of the path between two samples, 1/mm.
    pub path_per_mm: f64,
    /// Arc length where that is, mm.
    pub at_mm: f64,
    /// What is left for corrections, as a fraction of the needle's curvature; negative where the path bends too much.
    pub margin: f64,
}

/// How close what the needle executes, and the controller has, comes to the path that distances are to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fit {
    /// Root mean square distance, mm.
    pub rms_mm: f64,
    /// Largest distance, mm.
    pub worst_mm: f64,
    /// Stretches (from, to, largest curvature) in mm and 1/mm where the path bends more than the needle can.
    pub excesses: Vec<[f64; 3]>,
    /// Whether the search for inputs settled.
    pub converged: bool,
}

impl From<&ReconstructedPath> for Fit {
    fn from(found: &ReconstructedPath) -> Self {
        let excesses = found.excesses.iter();
        Self {
            rms_mm: found.rms_mm,
            worst_mm: found.worst_mm,
            excesses: excesses
                .map(|e| [e.start_mm, e.end_mm, e.curvature_per_mm])
                .collect(),
            converged: found.converged,
        }
    }
}

/// Which errors inputs can correct, to first order, along the first samples of the path, 200 at most.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Controllability {
    /// Samples looked at.
    pub samples: usize,
    /// Dimension of the controllable errors, of 6.
    pub dimension: usize,
    /// The directions that no input corrects, in words.
    pub uncontrollable: Vec<String>,
    /// The direction that is the costliest to correct.
    pub weakest: Option<String>,
    /// Why what is controllable on paper may not be in practice.
    pub warnings: Vec<String>,
}

/// An input of the path that the actuators cannot perform.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LimitExcess {
    /// Key of the limit.
    pub limit: &'static str,
    /// Sample of the path where the excess is largest.
    pub step: usize,
    /// What the path asks for there, in the limit's unit.
    pub wanted: f64,
    /// The limit.
    pub allowed: f64,
}

/// The answer of a check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckReport {
    /// Name of the controller.
    pub controller: &'static str,
    /// Length of the path, mm.
    pub length_mm: f64,
    /// Duration of the path, s.
    pub duration_s: f64,
    /// Poses of the path.
    pub poses: usize,
    /// Whether the needle executes the path's own inputs; a path that it does not is followed as a curve.
    pub executable: bool,
    /// Largest defect of a step if the needle executed them, mm and rad alike.
    pub largest_defect: f64,
    /// How close the controller's path comes to the one that distances are to; `None` where it is the same.
    pub fit: Option<Fit>,
    /// Bends of path and needle.
    pub curvature: CurvatureMargin,
    /// Which errors can be corrected; `None` where the inputs are beyond scaling.
    pub controllability: Option<Controllability>,
    /// Inputs of the path beyond the limits; they bind only a controller that follows the path's own inputs.
    pub limits: Vec<LimitExcess>,
    /// Terminal cost and set in force; `None` for a controller without.
    pub terminal: Option<String>,
    /// The stronger terminal choices that the path refused, and why.
    pub refused_terminals: Vec<String>,
    /// What is claimed of them.
    pub certificate: Option<Certificate>,
    /// What stands against running the scenario; empty when nothing does.
    pub objections: Vec<String>,
}

impl CheckReport {
    /// The certificate in a screen's rows: of one with a row a step, the rows that fail and the least margin of each kind, which is the
    /// first word of a row's name.
    #[must_use]
    pub fn certificate_on_a_screen(&self) -> Option<Certificate> {
        let mut shown = self.certificate.clone()?;
        if shown.checks.len() > SCREEN {
            let kind = |check: &Check| check.name.split(' ').next().map(str::to_owned);
            shown.checks.sort_by(|a, b| {
                let by_kind = kind(a).cmp(&kind(b)).then(a.holds.cmp(&b.holds));
                by_kind.then(a.margin.total_cmp(&b.margin))
            });
            let mut last = None;
            shown
                .checks
                .retain(|check| last.replace(kind(check)) != Some(kind(check)) || !check.holds);
        }
        Some(shown)
    }
}

/// Checks a scenario.
///
/// # Errors
/// [`RunError`] when it cannot be run at all.
pub fn check(scenario: &Scenario) -> Result<CheckReport, RunError> {
    let experiment = Experiment::new(scenario)?;
    let (path, needle) = (
        experiment.steered_path(),
        Needle::new(scenario.curvature_per_mm)?,
    );
    // A path of one pose has no step; a defect that cannot be had is no small one.
    let largest_defect = path.largest_defect(needle).map_or(f64::INFINITY, |found| {
        found.map_or(0.0, |(_, defect)| defect.norm())
    });
    let refused = experiment.refused_terminals().iter();
    let refused = refused.map(|refused| format!("{}: {}", words(refused.choice), refused.reason));
    let mut report = CheckReport {
        controller: scenario.controller.name(),
        length_mm: path.arc_length_mm().last().copied().unwrap_or(0.0),
        duration_s: path.duration_s(),
        poses: path.poses().len(),
        executable: largest_defect < EXECUTABLE,
        largest_defect,
        fit: experiment.executed().map(Fit::from),
        curvature: curvature_margin(path, needle),
        controllability: controllability(path, needle),
        limits: limit_excesses(path, &scenario.limits),
        terminal: experiment.terminal().map(words),
        refused_terminals: refused.collect(),
        certificate: experiment.certificate().cloned(),
        objections: Vec::new(),
    };
    report.objections = objections(scenario, &report);
    Ok(report)
}

fn words(choice: TerminalChoice) -> String {
    match choice {
        TerminalChoice::Auto => "auto".into(),
        TerminalChoice::HelixDare => "helix_dare".into(),
        TerminalChoice::RiccatiChain => "riccati_chain".into(),
        TerminalChoice::Periodic { period } => format!("periodic, {period} samples"),
        TerminalChoice::None => "none".into(),
    }
}

fn objections(scenario: &Scenario, report: &CheckReport) -> Vec<String> {
    let mut objections = Vec::new();
    if report.length_mm <= 0.0 {
        objections.push("the path has no length: no run along it can succeed".into());
    }
    if scenario.estimator == EstimatorChoice::Perfect && scenario.sensors != Sensors::default() {
        objections.push(
            "sensors are set, but without [estimator] the controller sees the true pose".into(),
        );
    }
    if let Some(fit) = &report.fit {
        for [from, to, curvature] in &fit.excesses {
            objections.push(format!(
                "from {from:.1} to {to:.1} mm the path bends by up to {curvature:.3e} per mm, more than the needle can"
            ));
        }
        if !fit.converged {
            objections.push("the search for the needle's inputs did not converge".into());
        }
        if fit.worst_mm >= SUCCESS_MM {
            objections.push(format!(
                "what the needle can execute leaves the path by {:.3} mm",
                fit.worst_mm
            ));
        }
    }
    let curvature = &report.curvature;
    if curvature.margin < -CURVATURE_MARGIN {
        objections.push(format!(
            "the path bends by {:.3e} per mm at {:.1} mm, the needle by {:.3e}",
            curvature.path_per_mm, curvature.at_mm, curvature.needle_per_mm
        ));
    }
    let by_inputs = matches!(
        scenario.controller,
        ControllerChoice::Ltv(_)
            | ControllerChoice::Straight(_)
            | ControllerChoice::Lqr(..)
            | ControllerChoice::FeedForward
    );
    if by_inputs && !report.executable {
        objections.push(format!(
            "{} follows the path's own inputs, and the needle does not execute them: defect {:.2e}",
            report.controller, report.largest_defect
        ));
    }
    let relevant = |excess: &&LimitExcess| by_inputs || excess.limit.starts_with("v_");
    for excess in report.limits.iter().filter(relevant) {
        objections.push(format!(
            "the path asks for {:.4} at sample {}, {} is {:.4}",
            excess.wanted, excess.step, excess.limit, excess.allowed
        ));
    }
    for check in report.certificate.iter().flat_map(Certificate::failures) {
        objections.push(format!(
            "certificate: {} fails: {}",
            check.name, check.condition
        ));
    }
    objections
}

fn curvature_margin(path: &ReferencePath, needle: Needle) -> CurvatureMargin {
    let needle_per_mm = needle.curvature_per_mm();
    let (mut path_per_mm, mut at_mm) = (0.0_f64, 0.0);
    for (k, pair) in path.poses().windows(2).enumerate() {
        let chord_mm = (pair[1].position_mm - pair[0].position_mm).norm();
        let (before, after) = (pair[0].tangent(), pair[1].tangent());
        let turn = before.cross(&after).norm().atan2(before.dot(&after));
        // A chord that is rounding of positions has no curvature.
        let curvature = if chord_mm > 1e-6 {
            turn / chord_mm
        } else {
            0.0
        };
        if curvature > path_per_mm {
            (path_per_mm, at_mm) = (curvature, path.arc_length_mm()[k]);
        }
    }
    let margin = match needle_per_mm > 0.0 {
        true => 1.0 - path_per_mm / needle_per_mm,
        // A straight needle has no curvature to spare, and none to lack on a straight path.
        false if path_per_mm < 1e-9 => 0.0,
        false => -1.0,
    };
    CurvatureMargin {
        needle_per_mm,
        path_per_mm,
        at_mm,
        margin,
    }
}

fn controllability(path: &ReferencePath, needle: Needle) -> Option<Controllability> {
    let inputs = &path.inputs()[..path.inputs().len().min(WINDOW)];
    let report = ControllabilityReport::over_window(needle, inputs, path.dt_s()).ok()?;
    let warning = |warning: &ControllabilityWarning| match warning {
        ControllabilityWarning::NearPlanarArc { rate_ratio } => format!(
            "nearly a planar arc: |omega| / (kappa v) is {rate_ratio:.2e}; in-plane errors can hardly be corrected"
        ),
        ControllabilityWarning::NearEqualRates { rate_ratio } => {
            format!("|omega| / (kappa v) is {rate_ratio:.3}, close to 1, where a dimension is lost")
        }
        ControllabilityWarning::Weak { fraction } => {
            format!("the weakest direction has {fraction:.1e} of the strongest's authority")
        }
    };
    Some(Controllability {
        samples: inputs.len(),
        dimension: report.dimension,
        uncontrollable: report
            .uncontrollable
            .iter()
            .map(|d| d.words.to_string())
            .collect(),
        weakest: report.weakest.map(|direction| direction.words.to_string()),
        warnings: report.warnings.iter().map(warning).collect(),
    })
}

/// The largest excess over each limit.
fn limit_excesses(path: &ReferencePath, limits: &InputLimits) -> Vec<LimitExcess> {
    let dt_s = path.dt_s();
    let mut excesses: Vec<LimitExcess> = Vec::new();
    let mut wants = |limit, step, wanted: f64, allowed: f64, excess: f64| {
        if excess <= LIMIT_ROUNDING * (1.0 + allowed.abs()) {
            return;
        }
        let entry = LimitExcess {
            limit,
            step,
            wanted,
            allowed,
        };
        let known = excesses.iter_mut().find(|known| known.limit == limit);
        match known {
            Some(known) if (known.wanted - allowed).abs() < excess => *known = entry,
            Some(_) => {}
            None => excesses.push(entry),
        }
    };
    for (step, input) in path.inputs().iter().enumerate() {
        let (v, omega) = (input.v_mm_s, input.omega_rad_s.abs());
        let InputLimits {
            v_min_mm_s: least,
            v_max_mm_s: most,
            omega_max_rad_s: spin,
            ..
        } = *limits;
        wants("v_max_mm_s", step, v, most, v - most);
        wants("v_min_mm_s", step, v, least, least - v);
        wants("omega_max_rad_s", step, omega, spin, omega - spin);
        // From rest a controller starts within its rates; on the way the path's own changes count.
        let Some(before) = step.checked_sub(1).map(|k| path.inputs()[k]) else {
            continue;
        };
        let v_rate = (v - before.v_mm_s).abs() / dt_s;
        let omega_rate = (input.omega_rad_s - before.omega_rad_s).abs() / dt_s;
        let (most_v, most_omega) = (limits.v_rate_max_mm_s2, limits.omega_rate_max_rad_s2);
        wants("v_rate_max_mm_s2", step, v_rate, most_v, v_rate - most_v);
        wants(
            "omega_rate_max_rad_s2",
            step,
            omega_rate,
            most_omega,
            omega_rate - most_omega,
        );
    }
    excesses
}
