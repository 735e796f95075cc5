//! Which units: inputs by the room that their bounds leave, states by what such inputs do to them, the cost by its curvature.
//!
//! Every quantity here moves with the data's units. Most are known only between two sizes (what the data ask for, what bounds allow or
//! unstable plants do): where one lies between them, the unit stays as given.

use super::Units;
use crate::problem::OcpQp;
use crate::softening::Penalty;
use crate::stage::Stage;
use crate::terminal::TerminalSet;
use crate::validation::coincide;
use nalgebra::{SMatrix, SVector};

/// Stages over which a unit impulse of an input is followed, as long as no state grows beyond this multiple of its first response: a
/// double integrator grows by 31, an unstable plant's growth says nothing about where its states will be.
const FOLLOWED: usize = 16;
const GROWN: f64 = 32.0;

/// Part of an input's largest response below which a response is rounding, squared.
const NO_RESPONSE: f64 = 1e-16;

/// Sizes of inputs, states and rows from 2^-7 to 2^4 are left as they are: the solvers' constants serve there, and nothing has to be
/// converted. Responses over the horizon add up, hence the lower upper end.
const ORDINARY: [f64; 2] = [0.0078125, 16.0];

/// The same for the cost, which both solvers scale by themselves.
const ORDINARY_COST: [f64; 2] = [1e-6, 1e6];

/// The power of two next to `size`; one where the size is ordinary or says nothing.
fn power_of_two(size: f64, [low, high]: [f64; 2]) -> f64 {
    if size.is_finite() && size > 0.0 && !(low..=high).contains(&size) {
        size.log2().round().clamp(-100.0, 100.0).exp2()
    } else {
        1.0
    }
}

/// The size nearest to one between `high` and a smaller `low`, where that says something.
fn nearest_to_one(low: f64, high: f64) -> f64 {
    if low > 0.0 && low < high {
        1.0_f64.clamp(low, high)
    } else {
        high
    }
}

/// The larger one, with infinite numbers as absent ones.
fn larger(one: f64, other: f64) -> f64 {
    if other.is_finite() {
        one.max(other)
    } else {
        one
    }
}

/// The median distance of these bounds where they are apart, zero if they are nowhere; `distances` is memory for it.
///
/// One stage may be held by a delay or opened by 1e6: neither is the size of the others. Of an even number the wider of the middle two.
fn median(bounds: impl Iterator<Item = (f64, f64)>, distances: &mut [f64]) -> f64 {
    let apart = bounds.filter(|&(lower, upper)| !coincide(lower, upper, 0.0));
    let proper = apart
        .map(|(lower, upper)| upper - lower)
        .filter(|distance| distance.is_finite());
    let mut count = 0;
    for (to, distance) in distances.iter_mut().zip(proper) {
        *to = distance;
        count += 1;
    }
    if count == 0 {
        return 0.0;
    }
    let (_, median, _) = distances[..count].select_nth_unstable_by(count / 2, f64::total_cmp);
    *median
}

/// The median distance of the bounds of each input; where there is none, of its rates' bounds; zero without either.
fn room<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    distances: &mut [f64],
) -> SVector<f64, NU> {
    let stages = || problem.stages().iter();
    SVector::from_fn(|i, _| {
        let of_inputs = stages().map(|stage| (stage.u_min[i], stage.u_max[i]));
        let of_inputs = median(of_inputs, distances);
        if of_inputs > 0.0 {
            return of_inputs;
        }
        let of_rates = stages().map(|stage| (stage.du_min[i], stage.du_max[i]));
        median(of_rates, distances)
    })
}

