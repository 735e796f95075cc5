//! A campaign in figures: a cell of the grid at a time, with confidence intervals.

use super::estimate::{Samples, Share, Spread};
use super::rows::{REFUSED, TIMES};
use super::table::{Cells, Table};
use serde::{Deserialize, Serialize};

/// A campaign in figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CampaignSummary {
    /// Runs of the campaign.
    pub runs: u64,
    /// The cells of its grid, one without a grid.
    pub cells: Vec<CellSummary>,
}

/// A key of the grid with its value in a cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setting {
    /// Dotted key of the scenario.
    pub key: String,
    /// Its value in words.
    pub value: String,
}

/// How often and for how long one cause kept the controller from an optimal answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Cause {
    /// Runs with at least one such sample.
    pub runs: u64,
    /// Such samples, all runs.
    pub steps: u64,
}

/// Samples that were not answered by an optimal plan or a law, by cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Fallbacks {
    /// A plan that violates soft constraints.
    pub degraded: Cause,
    /// An earlier plan, shifted.
    pub shifted_plan: Cause,
    /// A stop for want of a plan.
    pub no_plan: Cause,
    /// A stop for want of a measurement.
    pub no_measurement: Cause,
}

/// The runs of a cell in figures. Spreads are `None` where no run has the figure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellSummary {
    /// Index of the cell.
    pub cell: u64,
    /// What the grid sets in it.
    pub settings: Vec<Setting>,
    /// Runs.
    pub runs: u64,
    /// Runs that could not be made; they count as runs without success.
    pub refused: u64,
    /// Runs that ended within [`crate::SUCCESS_MM`] of the path's end and stayed within it of the path after its first fifth.
    pub success: Share,
    /// RMS distances of the runs, mm.
    pub rms_mm: Option<Spread>,
    /// Distances that 95 % of a run's samples stay below, mm.
    pub p95_mm: Option<Spread>,
    /// Largest distances of the runs, mm.
    pub max_mm: Option<Spread>,
    /// Distances of the last tip to the end of the path, mm.
    pub final_mm: Option<Spread>,
    /// Rotations of the base, revolutions.
    pub rotation_rev: Option<Spread>,
    /// Median times of a controller's step, us. Depends on the machine.
    pub step_median_us: Option<Spread>,
    /// Longest times of a controller's step, us. Depends on the machine.
    pub step_worst_us: Option<Spread>,
    /// Samples, all runs.
    pub steps: u64,
    /// Samples that were not answered as planned.
    pub fallbacks: Fallbacks,
    /// Whether no other cell has both a smaller mean RMS distance and a smaller mean rotation. Only cells whose every run that could be made has both
    /// figures are compared.
    pub pareto: bool,
}

impl CellSummary {
    fn point(&self) -> Option<(u64, f64, f64)> {
        let (rms, rotation) = (self.rms_mm?, self.rotation_rev?);
        Some((self.cell, rms.mean.value, rotation.mean.value))
    }

    /// Whether every run of the cell that could be made counts in both means: the means of the runs that got somewhere are no match
    /// for another cell's.
    fn complete(&self) -> bool {
        let made = self.runs - self.refused;
        let all = |spread: &Option<Spread>| spread.is_some_and(|s| s.count == made);
        all(&self.rms_mm) && all(&self.rotation_rev)
    }

    /// The settings in one line; `all runs` without a grid.
    #[must_use]
    pub fn label(&self) -> String {
        if self.settings.is_empty() {
            return "all runs".into();
        }
        let words = |setting: &Setting| format!("{} = {}", setting.key, setting.value);
        let settings: Vec<_> = self.settings.iter().map(words).collect();
        settings.join(", ")
    }
}

/// The figures that spread.
const FIGURES: [&str; 7] = [
    "rms_mm",
    "p95_mm",
    "max_mm",
    "final_mm",
    "rotation_rev",
    TIMES[0],
    TIMES[1],
];

const CAUSES: [&str; 4] = [
    "degraded_steps",
    "shifted_plan_steps",
    "no_plan_steps",
    "no_measurement_steps",
];

/// Sums of the cell under way.
#[derive(Debug, Clone, Default)]
struct Sums {
    runs: u64,
    refused: u64,
    successes: u64,
    steps: u64,
    figures: [Samples; FIGURES.len()],
    causes: [Cause; CAUSES.len()],
    settings: Vec<Setting>,
}

