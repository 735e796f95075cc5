//! A run over time: errors, inputs with their limits, solve times. One axis of time for all rows, so that they zoom together.

use super::decimation::keeping_extremes;
use super::theme;
use crate::record::{OriginRecord, RunRecord, StepRecord};
use crate::scenario::Scenario;
use nalgebra::Vector3;
use needle_control::InputLimits;
use plotly::common::{DashType, Line, LineShape, Marker, MarkerSymbol, Mode};
use plotly::layout::{Axis, AxisType, HoverMode, Shape, ShapeLayer, ShapeLine, ShapeType};
use plotly::{Layout, Plot, Scatter};

/// Stretches of a line; each keeps four points.
const STRETCHES: usize = 800;

/// Fallbacks shown of each kind, at most.
const MOST_MARKS: usize = 1000;

/// A limit is drawn when it is at most this far out, in largest values of the signal; the text names it in any case.
const LIMIT_IN_VIEW: f64 = 4.0;

/// Rows from the top.
#[derive(Clone, Copy)]
enum Row {
    Distance,
    Direction,
    Speed,
    Spin,
    StepTime,
}

const ROWS: f64 = 5.0;
const GAP: f64 = 0.035;

impl Row {
    fn axis(self) -> &'static str {
        ["y", "y2", "y3", "y4", "y5"][self as usize]
    }

    /// Lower and upper end in the figure.
    fn domain(self) -> [f64; 2] {
        let height = (1.0 + GAP) / ROWS;
        let top = 1.0 - self as usize as f64 * height;
        [(top - height + GAP).max(0.0), top]
    }
}

/// Errors, inputs and solve times over time.
pub(super) fn plot(record: &RunRecord, scenario: Option<&Scenario>) -> Plot {
    let signals = Signals {
        steps: &record.steps,
        times_s: record.steps.iter().map(|step| step.time_s).collect(),
    };
    let limits = scenario.map(|scenario| scenario.limits);
    let speed = InputSignal {
        row: Row::Speed,
        value: |input| input.v_mm_s,
        limits: limits.map(|l| [l.v_min_mm_s, l.v_max_mm_s]),
    };
    let spin = InputSignal {
        row: Row::Spin,
        value: |input| input.omega_rad_s,
        limits: limits.map(|l: InputLimits| [-l.omega_max_rad_s, l.omega_max_rad_s]),
    };
    let mut plot = theme::plot(layout(&signals, &speed, &spin));
    signals.errors(&mut plot);
    signals.fallbacks(&mut plot);
    signals.input(&mut plot, &speed, true);
    signals.input(&mut plot, &spin, false);
    let step_us = signals.of(|step| positive(step.step_us));
    let line = signals.line(&step_us, "controller's step", Row::StepTime, theme::GREEN);
    plot.add_trace(line.show_legend(false));
    plot
}

struct Signals<'a> {
    steps: &'a [StepRecord],
    times_s: Vec<f64>,
}

/// One of the two inputs.
struct InputSignal {
    row: Row,
    value: fn(&crate::record::InputRecord) -> f64,
    limits: Option<[f64; 2]>,
}

