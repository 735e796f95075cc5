//! A campaign in pictures: how figures spread in each cell of the grid, accuracy against rotation, fallbacks by cause. Bars are 95 %
//! confidence intervals.

use super::theme;
use crate::campaign::{CampaignSummary, Cause, CellSummary, Estimate, Spread};
use plotly::common::{ErrorData, ErrorType, Line, Marker, MarkerSymbol, Mode};
use plotly::layout::{Axis, AxisType, BarMode, HoverMode};
use plotly::{Bar, Layout, Plot, Scatter};

/// Cells whose settings stand at the axis; beyond, their numbers do.
const MOST_LABELS: usize = 24;

/// Characters of a label at the axis; the table has it whole.
const LONGEST_LABEL: usize = 24;

/// A figure of a distribution.
type EstimateOf = fn(&Spread) -> Estimate;

/// A cause of samples that no optimal plan or law answered.
type CauseOf = fn(&CellSummary) -> Cause;

const KEY_OF_CONTROLLER: &str = "controller.name";

/// A row of the figure of spreads.
struct Row {
    axis: &'static str,
    spread: fn(&CellSummary) -> Option<Spread>,
}

const ROWS: [Row; 4] = [
    Row {
        axis: "y2",
        spread: |cell| cell.rms_mm,
    },
    Row {
        axis: "y3",
        spread: |cell| cell.max_mm,
    },
    Row {
        axis: "y4",
        spread: |cell| cell.rotation_rev,
    },
    Row {
        axis: "y5",
        spread: |cell| cell.step_median_us,
    },
];

/// Success rate, distances, rotation and step times of each cell.
pub(super) fn spreads(summary: &CampaignSummary) -> Plot {
    let cells = &summary.cells;
    let mut plot = theme::plot(spreads_layout(cells));
    let percent = |share: f64| 100.0 * share;
    let rate = |cell: &CellSummary| Estimate {
        value: percent(cell.success.share),
        low: Some(percent(cell.success.low)),
        high: Some(percent(cell.success.high)),
    };
    let rates: Vec<_> = cells.iter().map(|cell| Some(rate(cell))).collect();
    plot.add_trace(points(cells, &rates, "success", theme::GREEN, -0.12).y_axis("y"));
    let estimates: [(&str, &str, f64, EstimateOf); 3] = [
        ("mean", theme::BLUE, -0.12, |spread| spread.mean),
        ("median", theme::ORANGE, 0.0, |spread| spread.median),
        ("95 % of the runs", theme::RED, 0.12, |spread| spread.p95),
    ];
    for (row, Row { axis, spread }) in ROWS.iter().enumerate() {
        for (name, color, offset, estimate) in estimates {
            let values: Vec<_> = cells
                .iter()
                .map(|c| spread(c).as_ref().map(estimate))
                .collect();
            let trace = points(cells, &values, name, color, offset).legend_group(name);
            plot.add_trace(trace.y_axis(*axis).show_legend(row == 0));
        }
        let worst: Vec<f64> = (cells.iter())
            .map(|cell| spread(cell).map_or(f64::NAN, |spread| spread.worst))
            .collect();
        let marker = Marker::new()
            .symbol(MarkerSymbol::X)
            .size(7)
            .color(theme::BLACK);
        let trace = Scatter::new(positions(cells, 0.0), worst)
            .name("worst run")
            .mode(Mode::Markers)
            .marker(marker)
            .hover_text_array(labels(cells))
            .legend_group("worst")
            .show_legend(row == 0);
        plot.add_trace(trace.x_axis("x").y_axis(*axis));
    }
    plot
}

/// Mean RMS distance against mean rotation, a colour a controller, the Pareto front as a line.
pub(super) fn pareto(summary: &CampaignSummary) -> Plot {
    let layout = theme::layout()
        .hover_mode(HoverMode::Closest)
        .x_axis(theme::axis("rotation, revolutions"))
        .y_axis(theme::axis("RMS distance to the path, mm").type_(AxisType::Log));
    let mut plot = theme::plot(layout);
    let mut names: Vec<&str> = Vec::new();
    for cell in &summary.cells {
        let name = controller(cell);
        if !names.contains(&name) {
            names.push(name);
        }
    }
    for (i, name) in names.iter().enumerate() {
        let cells: Vec<&CellSummary> = (summary.cells.iter())
            .filter(|cell| controller(cell) == *name)
            .collect();
        let color = theme::SERIES[i % theme::SERIES.len()];
        let means = |spread: fn(&CellSummary) -> Option<Spread>| -> Vec<_> {
            cells
                .iter()
                .map(|cell| spread(cell).map(|spread| spread.mean))
                .collect()
        };
        let (rotation, rms) = (means(|cell| cell.rotation_rev), means(|cell| cell.rms_mm));
        let trace = Scatter::new(values(&rotation), values(&rms))
            .name(super::escaped(name))
            .mode(Mode::Markers)
            .marker(Marker::new().size(9).color(color))
            .error_x(interval(&rotation, color))
            .error_y(interval(&rms, color))
            .hover_text_array(
                cells
                    .iter()
                    .map(|cell| super::escaped(&cell.label()))
                    .collect::<Vec<_>>(),
            );
        plot.add_trace(trace);
    }
    let mut front: Vec<(f64, f64)> = (summary.cells.iter().filter(|cell| cell.pareto))
        .filter_map(|cell| Some((cell.rotation_rev?.mean.value, cell.rms_mm?.mean.value)))
        .collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (x, y) = front.into_iter().unzip();
    let trace = Scatter::new(x, y)
        .name("Pareto front")
        .mode(Mode::Lines)
        .line(Line::new().color(theme::GREY).width(1.5));
    plot.add_trace(trace);
    plot
}

