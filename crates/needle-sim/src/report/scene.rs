//! The 3D scene of a run: path and tip track as they are, and what belongs to a time as frames of an animation with a slider.
//!
//! A tip-steered needle's shaft follows its tip, so the shaft at a time is the track up to it. Equal scales on the three axes.

use super::decimation::evenly;
use super::extent::Extent;
use super::sphere;
use super::theme;
use crate::record::{EllipsoidRecord, PoseRecord, RunRecord, StepRecord};
use nalgebra::Vector3;
use plotly::common::{Anchor, DashType, Line, Marker, MarkerSymbol, Mode, Pad, Visible};
use plotly::layout::update_menu::{ButtonBuilder, UpdateMenu, UpdateMenuDirection, UpdateMenuType};
use plotly::layout::{
    Animation, AnimationMode, AnimationOptions, AspectMode, Axis, Camera, DragMode3D, Frame,
    FrameSettings, LayoutScene, Margin, Slider, SliderCurrentValue, SliderStepBuilder,
    TransitionSettings,
};
use plotly::{Layout, Mesh3D, Plot, Scatter3D, Trace, Traces};

/// Moments at the slider, at most.
const MOST_FRAMES: usize = 101;

/// Points of the path, of the track and of the readings, at most.
const MOST_POINTS: usize = 2000;

/// Points of the shaft and of the horizon at one moment, at most.
const MOST_POINTS_OF_A_FRAME: usize = 60;

/// Length of the bevel's mark as a fraction of the scene.
const BEVEL_MARK: f64 = 0.06;

/// Traces that do not move stand before those of the frames.
const STILL_TRACES: usize = 3;

/// The scene with its slider; of a run without samples, the path alone.
pub(super) fn plot(record: &RunRecord) -> Plot {
    let steps: Vec<&StepRecord> = evenly(record.steps.len(), MOST_FRAMES)
        .into_iter()
        .map(|i| &record.steps[i])
        .collect();
    let extent = Extent::of(
        (record.reference.poses.iter().map(|pose| pose.position_mm))
            .chain(record.steps.iter().map(|step| step.tip.position_mm))
            .chain(
                steps
                    .iter()
                    .flat_map(|step| step.predicted_mm.iter().copied()),
            ),
    );
    let mark_mm = BEVEL_MARK * extent.largest_span();
    let moments: Vec<Moment> = steps
        .iter()
        .map(|step| Moment::of(record, step, mark_mm))
        .collect();
    let mut plot = theme::plot(layout(&extent, &moments));
    plot.add_traces(still(record));
    if let Some(moment) = moments.get(shown_first(&moments)) {
        plot.add_traces(moment.traces());
    }
    for moment in &moments {
        plot.add_frame(moment.frame());
    }
    plot
}

/// The page opens in the middle of the run, where there is a shaft as well as a horizon.
fn shown_first(moments: &[Moment]) -> usize {
    moments.len() / 2
}

/// Coordinates of a curve. Single precision is a tenth of a micrometre here and half the file; what is not finite is a gap.
#[derive(Debug, Clone, Default)]
struct Curve {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl FromIterator<[f64; 3]> for Curve {
    fn from_iter<I: IntoIterator<Item = [f64; 3]>>(points: I) -> Self {
        let mut curve = Self::default();
        for [x, y, z] in points {
            curve.x.push(x as f32);
            curve.y.push(y as f32);
            curve.z.push(z as f32);
        }
        curve
    }
}

impl Curve {
    fn through<T>(items: &[T], most: usize, point: impl Fn(&T) -> [f64; 3]) -> Self {
        let kept = evenly(items.len(), most);
        kept.into_iter().map(|i| point(&items[i])).collect()
    }

    fn trace(&self, name: &str) -> Box<Scatter3D<f32, f32, f32>> {
        Scatter3D::new(self.x.clone(), self.y.clone(), self.z.clone())
            .name(name)
            .hover_template("%{x:.2f}, %{y:.2f}, %{z:.2f} mm")
    }

