//! From the problem's data to the layout of the Newton system, in place.

use super::channel::Channel;
use super::cone::Cone;
use super::elimination::Value;
use super::kernel::Lanes;
use super::newton::{Factorised, Newton, RowData};
use super::riccati::{Gain, Stage};
use super::soft::Price;
use crate::error::SolveError;
use crate::problem::OcpQp;
use crate::softening::Penalty;
use crate::stage::Stage as StageData;
use crate::terminal::TerminalSet;
use nalgebra::SVector;

fn price(penalty: Penalty, unit: f64) -> Price {
    match penalty {
        Penalty::Hard => Price::Hard,
        Penalty::Exact { weight } => Price::Exact(weight / unit),
        Penalty::Quadratic { weight } => Price::Quadratic(weight / unit),
    }
}

/// Curvature of the cost along what a unit impulse of input i at stage 0 does within NX stages, after which no state answers that did not
/// before.
fn curvature<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>, i: usize) -> f64 {
    let (stages, end) = (problem.stages(), &problem.terminal().p);
    let mut response: SVector<f64, NX> = stages[0].b.column(i).into();
    let mut sum = 0.0;
    for k in 1..=stages.len().min(NX) {
        let weight = stages.get(k).map_or(end, |stage| &stage.q);
        sum += response.dot(&(weight * response));
        if let Some(stage) = stages.get(k) {
            response = stage.a * response;
        }
    }
    sum
}

/// The largest curvature of the cost in an input: R plus what the next state's weight makes of B, where that is nothing what later ones
/// make of it; the largest slope of a cost without.
fn cost_unit<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> f64 {
    let mut largest: f64 = 0.0;
    for (k, stage) in problem.stages().iter().enumerate() {
        let q = problem
            .stages()
            .get(k + 1)
            .map_or(&problem.terminal().p, |next| &next.q);
        for i in 0..NU {
            let through: f64 = (0..NX)
                .map(|j| stage.b[(j, i)] * stage.b[(j, i)] * q[(j, j)])
                .sum();
            largest = largest.max(stage.r[(i, i)] + through);
        }
    }
    if largest == 0.0 {
        largest = (0..NU).map(|i| curvature(problem, i)).fold(0.0, f64::max);
    }
    if largest == 0.0 {
        let slopes = |stage: &StageData<NX, NU>| stage.r_linear.amax().max(stage.q_linear.amax());
        let last = problem.terminal().p_linear.amax();
        largest = problem.stages().iter().map(slopes).fold(last, f64::max);
    }
    if largest > 0.0 && largest.is_finite() {
        largest
    } else {
        1.0
    }
}

fn scale<const M: usize, const C: usize>(
    to: &mut [[f64; M]; C],
    from: &[[f64; M]; C],
    factor: f64,
) {
    for (to, from) in to.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        *to = factor * from;
    }
}

