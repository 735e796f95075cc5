//! Fig. 4 and 6: the tracks in space, on one page that opens without a network and turns with the mouse.

use super::compute::ComputedFigure;
use needle_sim::published::Figure;
use needle_sim::{LogRow, RunLog};
use plotly::common::{Line, Marker, Mode};
use plotly::layout::{Axis, LayoutScene};
use plotly::{Layout, Plot, Scatter3D};
use std::error::Error;

/// The page with the tracks of the straight and the bevel figure, if either was computed.
pub(super) fn page(figures: &[ComputedFigure]) -> Result<Option<String>, Box<dyn Error>> {
    let mut sections = String::new();
    for figure in figures {
        let title = match figure.file.0 {
            Figure::Straight => "Fig. 4: tracking with kappa = 0",
            Figure::Bevel => "Fig. 6: tracking with kappa = 1/150 per mm",
            _ => continue,
        };
        let plot = scene(&figure.logs).to_inline_html(Some(figure.file.stem()));
        sections += &format!("<h2>{title}</h2>\n<div class=\"scene\">{plot}</div>\n");
    }
    if sections.is_empty() {
        return Ok(None);
    }
    let script = Plot::offline_js_sources();
    Ok(Some(format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>Needle tracks</title>\n\
         <style>body {{ font-family: sans-serif; margin: 2em; }} .scene {{ height: 80vh; }}</style>\n{script}\n</head>\n\
         <body>\n{sections}</body>\n</html>\n"
    )))
}

/// The reference as a line, the tip as a marker a step, like the paper's figures.
fn scene(logs: &[RunLog]) -> Plot {
    let mut plot = Plot::new();
    for (i, log) in logs.iter().enumerate() {
        let coordinate = |value: fn(&LogRow) -> Option<f64>| -> Vec<f64> {
            log.rows
                .iter()
                .map(|row| value(row).unwrap_or(0.0))
                .collect()
        };
        let track = Scatter3D::new(
            coordinate(|row| row.x_mm),
            coordinate(|row| row.y_mm),
            coordinate(|row| row.z_mm),
        )
        .name(&log.run);
        plot.add_trace(match i {
            0 => track
                .mode(Mode::Lines)
                .line(Line::new().width(5.0).color("#0072b2")),
            _ => track
                .mode(Mode::Markers)
                .marker(Marker::new().size(3).color("#d55e00")),
        });
    }
    let axis = |name: &str| Axis::new().title(name);
    let scene = LayoutScene::new()
        .x_axis(axis("x (mm)"))
        .y_axis(axis("y (mm)"))
        .z_axis(axis("z (mm)"));
    plot.set_layout(Layout::new().scene(scene));
    plot
}