/// Squared responses of the states to a unit impulse of each input at stage 0, summed over the stages, and the curvature of the cost
/// along it.
fn responses<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
) -> (SMatrix<f64, NX, NU>, SVector<f64, NU>) {
    let (stages, n) = (problem.stages(), problem.horizon());
    let weight = |k: usize| {
        stages
            .get(k)
            .map_or(&problem.terminal().p, |stage| &stage.q)
    };
    let (mut squares, mut curvature) =
        (SMatrix::<f64, NX, NU>::zeros(), SVector::<f64, NU>::zeros());
    for j in 0..NU {
        let mut response: SVector<f64, NX> = stages[0].b.column(j).into();
        let mut first = response.abs();
        curvature[j] = stages[0].r[(j, j)];
        for k in 1..=n.min(FOLLOWED) {
            first.zip_apply(&response, |first, value| {
                if *first == 0.0 {
                    *first = value.abs();
                }
            });
            if response.zip_fold(&first, false, |grown, value, first| {
                grown || value.abs() > GROWN * first
            }) {
                break;
            }
            let mut sum = squares.column_mut(j);
            sum += response.component_mul(&response);
            curvature[j] += response.dot(&(weight(k) * response));
            if let Some(stage) = stages.get(k) {
                response = stage.a * response;
            }
        }
        let mut squares = squares.column_mut(j);
        let least = NO_RESPONSE * squares.amax();
        squares.apply(|square| {
            if *square < least {
                *square = 0.0;
            }
        });
        let last: SVector<f64, NX> = stages[n - 1].b.column(j).into();
        curvature[j] = curvature[j].max(last.dot(&(weight(n) * last)));
    }
    (squares, curvature)
}

/// The largest number given for each state: start, bounds, target.
fn given<const NX: usize, const NU: usize>(problem: &OcpQp<NX, NU>) -> SVector<f64, NX> {
    let terminal = problem.terminal();
    SVector::from_fn(|i, _| {
        let mut largest = problem.initial_state()[i].abs();
        for stage in &problem.stages()[1..] {
            largest = larger(larger(largest, stage.x_min[i].abs()), stage.x_max[i].abs());
        }
        largest = larger(
            larger(largest, terminal.x_min[i].abs()),
            terminal.x_max[i].abs(),
        );
        match &terminal.set {
            TerminalSet::Equality { target } => largest.max(target[i].abs()),
            TerminalSet::Ellipsoid { center, .. } => largest.max(center[i].abs()),
            TerminalSet::None | TerminalSet::Polytope { .. } => largest,
        }
    })
}

/// The largest multiple of `moved`, root squares, that a given number asks for.
fn asked<const NX: usize>(given: &SVector<f64, NX>, moved: &SVector<f64, NX>) -> f64 {
    (0..NX)
        .filter(|&i| moved[i] > 0.0)
        .map(|i| given[i] / moved[i].sqrt())
        .fold(0.0, larger)
}

/// Units of the inputs: between the room of their bounds and what moves the states as far as they are asked to go; of those that nothing
/// limits, what has the curvature of the others, or together what moves the states so far.
fn of_inputs<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    squares: &SMatrix<f64, NX, NU>,
    curvature: &SVector<f64, NU>,
    distances: &mut [f64],
) -> SVector<f64, NU> {
    let (given, widths) = (given(problem), room(problem, distances));
    let room = SVector::<f64, NU>::from_fn(|j, _| {
        nearest_to_one(asked(&given, &squares.column(j).into()), widths[j])
    });
    let steepest = (0..NU)
        .map(|j| room[j] * room[j] * curvature[j])
        .fold(0.0, f64::max);
    let mut sizes = SVector::<f64, NU>::from_fn(|j, _| {
        if room[j] > 0.0 {
            room[j]
        } else if curvature[j] > 0.0 {
            (if steepest > 0.0 { steepest } else { 1.0 } / curvature[j]).sqrt()
        } else {
            1.0
        }
    });
    if room.amax() == 0.0 {
        let farthest = asked(&given, &(squares * sizes.component_mul(&sizes)));
        if farthest > 0.0 {
            sizes *= farthest;
        }
    }
    sizes.map(|size| power_of_two(size, ORDINARY))
}