    fn line(&self, name: &str, color: &'static str, width: f64) -> Box<Scatter3D<f32, f32, f32>> {
        let line = Line::new().color(color).width(width);
        self.trace(name).mode(Mode::Lines).line(line)
    }
}

fn still(record: &RunRecord) -> Vec<Box<dyn Trace>> {
    let steps = &record.steps;
    let position = |pose: &PoseRecord| pose.position_mm;
    let path = Curve::through(&record.reference.poses, MOST_POINTS, position);
    let track = Curve::through(steps, MOST_POINTS, |step| step.tip.position_mm);
    let readings: Vec<[f64; 3]> = (steps.iter().filter_map(|step| step.measured.as_ref()))
        .map(|reading| reading.position_mm)
        .collect();
    let dashed = Line::new()
        .color(theme::BLACK)
        .width(3.0)
        .dash(DashType::Dash);
    let dots = Marker::new().size(2).color(theme::PURPLE);
    vec![
        path.line("path", theme::BLACK, 3.0).line(dashed),
        track.line("track of the tip", theme::SKY, 4.0),
        Curve::through(&readings, MOST_POINTS, |position| *position)
            .trace("measured positions")
            .mode(Mode::Markers)
            .marker(dots)
            .visible(Visible::LegendOnly),
    ]
}

/// What the scene shows of one sample.
struct Moment {
    time_s: f64,
    shaft: Curve,
    bevel: Curve,
    horizon: Curve,
    terminal: Curve,
    terminal_text: String,
}

impl Moment {
    fn of(record: &RunRecord, step: &StepRecord, mark_mm: f64) -> Self {
        let until = &record.steps[..(step.step + 1).min(record.steps.len())];
        let pose = step.tip.pose();
        // The bevel bends the tip toward body -y.
        let bevel = pose.position_mm - pose.rotation * Vector3::y() * mark_mm;
        Self {
            time_s: step.time_s,
            shaft: Curve::through(until, MOST_POINTS_OF_A_FRAME, |step| step.tip.position_mm),
            bevel: [step.tip.position_mm, bevel.into()].into_iter().collect(),
            horizon: Curve::through(&step.predicted_mm, MOST_POINTS_OF_A_FRAME, |p| *p),
            terminal: step.terminal.as_ref().map(surface).unwrap_or_default(),
            terminal_text: step.terminal.as_ref().map(lengths).unwrap_or_default(),
        }
    }

    /// Name of the frame: its time, as the slider shows it and the page's script reads it.
    fn name(&self) -> String {
        format!("{:.3}", self.time_s)
    }

    fn traces(&self) -> Vec<Box<dyn Trace>> {
        let end = Marker::new()
            .size_array(vec![0, 5])
            .symbol(MarkerSymbol::Diamond)
            .color(theme::RED);
        let dots = Marker::new().size(3).color(theme::ORANGE);
        let (i, j, k) = sphere::triangles();
        let Curve { x, y, z } = self.terminal.clone();
        vec![
            self.shaft.line("shaft", theme::BLUE, 9.0),
            (self.bevel.line("bevel", theme::RED, 6.0))
                .mode(Mode::LinesMarkers)
                .marker(end),
            (self.horizon.line("predicted horizon", theme::ORANGE, 4.0))
                .mode(Mode::LinesMarkers)
                .marker(dots),
            Mesh3D::new(x, y, z, Some(i), Some(j), Some(k))
                .name("terminal set")
                .color(theme::GREEN)
                .opacity(0.25)
                .show_legend(!self.terminal.x.is_empty())
                .hover_template(&self.terminal_text),
        ]
    }