/// Gathers runs in their order, so that one cell at a time is open.
#[derive(Debug, Clone)]
pub(super) struct Gatherer {
    grid: Vec<String>,
    open: Option<(u64, Sums)>,
    cells: Vec<CellSummary>,
    runs: u64,
}

impl Gatherer {
    pub(super) fn new(grid: &[String]) -> Self {
        Self {
            grid: grid.to_vec(),
            open: None,
            cells: Vec::new(),
            runs: 0,
        }
    }

    /// Takes in the rows of [`super::rows::runs`].
    pub(super) fn add(&mut self, table: &Table) {
        for (row, cell) in table.whole("cell").iter().enumerate() {
            let cell = cell.unwrap_or(0) as u64;
            if self.open.as_ref().is_none_or(|(open, _)| *open != cell) {
                self.close();
                let settings = self.grid.iter().map(|key| Setting {
                    key: key.clone(),
                    value: table.column(key).map_or(String::new(), |c| c.words(row)),
                });
                let settings = settings.collect();
                let sums = Sums {
                    settings,
                    ..Sums::default()
                };
                self.open = Some((cell, sums));
            }
            if let Some((_, sums)) = &mut self.open {
                sums.add(table, row);
            }
            self.runs += 1;
        }
    }

    fn close(&mut self) {
        let summary = self.open.take().map(|(cell, sums)| sums.summary(cell));
        self.cells.extend(summary);
    }

    /// The summary of all rows.
    pub(super) fn finish(mut self) -> CampaignSummary {
        self.close();
        let mut summary = CampaignSummary {
            runs: self.runs,
            cells: self.cells,
        };
        let mut cells: Vec<_> = summary.cells.iter_mut().filter(|c| c.complete()).collect();
        let order = |cell: &CellSummary| {
            cell.point()
                .map_or((0.0, 0.0), |(_, rms, turn)| (rms, turn))
        };
        cells.sort_by(|a, b| {
            let ((rms, turn), (other_rms, other_turn)) = (order(a), order(b));
            rms.total_cmp(&other_rms).then(turn.total_cmp(&other_turn))
        });
        // From accurate to less so, a cell must turn less than all before it, or be the equal of the last that did.
        let mut last = (f64::NAN, f64::INFINITY);
        for cell in cells {
            let here = order(cell);
            cell.pareto = here.1 < last.1 || here == last;
            if cell.pareto {
                last = here;
            }
        }
        summary
    }
}

impl Sums {
    fn add(&mut self, table: &Table, row: usize) {
        self.runs += 1;
        if table
            .column("status")
            .is_some_and(|c| c.words(row) == REFUSED)
        {
            self.refused += 1;
        }
        if let Some(Cells::Flag(success)) = table.column("success") {
            self.successes += u64::from(success[row] == Some(true));
        }
        let whole = |name| table.whole(name).get(row).copied().flatten().unwrap_or(0) as u64;
        self.steps += whole("steps");
        for (samples, name) in self.figures.iter_mut().zip(FIGURES) {
            if let Some(value) = table.numbers(name).get(row).copied().flatten() {
                samples.add(value);
            }
        }
        for (cause, name) in self.causes.iter_mut().zip(CAUSES) {
            let steps = whole(name);
            cause.steps += steps;
            cause.runs += u64::from(steps > 0);
        }
    }

    fn summary(self, cell: u64) -> CellSummary {
        let [rms, p95, max, last, rotation, median_us, worst_us] =
            self.figures.map(|samples| samples.spread());
        let [degraded, shifted_plan, no_plan, no_measurement] = self.causes;
        CellSummary {
            cell,
            settings: self.settings,
            runs: self.runs,
            refused: self.refused,
            success: Share::new(self.successes, self.runs),
            rms_mm: rms,
            p95_mm: p95,
            max_mm: max,
            final_mm: last,
            rotation_rev: rotation,
            step_median_us: median_us,
            step_worst_us: worst_us,
            steps: self.steps,
            fallbacks: Fallbacks {
                degraded,
                shifted_plan,
                no_plan,
                no_measurement,
            },
            pareto: false,
        }
    }
}
