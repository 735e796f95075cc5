//! From a path to its terminal ingredients: the choice asked for, or the strongest that can be had.

use super::configuration::LinearConfiguration;
use super::terminal::{Ingredients, Pair, TerminalChoice, TerminalError, deviation_limits};
use super::{ALL_COORDINATES, DEPTH_AND_ROLL};
use nalgebra::DMatrix;
use needle_model::{ControllabilityReport, Input, Needle, ReferencePath};

/// Relative difference below which two inputs of a reference are the same: they come from files and arithmetic.
const SAME_INPUT: f64 = 1e-9;

/// Ingredients with the choice that they belong to.
#[derive(Debug, Clone)]
pub(crate) struct Chosen {
    pub(crate) choice: TerminalChoice,
    pub(crate) ingredients: Ingredients,
}

/// Ingredients along a path of a bevel-tip needle.
pub(crate) fn along_path(
    needle: Needle,
    path: &ReferencePath,
    configuration: &LinearConfiguration,
) -> Result<Chosen, TerminalError> {
    let attempts: &[TerminalChoice] = match configuration.terminal {
        TerminalChoice::Auto => &[TerminalChoice::HelixDare, TerminalChoice::RiccatiChain],
        ref other => std::slice::from_ref(other),
    };
    let mut refusal = None;
    for &choice in attempts {
        match attempt(needle, path, configuration, choice) {
            Ok(ingredients) => {
                return Ok(Chosen {
                    choice,
                    ingredients,
                });
            }
            Err(reason) => refusal = Some(reason),
        }
    }
    match refusal {
        Some(reason) if configuration.terminal != TerminalChoice::Auto => Err(reason),
        _ => Ok(Chosen {
            choice: TerminalChoice::None,
            ingredients: none(configuration, ALL_COORDINATES),
        }),
    }
}

/// Ingredients of a straight needle: its pair is the same whatever the inputs.
pub(crate) fn of_straight_needle(
    needle: Needle,
    path: &ReferencePath,
    configuration: &LinearConfiguration,
) -> Result<Chosen, TerminalError> {
    let curvature_per_mm = needle.curvature_per_mm();
    if curvature_per_mm != 0.0 {
        return Err(TerminalError::Bent { curvature_per_mm });
    }
    let stationary = || -> Result<Ingredients, TerminalError> {
        same_time_step(path, configuration)?;
        let pair = pair(needle, Input::ZERO, configuration, DEPTH_AND_ROLL)?;
        let limits = deviation_limits(2, &configuration.limits, path.inputs(), configuration.dt_s)?;
        Ok(Ingredients::stationary(&pair, limits)?.until(path.inputs().len()))
    };
    let without = || none(configuration, DEPTH_AND_ROLL);
    let (choice, ingredients) = match configuration.terminal {
        TerminalChoice::None => (TerminalChoice::None, without()),
        TerminalChoice::Auto => match stationary() {
            Ok(ingredients) => (TerminalChoice::HelixDare, ingredients),
            Err(_) => (TerminalChoice::None, without()),
        },
        // One pair at every step: chain and period have the same fixed point.
        choice => (choice, stationary()?),
    };
    Ok(Chosen {
        choice,
        ingredients,
    })
}

/// The stage weights as terminal weight, in the augmented state.
fn none(configuration: &LinearConfiguration, coordinates: &[usize]) -> Ingredients {
    Ingredients::none(end_weight(configuration, coordinates))
}

fn end_weight(configuration: &LinearConfiguration, coordinates: &[usize]) -> DMatrix<f64> {
    let weights = &configuration.weights;
    let n = coordinates.len();
    let mut end = DMatrix::zeros(n + 2, n + 2);
    end.view_mut((0, 0), (n, n))
        .copy_from(&weights.of_error(coordinates));
    end.view_mut((n, n), (2, 2)).copy_from(&weights.of_input());
    end
}

fn pair(
    needle: Needle,
    input: Input,
    configuration: &LinearConfiguration,
    coordinates: &[usize],
) -> Result<Pair, TerminalError> {
    let jacobians = needle.linearise(input, configuration.dt_s)?;
    let n = coordinates.len();
    Ok(Pair {
        a: DMatrix::from_fn(n, n, |i, j| jacobians.a[(coordinates[i], coordinates[j])]),
        b: DMatrix::from_fn(n, 2, |i, j| jacobians.b[(coordinates[i], j)]),
        q: configuration.weights.of_error(coordinates),
        r: configuration.weights.of_input(),
        r_rate: configuration.weights.of_change(),
    })
}

fn attempt(
    needle: Needle,
    path: &ReferencePath,
    configuration: &LinearConfiguration,
    choice: TerminalChoice,
) -> Result<Ingredients, TerminalError> {
    let inputs = path.inputs();
    let limits = || deviation_limits(6, &configuration.limits, inputs, configuration.dt_s);
    let pairs = |inputs: &[Input]| -> Result<Vec<Pair>, TerminalError> {
        let of = |&input| pair(needle, input, configuration, ALL_COORDINATES);
        inputs.iter().map(of).collect()
    };
    match choice {
        TerminalChoice::Auto | TerminalChoice::None => Ok(none(configuration, ALL_COORDINATES)),
        TerminalChoice::HelixDare => {
            same_time_step(path, configuration)?;
            let &input = inputs.first().ok_or(TerminalError::NoStep)?;
            repeats(inputs, 1)?;
            let pair = pair(needle, input, configuration, ALL_COORDINATES)?;
            match Ingredients::stationary(&pair, limits()?) {
                Ok(ingredients) => Ok(ingredients.until(inputs.len())),
                Err(TerminalError::Straight(source)) => {
                    let report = ControllabilityReport::of_reference_input(needle, input)?;
                    Err(TerminalError::Dare {
                        report: Box::new(report),
                        source,
                    })
                }
                Err(other) => Err(other),
            }
        }
        TerminalChoice::RiccatiChain => {
            same_time_step(path, configuration)?;
            let end = end_weight(configuration, ALL_COORDINATES);
            Ok(Ingredients::chain(&pairs(inputs)?, limits()?, &end)?.until(inputs.len()))
        }
        TerminalChoice::Periodic { period } => {
            same_time_step(path, configuration)?;
            repeats(inputs, period)?;
            let of_period = pairs(inputs.get(..period).ok_or(TerminalError::NoStep)?)?;
            Ok(Ingredients::periodic(&of_period, limits()?)?.until(inputs.len()))
        }
    }
}

fn same_time_step(
    path: &ReferencePath,
    configuration: &LinearConfiguration,
) -> Result<(), TerminalError> {
    let (path_dt_s, dt_s) = (path.dt_s(), configuration.dt_s);
    match (path_dt_s - dt_s).abs() <= SAME_INPUT * dt_s {
        true => Ok(()),
        false => Err(TerminalError::TimeStep { path_dt_s, dt_s }),
    }
}

fn repeats(inputs: &[Input], period: usize) -> Result<(), TerminalError> {
    let same = |a: f64, b: f64| (a - b).abs() <= SAME_INPUT * a.abs().max(b.abs());
    if period == 0 {
        return Err(TerminalError::NoStep);
    }
    for (k, (now, later)) in inputs.iter().zip(inputs.iter().skip(period)).enumerate() {
        if !(same(now.v_mm_s, later.v_mm_s) && same(now.omega_rad_s, later.omega_rad_s)) {
            return Err(TerminalError::NotPeriodic {
                step: k + period,
                period,
            });
        }
    }
    Ok(())
}
