//! Linear programs `maximise f x subject to H x <= h` with h >= 0, by the primal simplex method on a dictionary.
//!
//! The sets here contain the origin, so the slack basis is feasible and no first phase is needed; the states are free
//! variables that enter the basis and never leave it. Sizes are a few states by up to some thousand rows. Objective, rows, columns and right side are scaled
//! by powers of two to a largest entry near one, so that the tolerances are relative. Largest-coefficient pivots, then Bland's rule, which cannot cycle;
//! the number of pivots is capped. An interior-point solver would leave an error of its tolerance in every
//! redundancy decision, and has no interior to work in where a limit is zero.

/// Reduced costs and pivots of the scaled program below this count as zero.
const ZERO: f64 = 1e-11;
/// Steps of the scaled program that differ by less are equal.
const TIE: f64 = 1e-13;
/// A column of rows near one that has nothing larger is rounding of a state without limit, and stays as it is.
const NO_COLUMN: f64 = 64.0 * f64::EPSILON;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Maximum {
    Value(f64),
    Unbounded,
    /// The cap on pivots was met.
    Unsettled,
}

/// An optimal corner with its proof: f = sum y_i h_i with y >= 0, so f x <= sum y_i b_i, up to rounding.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Optimum {
    pub(crate) value: f64,
    /// The corner, length n.
    pub(crate) point: Vec<f64>,
    /// The rows with y_i > 0 and that y_i.
    pub(crate) multipliers: Vec<(usize, f64)>,
}

/// Rows s_i = rhs_i + sum coefficients_ij y_j over the nonbasic variables y.
struct Dictionary {
    coefficients: Vec<Vec<f64>>,
    rhs: Vec<f64>,
    costs: Vec<f64>,
    value: f64,
    /// Variable numbers: below n a state (free), from n on a slack.
    basic: Vec<usize>,
    nonbasic: Vec<usize>,
    states: usize,
    scale: Scale,
}

/// Powers of two that multiply f, the right side, each row with its bound, and each column.
struct Scale {
    cost: f64,
    bound: f64,
    rows: Vec<f64>,
    columns: Vec<f64>,
}

/// The maximum of `f x` over the rows `h_i x <= b_i`, b_i >= 0.
pub(crate) fn maximise<'a>(f: &[f64], rows: impl Iterator<Item = (&'a [f64], f64)>) -> Maximum {
    Dictionary::of(f, rows).settle()
}

/// As `maximise`, with the corner and the multipliers; `None` for an unbounded or unsettled program.
pub(crate) fn optimum<'a>(
    f: &[f64],
    rows: impl Iterator<Item = (&'a [f64], f64)>,
) -> Option<Optimum> {
    let mut dictionary = Dictionary::of(f, rows);
    let Maximum::Value(value) = dictionary.settle() else {
        return None;
    };
    let n = dictionary.states;
    let mut point = vec![0.0; n];
    for (&variable, &x) in dictionary.basic.iter().zip(&dictionary.rhs) {
        if variable < n {
            point[variable] = x * dictionary.scale.columns[variable] / dictionary.scale.bound;
        }
    }
    let multipliers = dictionary
        .nonbasic
        .iter()
        .zip(&dictionary.costs)
        .filter(|&(&variable, &cost)| variable >= n && cost < 0.0)
        .map(|(&variable, &cost)| {
            let row = variable - n;
            (
                row,
                -cost * dictionary.scale.rows[row] / dictionary.scale.cost,
            )
        })
        .collect();
    Some(Optimum {
        value,
        point,
        multipliers,
    })
}

impl Scale {
    fn of(f: &[f64], rows: &[Vec<f64>], bounds: &[f64]) -> Self {
        let unit: Vec<f64> = rows.iter().map(|row| down(row.iter().copied())).collect();
        let columns: Vec<f64> = (0..f.len())
            .map(|j| {
                let column = rows.iter().zip(&unit).map(|(row, unit)| row[j] * unit);
                down(column.filter(|x| x.abs() > NO_COLUMN))
            })
            .collect();
        Self {
            cost: down(f.iter().zip(&columns).map(|(f, column)| f * column)),
            bound: down(bounds.iter().zip(&unit).map(|(bound, unit)| bound * unit)),
            rows: unit,
            columns,
        }
    }
}