impl Signals<'_> {
    fn of(&self, value: impl Fn(&StepRecord) -> f64) -> Vec<f64> {
        self.steps.iter().map(value).collect()
    }

    fn line(
        &self,
        values: &[f64],
        name: &str,
        row: Row,
        color: &'static str,
    ) -> Box<Scatter<f32, f32>> {
        let kept = keeping_extremes(values, STRETCHES);
        let x = kept.iter().map(|&i| self.times_s[i] as f32).collect();
        let y = kept.iter().map(|&i| values[i] as f32).collect();
        Scatter::new(x, y)
            .name(name)
            .mode(Mode::Lines)
            .line(Line::new().color(color).width(1.6))
            .x_axis("x")
            .y_axis(row.axis())
    }

    fn errors(&self, plot: &mut Plot) {
        let distance = self.of(|step| step.distance_mm);
        plot.add_trace(self.line(&distance, "tip to path", Row::Distance, theme::BLUE));
        let estimate = self.of(estimation_error_mm);
        if estimate.iter().any(|error| *error > 0.0) {
            let name = "estimated tip to tip";
            plot.add_trace(self.line(&estimate, name, Row::Distance, theme::ORANGE));
        }
        let direction = self.of(direction_error_deg);
        let line = self.line(&direction, "direction", Row::Direction, theme::BLUE);
        plot.add_trace(line.show_legend(false));
    }

    /// Samples that no optimal plan answered, on the line of the distance.
    fn fallbacks(&self, plot: &mut Plot) {
        let kinds = [
            (OriginRecord::Degraded, "soft limit violated", theme::ORANGE),
            (OriginRecord::ShiftedPlan, "earlier plan", theme::RED),
            (OriginRecord::StopNoPlan, "stop: no plan", theme::BLACK),
            (
                OriginRecord::StopNoMeasurement,
                "stop: no measurement",
                theme::PURPLE,
            ),
        ];
        for (origin, name, color) in kinds {
            let steps: Vec<&StepRecord> = (self.steps.iter())
                .filter(|step| step.origin == origin)
                .collect();
            let kept = super::decimation::evenly(steps.len(), MOST_MARKS);
            if kept.is_empty() {
                continue;
            }
            let x = kept.iter().map(|&i| steps[i].time_s as f32).collect();
            let y = kept.iter().map(|&i| steps[i].distance_mm as f32).collect();
            let marker = Marker::new().symbol(MarkerSymbol::X).size(6).color(color);
            let trace = Scatter::new(x, y)
                .name(name)
                .mode(Mode::Markers)
                .marker(marker);
            plot.add_trace(trace.x_axis("x").y_axis(Row::Distance.axis()));
        }
    }

    fn input(&self, plot: &mut Plot, signal: &InputSignal, in_legend: bool) {
        let held = |color| Line::new().color(color).width(1.6).shape(LineShape::Hv);
        let commanded = self.of(|step| (signal.value)(&step.input));
        let driven = self.of(|step| (signal.value)(&step.base_input));
        if commanded != driven {
            let line = self.line(&driven, "input of the base", signal.row, theme::SKY);
            let line = line.line(held(theme::SKY)).legend_group("driven");
            plot.add_trace(line.show_legend(in_legend));
        }
        let line = self.line(&commanded, "commanded input", signal.row, theme::BLUE);
        let line = line.line(held(theme::BLUE)).legend_group("commanded");
        plot.add_trace(line.show_legend(in_legend));
        let (Some(limits), Some(last)) = (signal.limits, self.times_s.last()) else {
            return;
        };
        let ends = vec![0.0, *last as f32];
        for (i, limit) in limits.into_iter().filter(|l| l.is_finite()).enumerate() {
            let dashed = Line::new()
                .color(theme::RED)
                .width(1.2)
                .dash(DashType::Dash);
            let trace = Scatter::new(ends.clone(), vec![limit as f32; 2])
                .name("limits")
                .mode(Mode::Lines)
                .line(dashed)
                .legend_group("limits")
                .show_legend(in_legend && i == 0);
            plot.add_trace(trace.x_axis("x").y_axis(signal.row.axis()));
        }
    }

    /// Both values of the input and, if they are not far out, its limits.
    fn range(&self, signal: &InputSignal) -> Vec<f64> {
        let values = self.steps.iter().flat_map(|step| {
            [
                (signal.value)(&step.input),
                (signal.value)(&step.base_input),
            ]
        });
        let values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
        let largest = values.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let near = |limit: &f64| limit.abs() <= LIMIT_IN_VIEW * largest;
        let limits = signal.limits.into_iter().flatten().filter(near);
        let (low, high) = values
            .iter()
            .copied()
            .chain(limits)
            .fold((0.0, 0.0), |(low, high): (f64, f64), x| {
                (low.min(x), high.max(x))
            });
        let margin = match high > low {
            true => 0.08 * (high - low),
            false => 1.0,
        };
        vec![low - margin, high + margin]
    }
}

/// What a logarithmic axis can show.
fn positive(value: f64) -> f64 {
    if value > 0.0 { value } else { f64::NAN }
}

fn estimation_error_mm(step: &StepRecord) -> f64 {
    let Some(estimate) = &step.estimated else {
        return f64::NAN;
    };
    (Vector3::from(estimate.position_mm) - Vector3::from(step.tip.position_mm)).norm()
}

/// Angle between the tip's tangent and that of the path beside it.
fn direction_error_deg(step: &StepRecord) -> f64 {
    let (tip, path) = (step.tip.pose().tangent(), step.reference.pose().tangent());
    tip.cross(&path).norm().atan2(tip.dot(&path)).to_degrees()
}

fn time_axis(times_s: &[f64]) -> Axis {
    let axis = theme::axis("time, s");
    match times_s.last() {
        Some(&last_s) if last_s > 0.0 => axis.range(vec![0.0, last_s]),
        _ => axis,
    }
}

fn layout(signals: &Signals<'_>, speed: &InputSignal, spin: &InputSignal) -> Layout {
    let row = |row: Row, title: &str| -> Axis { theme::axis(title).domain(&row.domain()) };
    let first_s = signals.times_s.get(signals.times_s.len() / 2);
    let first_s = first_s.copied().unwrap_or(0.0);
    let cursor = Shape::new()
        .shape_type(ShapeType::Line)
        .layer(ShapeLayer::Above)
        .x_ref("x")
        .y_ref("paper")
        .x0(first_s)
        .x1(first_s)
        .y0(0.0)
        .y1(1.0)
        .line(ShapeLine::new().color(theme::GREY).width(1.0));
    theme::layout()
        .hover_mode(HoverMode::XUnified)
        .x_axis(time_axis(&signals.times_s).anchor(Row::StepTime.axis()))
        .y_axis(row(Row::Distance, "error, mm"))
        .y_axis2(row(Row::Direction, "direction, °"))
        .y_axis3(row(Row::Speed, "v, mm/s").range(signals.range(speed)))
        .y_axis4(row(Row::Spin, "ω, rad/s").range(signals.range(spin)))
        .y_axis5(row(Row::StepTime, "step, µs").type_(AxisType::Log))
        .shapes(vec![cursor])
}
