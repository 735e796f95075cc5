//! Figures and script of a page.

use plotly::Plot;
use std::sync::LazyLock;

/// A figure as HTML: its place on the page and the script that draws it.
#[derive(Debug, Clone)]
pub(super) struct Figure(pub(super) String);

impl Figure {
    /// `id` names the figure's place for the page's script and style.
    pub(super) fn new(id: &str, plot: &Plot) -> Self {
        Self(plot.to_inline_html(Some(id)))
    }
}

/// Plotly's script in its tag. What the library hands out with it, MathJax for formulas, is not used here and left out.
pub(super) fn plotly_script() -> &'static str {
    const END: &str = "</script>";
    static SCRIPT: LazyLock<String> = LazyLock::new(|| {
        let mut scripts = Plot::offline_js_sources();
        let end = scripts.find(END).map_or(scripts.len(), |at| at + END.len());
        scripts.truncate(end);
        scripts
    });
    &SCRIPT
}