/// The power of two that takes the largest of the numbers into [1, 2); one for zeros.
fn down(numbers: impl Iterator<Item = f64>) -> f64 {
    let largest = numbers.fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest > 0.0 {
        (-largest.log2().floor()).clamp(-1000.0, 1000.0).exp2()
    } else {
        1.0
    }
}

impl Dictionary {
    fn of<'a>(f: &[f64], rows: impl Iterator<Item = (&'a [f64], f64)>) -> Self {
        let n = f.len();
        let (mut coefficients, mut rhs): (Vec<Vec<f64>>, Vec<f64>) = rows
            .map(|(row, bound)| (row.iter().map(|x| -x).collect::<Vec<f64>>(), bound.max(0.0)))
            .unzip();
        let scale = Scale::of(f, &coefficients, &rhs);
        for ((row, bound), &down) in coefficients.iter_mut().zip(&mut rhs).zip(&scale.rows) {
            *bound *= down * scale.bound;
            for (x, &column) in row.iter_mut().zip(&scale.columns) {
                *x *= down * column;
            }
        }
        let costs = f.iter().zip(&scale.columns);
        Self {
            basic: (n..n + rhs.len()).collect(),
            coefficients,
            rhs,
            costs: costs.map(|(f, column)| f * column * scale.cost).collect(),
            value: 0.0,
            nonbasic: (0..n).collect(),
            states: n,
            scale,
        }
    }

    fn settle(&mut self) -> Maximum {
        let (n, count) = (self.states, self.rhs.len());
        let greedy = 20 * n + 50;
        for step in 0..greedy + 20 * (n + count) {
            let Some((entering, direction)) = self.entering(step < greedy) else {
                return Maximum::Value(self.value / self.scale.cost / self.scale.bound);
            };
            let Some(leaving) = self.leaving(entering, direction) else {
                return Maximum::Unbounded;
            };
            self.pivot(leaving, entering);
        }
        Maximum::Unsettled
    }

    /// A nonbasic variable that improves the objective, and the direction in which it does.
    fn entering(&self, greedy: bool) -> Option<(usize, f64)> {
        let improving = self.costs.iter().enumerate().filter(|&(j, &cost)| {
            if self.nonbasic[j] < self.states {
                cost.abs() > ZERO
            } else {
                cost > ZERO
            }
        });
        let chosen = if greedy {
            improving.max_by(|x, y| x.1.abs().total_cmp(&y.1.abs()))
        } else {
            improving.min_by_key(|&(j, _)| self.nonbasic[j])
        };
        chosen.map(|(j, cost)| (j, cost.signum()))
    }

    /// The slack that meets zero first; of equal ones the largest pivot, so that no digit is lost without need.
    fn leaving(&self, entering: usize, direction: f64) -> Option<usize> {
        let mut best: Option<(usize, f64, f64)> = None;
        for i in 0..self.rhs.len() {
            let rate = direction * self.coefficients[i][entering];
            if self.basic[i] < self.states || rate >= -ZERO {
                continue;
            }
            let step = self.rhs[i].max(0.0) / -rate;
            let better = best.is_none_or(|(_, least, pivot)| {
                step < least - TIE || (step <= least + TIE && -rate > pivot)
            });
            if better {
                best = Some((i, step, -rate));
            }
        }
        best.map(|(i, _, _)| i)
    }

    fn pivot(&mut self, leaving: usize, entering: usize) {
        let inverse = 1.0 / self.coefficients[leaving][entering];
        let mut row = std::mem::take(&mut self.coefficients[leaving]);
        // y = (s - rhs - rest) / pivot.
        for x in &mut row {
            *x *= -inverse;
        }
        row[entering] = inverse;
        let rhs = -self.rhs[leaving] * inverse;
        let substitute = |target: &mut Vec<f64>, constant: &mut f64| {
            let factor = target[entering];
            if factor != 0.0 {
                *constant += factor * rhs;
                for (x, r) in target.iter_mut().zip(&row) {
                    *x += factor * r;
                }
                target[entering] = factor * inverse;
            }
        };
        for (i, target) in self.coefficients.iter_mut().enumerate() {
            if i != leaving {
                substitute(target, &mut self.rhs[i]);
            }
        }
        substitute(&mut self.costs, &mut self.value);
        self.coefficients[leaving] = row;
        self.rhs[leaving] = rhs;
        std::mem::swap(&mut self.basic[leaving], &mut self.nonbasic[entering]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solve(f: &[f64], rows: &[(&[f64], f64)]) -> Maximum {
        maximise(f, rows.iter().copied())
    }

    #[test]
    fn a_triangle_has_its_maximum_at_a_corner() {
        let rows: [(&[f64], f64); 3] =
            [(&[1.0, 1.0], 1.0), (&[-1.0, 0.0], 0.5), (&[0.0, -1.0], 0.0)];
        // Corners (-0.5, 0), (-0.5, 1.5), (1, 0); f = x + 3y is 4 at the second.
        match solve(&[1.0, 3.0], &rows) {
            Maximum::Value(value) => assert!((value - 4.0).abs() < 1e-12),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn an_open_direction_is_unbounded_and_a_degenerate_corner_is_not() {
        assert_eq!(
            solve(&[1.0, 0.0], &[(&[0.0, 1.0], 1.0)]),
            Maximum::Unbounded
        );
        // Four rows through the origin: a cone that contains no direction of increase.
        let rows: [(&[f64], f64); 4] = [
            (&[1.0, 0.0], 0.0),
            (&[0.6, 0.8], 0.0),
            (&[0.8, 0.6], 0.0),
            (&[0.0, 1.0], 0.0),
        ];
        assert_eq!(solve(&[1.0, 1.0], &rows), Maximum::Value(0.0));
    }

    #[test]
    fn the_units_of_objective_rows_bounds_and_states_do_not_matter() {
        // f = 2x + 3y over x + y <= 1, x - 2y <= 1, x >= -1, x + y/2 >= -1 is 4 at (-1, 2).
        let rows = [[1.0, 1.0], [1.0, -2.0], [-1.0, 0.0], [-1.0, -0.5]];
        for unit in [1e-150_f64, 1e-12, 1e-9, 1.0, 1e9, 1e12, 1e150] {
            for (cost, row, bound, state) in [
                (unit, 1.0, 1.0, 1.0),
                (1.0, unit, 1.0, 1.0),
                (1.0, 1.0, unit, 1.0),
                // Rows are scaled first: the larger state of each sets its unit, and the other must stay above ZERO.
                (1.0, 1.0, 1.0, unit.clamp(1e-12, 1e9)),
            ] {
                let scaled = rows.map(|r| [row * r[0], row * r[1] * state]);
                let half_spaces = scaled.iter().map(|r| (r.as_slice(), row * bound));
                let found = optimum(&[2.0 * cost, 3.0 * cost * state], half_spaces).unwrap();
                let near = |x: f64, expected: f64| (x / expected - 1.0).abs() < 1e-12;
                assert!(near(found.value, 4.0 * cost * bound), "{found:?}");
                assert!(near(found.point[0], -bound) && near(found.point[1], 2.0 * bound / state));
                // (2, 3) = 3 (1, 1) + 1 (-1, 0).
                let y = |row| {
                    found
                        .multipliers
                        .iter()
                        .find(|y| y.0 == row)
                        .map_or(0.0, |y| y.1)
                };
                assert!(
                    near(y(0), 3.0 * cost / row) && near(y(2), cost / row),
                    "{found:?}"
                );
            }
        }
    }
}