fn face_count<const NX: usize>(set: &TerminalSet<NX>) -> usize {
    match set {
        TerminalSet::Equality { .. } => NX,
        TerminalSet::Polytope { faces } => faces.len(),
        TerminalSet::None | TerminalSet::Ellipsoid { .. } => 0,
    }
}

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// Memory for problems of the structure of `problem`.
    pub(super) fn new(problem: &OcpQp<NX, NU>) -> Self {
        let n = problem.horizon();
        let softening = problem.softening();
        let mut row_start = vec![0];
        for stage in problem.stages() {
            row_start.push(row_start.last().map_or(0, |last| last + stage.rows.len()));
        }
        let row_count = row_start.last().map_or(0, |last| *last);
        let faces = face_count(&problem.terminal().set);
        Self {
            n,
            stages: vec![Stage::ZERO; n],
            p: [[0.0; NX]; NX],
            pv: [0.0; NX],
            x0: [0.0; NX],
            u_last: [0.0; NU],
            row_data: vec![
                RowData {
                    gx: [0.0; NX],
                    hu: [0.0; NU]
                };
                row_count
            ],
            row_start,
            faces: vec![[0.0; NX]; faces],
            inputs: Channel::new(n * NU, Price::Hard),
            rates: Channel::new(n * NU, Price::Hard),
            states: Channel::new(n * NX, price(softening.state_bounds, 1.0)),
            rows: Channel::new(row_count, price(softening.rows, 1.0)),
            terminal: Channel::new(faces, price(softening.terminal_set, 1.0)),
            cone: None,
            set_kind: problem.terminal().set.kind(),
            cost_unit: 1.0,
            values: vec![Value::ZERO; n + 1],
            factorised: Factorised::Stale,
            stiff_end: false,
            gains: vec![Gain::ZERO; n],
            feedforward: vec![[0.0; NU]; n],
            gradient: vec![([0.0; NX], [0.0; NU]); n],
            terminal_gradient: [0.0; NX],
        }
    }

    /// Whether `problem` has the structure that the memory was made for.
    pub(super) fn check_shape(&self, problem: &OcpQp<NX, NU>) -> Result<(), SolveError> {
        let mismatch = |field, expected, found| {
            if expected == found {
                Ok(())
            } else {
                Err(SolveError::SolverShape {
                    field,
                    expected,
                    found,
                })
            }
        };
        mismatch("horizon", self.n, problem.horizon())?;
        for (k, stage) in problem.stages().iter().enumerate() {
            mismatch(
                "rows of a stage",
                self.row_start[k + 1] - self.row_start[k],
                stage.rows.len(),
            )?;
        }
        mismatch(
            "terminal faces",
            self.faces.len(),
            face_count(&problem.terminal().set),
        )?;
        let same_kind = self.set_kind == problem.terminal().set.kind();
        mismatch("terminal set of the kind", 1, usize::from(same_kind))?;
        let softening = problem.softening();
        let soft = |channel: &Channel| usize::from(channel.price != Price::Hard);
        mismatch(
            "softness of the state bounds",
            soft(&self.states),
            usize::from(softening.state_bounds.is_soft()),
        )?;
        mismatch(
            "softness of the rows",
            soft(&self.rows),
            usize::from(softening.rows.is_soft()),
        )?;
        mismatch(
            "softness of the terminal set",
            soft(&self.terminal),
            usize::from(softening.terminal_set.is_soft()),
        )
    }

    /// Reads every number of `problem`.
    #[inline(always)]
    pub(super) fn load<L: Lanes>(&mut self, _lanes: L, problem: &OcpQp<NX, NU>) {
        let softening = problem.softening();
        let unit = cost_unit(problem);
        self.cost_unit = unit;
        self.x0 = (*problem.initial_state()).into();
        self.u_last = (*problem.previous_input()).into();
        self.inputs.clear(Price::Hard);
        self.rates.clear(Price::Hard);
        self.states.clear(price(softening.state_bounds, unit));
        self.rows.clear(price(softening.rows, unit));
        self.terminal.clear(price(softening.terminal_set, unit));
        for (k, stage) in problem.stages().iter().enumerate() {
            self.load_stage(k, stage);
            self.load_bounds(k, stage);
        }
        self.load_terminal_cost(problem);
        let terminal = problem.terminal();
        for i in 0..NX {
            self.states
                .bound((self.n - 1) * NX + i, terminal.x_min[i], terminal.x_max[i]);
        }
        self.load_terminal_set(problem);
        // Nobody else touches these once their last bound is gone.
        for channel in self.channels() {
            if !channel.any() {
                channel.weight.fill([0.0; 4]);
                channel.force.fill([0.0; 4]);
            }
        }
    }

    pub(super) fn load_terminal_cost(&mut self, problem: &OcpQp<NX, NU>) {
        self.factorised = Factorised::Stale;
        let terminal = problem.terminal();
        scale(&mut self.p, &terminal.p.data.0, 1.0 / self.cost_unit);
        self.pv = (terminal.p_linear / self.cost_unit).into();
    }

    #[inline(always)]
    pub(super) fn load_stage(&mut self, k: usize, stage: &StageData<NX, NU>) {
        let to = &mut self.stages[k];
        to.a = stage.a.data.0;
        to.b = stage.b.data.0;
        to.c = stage.c.into();
        let factor = 1.0 / self.cost_unit;
        scale(&mut to.q, &stage.q.data.0, factor);
        scale(&mut to.s, &stage.s.data.0, factor);
        scale(&mut to.r, &stage.r.data.0, factor);
        to.qv = (stage.q_linear * factor).into();
        to.rv = (stage.r_linear * factor).into();
        for i in 0..NX {
            for j in 0..NX {
                to.at[i][j] = to.a[j][i];
            }
            for j in 0..NU {
                to.bt[i][j] = to.b[j][i];
            }
        }
    }

    #[inline(always)]
    fn load_bounds(&mut self, k: usize, stage: &StageData<NX, NU>) {
        for i in 0..NU {
            self.inputs
                .bound(k * NU + i, stage.u_min[i], stage.u_max[i]);
            self.rates
                .bound(k * NU + i, stage.du_min[i], stage.du_max[i]);
        }
        if k > 0 {
            for i in 0..NX {
                self.states
                    .bound((k - 1) * NX + i, stage.x_min[i], stage.x_max[i]);
            }
        }
        for (i, row) in stage.rows.iter().enumerate() {
            let index = self.row_start[k] + i;
            let gx: [f64; NX] = if k == 0 { [0.0; NX] } else { row.g_x.into() };
            let known: f64 = if k == 0 {
                (0..NX).map(|j| row.g_x[j] * self.x0[j]).sum()
            } else {
                0.0
            };
            self.row_data[index] = RowData {
                gx,
                hu: row.h_u.into(),
            };
            self.rows.bound(index, f64::NEG_INFINITY, row.upper - known);
        }
    }

    fn load_terminal_set(&mut self, problem: &OcpQp<NX, NU>) {
        match &problem.terminal().set {
            TerminalSet::None | TerminalSet::Ellipsoid { .. } => {}
            TerminalSet::Equality { target } => {
                for i in 0..NX {
                    self.faces[i] = [0.0; NX];
                    self.faces[i][i] = 1.0;
                    self.terminal.bound(i, target[i], target[i]);
                }
            }
            TerminalSet::Polytope { faces } => {
                for (i, face) in faces.iter().enumerate() {
                    self.faces[i] = face.normal.into();
                    self.terminal.bound(i, f64::NEG_INFINITY, face.upper);
                }
            }
        }
        self.cone = problem.terminal_cone().map(|cone| {
            let price = price(problem.softening().terminal_set, self.cost_unit);
            Cone::new(
                &cone.factor.data.0,
                (*cone.center).into(),
                cone.radius,
                price,
            )
        });
    }
}
