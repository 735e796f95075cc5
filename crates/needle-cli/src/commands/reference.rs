//! `needle reference`: the needle's states and inputs along positions.

use crate::answer::{CliError, Verdict, print, print_json, say};
use needle_control::ReconstructedPath;
use needle_model::{Needle, PositionPathSettings};
use needle_sim::check::Fit;
use needle_sim::output::write_whole;
use needle_sim::{path_through, read_positions};
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `needle reference`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// CSV file with a header that names x_mm, y_mm and z_mm.
    #[arg(value_name = "POSITIONS")]
    positions: PathBuf,
    /// Curvature of the needle, 1/mm.
    #[arg(long, value_name = "K")]
    curvature_per_mm: f64,
    /// Insertion speed, mm/s.
    #[arg(long, value_name = "V", default_value_t = 5.0)]
    speed_mm_s: f64,
    /// Sample time, s.
    #[arg(long, value_name = "DT", default_value_t = 0.1)]
    dt_s: f64,
    /// Largest spin, rad/s.
    #[arg(long, value_name = "W", default_value_t = std::f64::consts::TAU)]
    omega_max_rad_s: f64,
    /// Ripple shorter than some six times this is smoothed away, mm.
    #[arg(long, value_name = "L", default_value_t = 0.0)]
    smoothing_mm: f64,
    /// Write the path here instead of to standard output; `reference.kind = "poses"` reads it.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print how close the path comes as JSON; needs --output.
    #[arg(long, requires = "output")]
    json: bool,
}

/// How close the path comes to the positions.
#[derive(Debug, Serialize)]
struct Closeness {
    poses: usize,
    length_mm: f64,
    worst_step: usize,
    #[serde(flatten)]
    fit: Fit,
}

pub(crate) fn run(args: &Args) -> Result<Verdict, CliError> {
    let needle = Needle::new(args.curvature_per_mm)?;
    let positions = read_positions(&args.positions)?;
    let defaults = PositionPathSettings::default();
    let settings = PositionPathSettings {
        speed_mm_s: args.speed_mm_s,
        dt_s: args.dt_s,
        omega_max_rad_s: args.omega_max_rad_s,
        v_max_mm_s: defaults.v_max_mm_s.max(2.0 * args.speed_mm_s),
        ..defaults
    };
    let found = path_through(needle, &positions, args.smoothing_mm, settings)?;
    let closeness = closeness(&found);
    match &args.output {
        Some(path) => write_whole(path, found.path.to_csv().as_bytes())?,
        None => print(&found.path.to_csv())?,
    }
    match args.json {
        true => print_json(&closeness)?,
        false => say_words(&closeness),
    }
    Ok((closeness.fit.converged && closeness.fit.excesses.is_empty()).into())
}

fn closeness(found: &ReconstructedPath) -> Closeness {
    Closeness {
        poses: found.path.poses().len(),
        length_mm: found.path.arc_length_mm().last().copied().unwrap_or(0.0),
        worst_step: found.worst_step,
        fit: found.into(),
    }
}

fn say_words(closeness: &Closeness) {
    say(&format!(
        "{} poses over {:.2} mm; from the positions {:.4} mm RMS, {:.4} mm at worst (sample {})",
        closeness.poses,
        closeness.length_mm,
        closeness.fit.rms_mm,
        closeness.fit.worst_mm,
        closeness.worst_step,
    ));
    for [from, to, curvature] in &closeness.fit.excesses {
        say(&format!(
            "from {from:.1} to {to:.1} mm the positions bend by up to {curvature:.3e} per mm, more than the needle can"
        ));
    }
    if !closeness.fit.converged {
        say("the search for inputs did not converge: the path is the best that was met");
    }
}
