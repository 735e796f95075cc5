//! The figures as SVG: panels over time, one line a run, the reference in black beneath the others.

use super::compute::ComputedFigure;
use needle_sim::published::Figure;
use needle_sim::{LogRow, RunLog};
use plotters::coord::Shift;
use plotters::prelude::*;

/// What the drawing library refuses.
pub(super) type PictureError = DrawingAreaErrorKind<std::io::Error>;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// One panel: a caption with its unit, the value to draw, and the corner that its lines leave free.
struct Panel(
    &'static str,
    fn(&LogRow) -> Option<f64>,
    SeriesLabelPosition,
);

use SeriesLabelPosition::{LowerRight, UpperLeft, UpperRight};

const X: Panel = Panel("position x (mm)", |row| row.x_mm, UpperLeft);
const Y: Panel = Panel("position y (mm)", |row| row.y_mm, UpperRight);
const Z: Panel = Panel("position z (mm)", |row| row.z_mm, LowerRight);
const ALPHA: Panel = Panel("attitude alpha (rad)", |row| row.alpha_rad, LowerRight);
const BETA: Panel = Panel("attitude beta (rad)", |row| row.beta_rad, UpperLeft);
const GAMMA: Panel = Panel("attitude gamma (rad)", |row| row.gamma_rad, LowerRight);

const PANEL_SIZE_PX: (u32, u32) = (520, 260);
const TITLE_HEIGHT_PX: u32 = 40;
const REFERENCE_COLOUR: RGBColor = BLACK;
/// Okabe and Ito (2008): told apart by every eye.
const COLOURS: [RGBColor; 6] = [
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// Title, and panels by columns.
fn layout(figure: Figure) -> (&'static str, &'static [&'static [Panel]]) {
    match figure {
        Figure::Straight => (
            "Fig. 5: reference path and needle tip, kappa = 0",
            &[&[Z], &[GAMMA]],
        ),
        Figure::Bevel => (
            "Fig. 7: reference path and needle tip, kappa = 1/150 per mm",
            &[&[X, Y, Z], &[ALPHA, BETA, GAMMA]],
        ),
        Figure::QSweep => ("Fig. 8: stage cost Q, with R = 10 I", &[&[X, Y, Z]]),
        Figure::QSweepAsText => (
            "Fig. 8: stage cost Q, with R = diag(100, 10) as in the text",
            &[&[X, Y, Z]],
        ),
        Figure::RSweep => ("Fig. 9: input cost R", &[&[X, Y, Z]]),
        Figure::NSweep => ("Fig. 10: prediction horizon N", &[&[X, Y, Z]]),
    }
}

/// The picture of a figure, as the text of an SVG file.
pub(super) fn draw(figure: &ComputedFigure) -> Result<String, PictureError> {
    let (title, columns) = layout(figure.file.0);
    panels(title, columns, &figure.logs)
}

/// Positions over time of any runs, the reference first.
pub(super) fn positions(title: &str, logs: &[RunLog]) -> Result<String, PictureError> {
    panels(title, &[&[X, Y, Z]], logs)
}

fn panels(title: &str, columns: &[&[Panel]], logs: &[RunLog]) -> Result<String, PictureError> {
    let rows = columns.iter().map(|column| column.len()).max().unwrap_or(0);
    let size = (
        PANEL_SIZE_PX.0 * columns.len() as u32,
        PANEL_SIZE_PX.1 * rows as u32 + TITLE_HEIGHT_PX,
    );
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let panels = root
            .titled(title, ("sans-serif", 20))?
            .split_evenly((rows, columns.len()));
        for (i, area) in panels.iter().enumerate() {
            if let Some(panel) = columns[i % columns.len()].get(i / columns.len()) {
                draw_panel(area, panel, logs)?;
            }
        }
        root.present()?;
    }
    Ok(svg)
}

fn draw_panel(
    area: &Area<'_>,
    Panel(caption, value, legend): &Panel,
    logs: &[RunLog],
) -> Result<(), PictureError> {
    let line = |log: &RunLog| -> Vec<(f64, f64)> {
        log.rows
            .iter()
            .filter_map(|row| Some((row.time_s, value(row)?)))
            .collect()
    };
    let lines: Vec<_> = logs
        .iter()
        .map(|log| (log.run.as_str(), line(log)))
        .collect();
    let points = || lines.iter().flat_map(|(_, line)| line);
    let end_s = points().map(|point| point.0).fold(0.0, f64::max);
    let (low, high) = padded_range(points().map(|point| point.1));
    let mut chart = ChartBuilder::on(area)
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..end_s, low..high)?;
    chart
        .configure_mesh()
        .x_desc("time (s)")
        .y_desc(*caption)
        .light_line_style(WHITE)
        .draw()?;
    for (i, (run, line)) in lines.iter().enumerate() {
        // Later lines are thinner, so that runs that coincide can still be seen.
        let style = match i {
            0 => REFERENCE_COLOUR.stroke_width(6),
            _ => {
                COLOURS[(i - 1) % COLOURS.len()].stroke_width((lines.len() - i).clamp(2, 4) as u32)
            }
        };
        chart
            .draw_series(LineSeries::new(line.iter().copied(), style))?
            .label(*run)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
    }
    chart
        .configure_series_labels()
        .position(legend.clone())
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
}

/// The range of the values with a margin, never empty.
fn padded_range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
    match low <= high {
        true => {
            let margin = 0.05 * (high - low).max(1e-6);
            (low - margin, high + margin)
        }
        false => (0.0, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::compute::FigureFile;

    fn log(run: &str, offset: f64) -> RunLog {
        let row = |step| LogRow {
            step,
            time_s: step as f64,
            z_mm: Some(offset),
            gamma_rad: Some(1.0),
            ..LogRow::default()
        };
        RunLog {
            run: run.into(),
            dt_s: 1.0,
            rows: (0..3).map(row).collect(),
        }
    }

    #[test]
    fn a_picture_names_its_axes_units_and_runs() {
        let logs = vec![log("reference", 0.0), log("straight", 1.0)];
        let figure = ComputedFigure {
            file: FigureFile(Figure::Straight),
            runs: vec![],
            logs,
        };
        let svg = draw(&figure).unwrap();
        for text in [
            "time (s)",
            "position z (mm)",
            "attitude gamma (rad)",
            "reference",
            "straight",
            "Fig. 5",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(svg.trim_end().ends_with("</svg>"));
    }

    #[test]
    fn empty_and_constant_ranges_can_be_drawn() {
        assert_eq!(padded_range([].into_iter()), (0.0, 1.0));
        let (low, high) = padded_range([2.0, 2.0, f64::NAN].into_iter());
        assert!(low < 2.0 && high > 2.0);
    }
}
