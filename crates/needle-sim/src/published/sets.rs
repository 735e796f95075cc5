//! Which runs stand in which figure of the paper.

use super::PublishedError;
use super::bevel::{BevelSettings, bevel_reference, run_bevel};
use super::straight::{StraightSettings, run_straight, straight_reference};
use crate::log::RunLog;

/// A figure of the paper that shows runs of the closed loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Figure {
    /// Fig. 5: the straight needle.
    Straight,
    /// Fig. 7: the bevelled needle with the paper's weights.
    Bevel,
    /// Fig. 8: Q = q I. The text gives R = diag(100, 10); the authors' recorded runs have R = 10 I, and so have these.
    QSweep,
    /// Fig. 8 with the R of the text.
    QSweepAsText,
    /// Fig. 9: R = r I.
    RSweep,
    /// Fig. 10: horizons, with R = 100 I.
    NSweep,
}

impl Figure {
    /// Every figure, in the paper's order.
    pub const ALL: [Self; 6] = [
        Self::Straight,
        Self::Bevel,
        Self::QSweep,
        Self::QSweepAsText,
        Self::RSweep,
        Self::NSweep,
    ];
}

/// The settings of a run.
#[derive(Debug, Clone, PartialEq)]
pub enum RunSettings {
    /// The straight reference itself.
    StraightReference,
    /// The bevel reference itself.
    BevelReference,
    /// A closed loop of the straight needle.
    Straight(StraightSettings),
    /// A closed loop of the bevelled needle.
    Bevel(BevelSettings),
}

/// A named run of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedRun {
    /// Name, as in the data files.
    pub name: String,
    /// What it is.
    pub settings: RunSettings,
}

impl PublishedRun {
    fn new(name: impl Into<String>, settings: RunSettings) -> Self {
        Self {
            name: name.into(),
            settings,
        }
    }

    /// Computes the run.
    ///
    /// # Errors
    /// See [`PublishedError`].
    pub fn compute(&self) -> Result<RunLog, PublishedError> {
        match &self.settings {
            RunSettings::StraightReference => Ok(straight_reference()),
            RunSettings::BevelReference => Ok(bevel_reference()),
            RunSettings::Straight(settings) => run_straight(&self.name, settings),
            RunSettings::Bevel(settings) => run_bevel(&self.name, settings),
        }
    }
}

/// The runs of a figure, the reference first.
#[must_use]
pub fn figure_runs(figure: Figure) -> Vec<PublishedRun> {
    let reference = match figure {
        Figure::Straight => RunSettings::StraightReference,
        _ => RunSettings::BevelReference,
    };
    let mut runs = vec![PublishedRun::new("reference", reference)];
    let chosen = BevelSettings::default;
    let our_qr = || PublishedRun::new("ourQR", RunSettings::Bevel(chosen()));
    let q_run = |q: f64, r_diagonal| {
        PublishedRun::new(
            format!("Q{q}"),
            RunSettings::Bevel(BevelSettings {
                q_diagonal: [q; 6],
                r_diagonal,
                ..chosen()
            }),
        )
    };
    let r_run = |r: f64| {
        PublishedRun::new(
            format!("R{r}"),
            RunSettings::Bevel(BevelSettings {
                r_diagonal: [r; 2],
                ..chosen()
            }),
        )
    };
    let n_run = |horizon: usize| {
        let settings = BevelSettings {
            r_diagonal: [100.0; 2],
            horizon,
            ..chosen()
        };
        PublishedRun::new(format!("N{horizon}"), RunSettings::Bevel(settings))
    };
    match figure {
        Figure::Straight => {
            runs.push(PublishedRun::new(
                "straight",
                RunSettings::Straight(StraightSettings::default()),
            ));
        }
        Figure::Bevel => runs.push(our_qr()),
        Figure::QSweep | Figure::QSweepAsText => {
            let r = if figure == Figure::QSweep {
                [10.0; 2]
            } else {
                chosen().r_diagonal
            };
            runs.push(our_qr());
            runs.extend([0.01, 0.1, 1.0, 10.0].map(|q| q_run(q, r)));
        }
        Figure::RSweep => {
            runs.push(our_qr());
            runs.extend([0.01, 0.1, 1.0, 10.0, 100.0].map(r_run));
        }
        Figure::NSweep => runs.extend([2, 4, 6, 8, 20].map(n_run)),
    }
    runs
}