    fn frame(&self) -> Frame {
        let mut data = Traces::new();
        for trace in self.traces() {
            data.push(trace);
        }
        let indices = (STILL_TRACES..STILL_TRACES + data.len()).collect();
        Frame::new().name(self.name()).data(data).traces(indices)
    }
}

fn surface(ellipsoid: &EllipsoidRecord) -> Curve {
    let [a, b, c] = ellipsoid.half_axes_mm.map(Vector3::from);
    let centre = Vector3::from(ellipsoid.centre_mm);
    sphere::vertices()
        .map(|d| (centre + a * d.x + b * d.y + c * d.z).into())
        .collect()
}

/// Half-axes in words: the set may be too small to be seen.
fn lengths(ellipsoid: &EllipsoidRecord) -> String {
    let mut lengths = ellipsoid
        .half_axes_mm
        .map(|axis| Vector3::from(axis).norm());
    lengths.sort_by(|a, b| b.total_cmp(a));
    let [a, b, c] = lengths;
    format!("terminal set, half-axes {a:.2}, {b:.2}, {c:.2} mm")
}

fn layout(extent: &Extent, moments: &[Moment]) -> Layout {
    let axis =
        |title: &str, i: usize| -> Axis { theme::axis(title).range(extent.range(i).to_vec()) };
    // Depth runs to the right, the side that an unturned needle bends to (-y) up.
    let camera = Camera::new()
        .eye((1.55, -0.75, -0.4).into())
        .up((0.0, -1.0, 0.0).into());
    let scene = LayoutScene::new()
        .x_axis(axis("x, mm", 0))
        .y_axis(axis("y, mm", 1))
        .z_axis(axis("z (insertion), mm", 2))
        // "data" would take the proportions of the data, not those of the ranges.
        .aspect_mode(AspectMode::Manual)
        .aspect_ratio(extent.aspect_ratio().into())
        .drag_mode(DragMode3D::Orbit)
        .camera(camera);
    let layout = theme::layout()
        .margin(Margin::new().left(8).right(36).top(8).bottom(8))
        .scene(scene);
    if moments.len() < 2 {
        return layout;
    }
    layout
        .sliders(vec![slider(moments)])
        .update_menus(vec![play_buttons()])
}

/// Frames change at once: a 3D scene has no transitions, and needs a redraw.
fn at_once(duration_ms: usize) -> AnimationOptions {
    AnimationOptions::new()
        .mode(AnimationMode::Immediate)
        .frame(FrameSettings::new().duration(duration_ms).redraw(true))
        .transition(TransitionSettings::new().duration(0))
}

fn slider(moments: &[Moment]) -> Slider {
    let steps = moments.iter().filter_map(|moment| {
        let animation = Animation::frames(vec![moment.name()]).options(at_once(0));
        let label = format!("{:.2}", moment.time_s);
        let step = SliderStepBuilder::new().label(label).animation(animation);
        // Plain numbers and names always make JSON.
        step.build().ok()
    });
    let value = SliderCurrentValue::new()
        .prefix("t = ")
        .suffix(" s")
        .font(theme::font());
    // The cast is of at most MOST_FRAMES.
    Slider::new()
        .active(shown_first(moments) as i32)
        .steps(steps.collect())
        .current_value(value)
        .pad(Pad::new(24, 8, 0))
        .x(0.24)
        .length(0.74)
        .y(0.0)
        .y_anchor(Anchor::Top)
}

fn play_buttons() -> UpdateMenu {
    let play = Animation::all_frames().options(at_once(60).fromcurrent(true));
    let buttons = [("Play", play), ("Pause", Animation::pause())];
    let buttons = buttons
        .into_iter()
        .filter_map(|(label, animation)| {
            let button = ButtonBuilder::new().label(label).animation(animation);
            button.build().ok()
        })
        .collect();
    UpdateMenu::new()
        .ty(UpdateMenuType::Buttons)
        .direction(UpdateMenuDirection::Left)
        .show_active(false)
        .buttons(buttons)
        .pad(Pad::new(40, 8, 0))
        .x(0.0)
        .x_anchor(Anchor::Left)
        .y(0.0)
        .y_anchor(Anchor::Top)
}