/// Samples that were not answered by an optimal plan or a law, by cause.
pub(super) fn fallbacks(summary: &CampaignSummary) -> Plot {
    let cells = &summary.cells;
    let layout = theme::layout()
        .bar_mode(BarMode::Stack)
        .x_axis(cell_axis(cells))
        .y_axis(theme::axis("samples, %"));
    let mut plot = theme::plot(layout);
    let causes: [(&str, &str, CauseOf); 4] = [
        ("soft limit violated", theme::ORANGE, |c| {
            c.fallbacks.degraded
        }),
        ("earlier plan", theme::RED, |c| c.fallbacks.shifted_plan),
        ("stop: no plan", theme::BLACK, |c| c.fallbacks.no_plan),
        ("stop: no measurement", theme::PURPLE, |c| {
            c.fallbacks.no_measurement
        }),
    ];
    for (name, color, cause) in causes {
        let shares = cells
            .iter()
            .map(|cell| 100.0 * cause(cell).steps as f64 / cell.steps as f64);
        let trace = Bar::new(positions(cells, 0.0), shares.collect())
            .name(name)
            .hover_text_array(labels(cells))
            .marker(Marker::new().color(color));
        plot.add_trace(trace);
    }
    plot
}

/// The value of the grid's controller; of a campaign with one controller, of all runs.
fn controller(cell: &CellSummary) -> &str {
    let setting = (cell.settings.iter()).find(|setting| setting.key == KEY_OF_CONTROLLER);
    setting.map_or("all runs", |setting| setting.value.as_str())
}

fn positions(cells: &[CellSummary], offset: f64) -> Vec<f64> {
    cells.iter().map(|cell| cell.cell as f64 + offset).collect()
}

fn labels(cells: &[CellSummary]) -> Vec<String> {
    cells
        .iter()
        .map(|cell| super::escaped(&cell.label()))
        .collect()
}

fn values(estimates: &[Option<Estimate>]) -> Vec<f64> {
    let value = |estimate: &Option<Estimate>| estimate.map_or(f64::NAN, |e| e.value);
    estimates.iter().map(value).collect()
}

fn interval(estimates: &[Option<Estimate>], color: &'static str) -> ErrorData {
    let reach = |end: fn(&Estimate) -> Option<f64>| -> Vec<f64> {
        let reach = |e: &Estimate| end(e).map_or(0.0, |end| (end - e.value).abs());
        estimates
            .iter()
            .map(|e| e.as_ref().map_or(0.0, reach))
            .collect()
    };
    ErrorData::new(ErrorType::Data)
        .symmetric(false)
        .array(reach(|e| e.high))
        .array_minus(reach(|e| e.low))
        .color(color)
        .thickness(1.2)
}

fn points(
    cells: &[CellSummary],
    estimates: &[Option<Estimate>],
    name: &str,
    color: &'static str,
    offset: f64,
) -> Box<Scatter<f64, f64>> {
    Scatter::new(positions(cells, offset), values(estimates))
        .name(name)
        .mode(Mode::Markers)
        .marker(Marker::new().size(7).color(color))
        .error_y(interval(estimates, color))
        .hover_text_array(labels(cells))
        .x_axis("x")
}

/// The axis of the cells: what the grid sets where there is room, numbers as in the table elsewhere.
fn cell_axis(cells: &[CellSummary]) -> Axis {
    let shown = cells.len() <= MOST_LABELS;
    let title = if shown { "" } else { "cell of the grid" };
    let axis = theme::axis(title).range(vec![-0.5, cells.len().max(1) as f64 - 0.5]);
    if !shown {
        return axis;
    }
    let text = |cell: &CellSummary| {
        let values: Vec<&str> = cell.settings.iter().map(|s| s.value.as_str()).collect();
        let label = match values.is_empty() {
            true => cell.label(),
            false => values.join(", "),
        };
        let short: String = label.chars().take(LONGEST_LABEL).collect();
        super::escaped(&short)
    };
    axis.tick_values(positions(cells, 0.0))
        .tick_text(cells.iter().map(text).collect())
}

fn spreads_layout(cells: &[CellSummary]) -> Layout {
    const GAP: f64 = 0.03;
    let row = |i: usize, title: &str| {
        let height = (1.0 + GAP) / (ROWS.len() + 1) as f64;
        let top = 1.0 - i as f64 * height;
        theme::axis(title).domain(&[(top - height + GAP).max(0.0), top])
    };
    theme::layout()
        .x_axis(cell_axis(cells).anchor("y5"))
        .y_axis(row(0, "success, %").range(vec![-4.0, 104.0]))
        .y_axis2(row(1, "RMS, mm").type_(AxisType::Log))
        .y_axis3(row(2, "worst, mm").type_(AxisType::Log))
        .y_axis4(row(3, "rotation, rev"))
        .y_axis5(row(4, "step, µs").type_(AxisType::Log))
}
