//! Linear programs `maximise f x subject to H x <= h` with h >= 0, by the primal simplex method on a dictionary.
//!
//! The sets here contain the origin, so the slack basis is feasible and no first phase is needed; the states are free
//! variables that enter the basis and never leave it. Sizes are a few states by up to some thousand rows. Largest-coefficient pivots, then Bland's rule, which cannot cycle;
//! the number of pivots is capped. An interior-point solver would leave an error of its tolerance in every
//! redundancy decision, and has no interior to work in where a limit is zero.

/// Reduced costs and pivots below this count as zero; the rows have unit length.
const ZERO: f64 = 1e-11;

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
            point[variable] = x;
        }
    }
    let multipliers = dictionary
        .nonbasic
        .iter()
        .zip(&dictionary.costs)
        .filter(|&(&variable, &cost)| variable >= n && cost < 0.0)
        .map(|(&variable, &cost)| (variable - n, -cost))
        .collect();
    Some(Optimum {
        value,
        point,
        multipliers,
    })
}

impl Dictionary {
    fn of<'a>(f: &[f64], rows: impl Iterator<Item = (&'a [f64], f64)>) -> Self {
        let n = f.len();
        let (coefficients, rhs): (Vec<Vec<f64>>, Vec<f64>) = rows
            .map(|(row, bound)| (row.iter().map(|x| -x).collect::<Vec<f64>>(), bound.max(0.0)))
            .unzip();
        Self {
            basic: (n..n + rhs.len()).collect(),
            coefficients,
            rhs,
            costs: f.to_vec(),
            value: 0.0,
            nonbasic: (0..n).collect(),
            states: n,
        }
    }

    fn settle(&mut self) -> Maximum {
        let (n, count) = (self.states, self.rhs.len());
        let greedy = 20 * n + 50;
        for step in 0..greedy + 20 * (n + count) {
            let Some((entering, direction)) = self.entering(step < greedy) else {
                return Maximum::Value(self.value);
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
                step < least - 1e-13 || (step <= least + 1e-13 && -rate > pivot)
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
}
