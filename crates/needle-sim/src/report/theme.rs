//! Colours, fonts and margins that all figures share. The colours are those of Okabe and Ito, told apart by the colour-blind.

use plotly::common::{Font, Orientation, Title};
use plotly::configuration::Configuration;
use plotly::layout::{Axis, Legend, Margin, ModeBar};
use plotly::{Layout, Plot};

pub(super) const BLACK: &str = "#1a1a1a";
pub(super) const GREY: &str = "#8a8f98";
pub(super) const BLUE: &str = "#0072b2";
pub(super) const SKY: &str = "#56b4e9";
pub(super) const ORANGE: &str = "#e69f00";
pub(super) const RED: &str = "#d55e00";
pub(super) const GREEN: &str = "#009e73";
pub(super) const PURPLE: &str = "#cc79a7";

/// One colour a controller, in this order; more repeat.
#[cfg(feature = "campaign")]
pub(super) const SERIES: [&str; 7] = [BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK];

const GRID: &str = "#e6e8eb";

pub(super) fn font() -> Font {
    Font::new()
        .family("system-ui, sans-serif")
        .size(13)
        .color(BLACK)
}

/// A layout on white with a legend in rows above the picture.
pub(super) fn layout() -> Layout {
    let legend = Legend::new()
        .orientation(Orientation::Horizontal)
        .x(0.0)
        .y(1.02)
        .y_anchor(plotly::common::Anchor::Bottom);
    Layout::new()
        .font(font())
        .auto_size(true)
        .paper_background_color("#ffffff")
        .plot_background_color("#ffffff")
        .margin(Margin::new().left(64).right(44).top(24).bottom(48))
        .legend(legend)
        // Beside the picture: above it stands the legend.
        .mode_bar(ModeBar::new().orientation(Orientation::Vertical))
}

/// An axis with a title that names the unit.
pub(super) fn axis(title: &str) -> Axis {
    Axis::new()
        .title(Title::with_text(title))
        .grid_color(GRID)
        .zero_line_color(GRID)
        .show_line(true)
        .line_color(GREY)
        .auto_margin(true)
}

/// A plot that fits its place on the page.
pub(super) fn plot(layout: Layout) -> Plot {
    let mut plot = Plot::new();
    plot.set_layout(layout);
    plot.set_configuration(Configuration::new().responsive(true).display_logo(false));
    plot
}