/// Units of the states: between the response to inputs of unit size and what is given, or that where inputs do nothing. Where one price holds for
/// violations of all states, all have the same unit.
fn of_states<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    squares: &SMatrix<f64, NX, NU>,
    inputs: &SVector<f64, NU>,
) -> SVector<f64, NX> {
    let moved = squares * inputs.component_mul(inputs);
    let given = given(problem);
    let sizes = SVector::<f64, NX>::from_fn(|i, _| {
        if moved[i] > 0.0 {
            nearest_to_one(given[i], moved[i].sqrt())
        } else {
            given[i]
        }
    });
    let softening = problem.softening();
    let soft_point = softening.terminal_set.is_soft()
        && matches!(problem.terminal().set, TerminalSet::Equality { .. });
    if softening.state_bounds.is_soft() || soft_point {
        let known = sizes.iter().filter(|size| **size > 0.0);
        let mean = known.clone().map(|size| size.log2()).sum::<f64>() / known.count().max(1) as f64;
        return SVector::repeat(power_of_two(mean.exp2(), ORDINARY));
    }
    sizes.map(|size| power_of_two(size, ORDINARY))
}

/// One over the largest curvature in an input, or where there is none over the largest slope.
fn of_cost<const NX: usize, const NU: usize>(
    problem: &OcpQp<NX, NU>,
    units: &Units<NX, NU>,
    curvature: &SVector<f64, NU>,
) -> f64 {
    let steepest = curvature
        .component_mul(&units.input)
        .component_mul(&units.input)
        .amax();
    if steepest > 0.0 {
        return power_of_two(steepest, ORDINARY_COST).recip();
    }
    let slope = |stage: &Stage<NX, NU>| {
        let of_input = stage.r_linear.component_mul(&units.input).amax();
        of_input.max(stage.q_linear.component_mul(&units.state).amax())
    };
    let last = problem
        .terminal()
        .p_linear
        .component_mul(&units.state)
        .amax();
    power_of_two(
        problem.stages().iter().map(slope).fold(last, f64::max),
        ORDINARY_COST,
    )
    .recip()
}

impl<const NX: usize, const NU: usize> Units<NX, NU> {
    /// Chooses the units of `problem`; returns how far the units of the unknowns are apart, one among them, or a scale of a row or
    /// of the cost from one.
    pub(super) fn choose(&mut self, problem: &OcpQp<NX, NU>) -> f64 {
        let (squares, curvature) = responses(problem);
        self.input = of_inputs(problem, &squares, &curvature, &mut self.distances);
        self.state = of_states(problem, &squares, &self.input);
        self.cost = of_cost(problem, self, &curvature);
        let (state, input) = (self.state, self.input);
        let length = |of_state: &SVector<f64, NX>, of_input: &SVector<f64, NU>| {
            of_state.component_mul(&state).norm_squared()
                + of_input.component_mul(&input).norm_squared()
        };
        let softening = problem.softening();
        let factor = |penalty: Penalty, square: f64| match penalty {
            Penalty::Hard => power_of_two(square.sqrt(), ORDINARY).recip(),
            _ => 1.0,
        };
        let rows = problem.stages().iter().flat_map(|stage| &stage.rows);
        for (to, row) in self.rows.iter_mut().zip(rows) {
            *to = factor(softening.rows, length(&row.g_x, &row.h_u));
        }
        if let TerminalSet::Polytope { faces } = &problem.terminal().set {
            for (to, face) in self.faces.iter_mut().zip(faces) {
                *to = factor(
                    softening.terminal_set,
                    length(&face.normal, &SVector::zeros()),
                );
            }
        }
        let unknowns = || self.state.iter().chain(&self.input).copied();
        let apart = unknowns().fold(1.0, f64::max) / unknowns().fold(1.0, f64::min);
        let scales = self.rows.iter().chain(&self.faces).chain([&self.cost]);
        let far = |scale: &f64| scale.max(scale.recip());
        scales.map(far).fold(apart, f64::max)
    }
}
