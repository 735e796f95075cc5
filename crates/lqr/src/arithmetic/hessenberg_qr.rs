//! Eigenvalues of a small real matrix: Householder reduction to Hessenberg form, then Francis' double shifts.
//!
//! Eigenvalues only, no vectors, no balancing. A general library spends longer on its workspace than the
//! arithmetic takes at a dozen states. Source: Golub and Van Loan, Matrix Computations, 7.4-7.5.

use faer::c64;

/// Steps allowed for one eigenvalue before the iteration gives up.
const MAX_STEPS: usize = 40;
/// Larger matrices go to faer.
pub(crate) const MAX_SIZE: usize = 12;

/// Column-major working copy of at most `MAX_SIZE` rows.
struct Working {
    entries: [[f64; MAX_SIZE]; MAX_SIZE],
    size: usize,
}

/// Eigenvalues of `scale` times the upper left `size` rows and columns of `entries`, given by columns and then of the order of one;
/// `None` where the iteration gives up.
pub(crate) fn eigenvalues(
    mut entries: [[f64; MAX_SIZE]; MAX_SIZE],
    size: usize,
    scale: f64,
) -> Option<Vec<c64>> {
    for x in entries[..size].as_flattened_mut() {
        *x *= scale;
    }
    let mut working = Working { entries, size };
    working.reduce();
    working.iterate()
}

/// The reflection I - beta vv' that leads x to a multiple of the first unit vector; `None` for x = 0.
fn reflection<const L: usize>(mut x: [f64; L]) -> Option<([f64; L], f64)> {
    let length = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 {
        return None;
    }
    x[0] += length.copysign(x[0]);
    let beta = 2.0 / x.iter().map(|x| x * x).sum::<f64>();
    Some((x, beta))
}

impl Working {
    fn reduce(&mut self) {
        let n = self.size;
        for k in 0..n.saturating_sub(2) {
            let mut x = [0.0; MAX_SIZE];
            x[..n - k - 1].copy_from_slice(&self.entries[k][k + 1..n]);
            if x[1..].iter().all(|&x| x == 0.0) {
                continue;
            }
            if let Some((v, beta)) = reflection(x) {
                let v = &v[..n - k - 1];
                self.reflect(v, beta, k + 1, k..n, 0..n);
                self.entries[k][k + 2..n].fill(0.0);
            }
        }
    }

    /// H <- (I - beta vv') H (I - beta vv'), v from row `first` on; rows act on `columns`, columns on `rows`.
    #[inline]
    fn reflect(
        &mut self,
        v: &[f64],
        beta: f64,
        first: usize,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
    ) {
        for column in &mut self.entries[columns] {
            let part = &mut column[first..first + v.len()];
            let s = beta * part.iter().zip(v).map(|(x, v)| x * v).sum::<f64>();
            for (x, v) in part.iter_mut().zip(v) {
                *x -= s * v;
            }
        }
        let part = &mut self.entries[first..first + v.len()];
        for i in rows {
            let s = beta * part.iter().zip(v).map(|(x, v)| x[i] * v).sum::<f64>();
            for (x, v) in part.iter_mut().zip(v) {
                x[i] -= s * v;
            }
        }
    }

    /// `reflect` for a vector whose length the compiler knows: the inner step of every shift.
    #[inline]
    fn reflect_short<const L: usize>(
        &mut self,
        v: [f64; L],
        beta: f64,
        first: usize,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
    ) {
        let scaled = v.map(|v| beta * v);
        for column in &mut self.entries[columns] {
            if let Some(x) = column[first..].first_chunk_mut::<L>() {
                let s: f64 = (0..L).map(|l| x[l] * v[l]).sum();
                for l in 0..L {
                    x[l] -= s * scaled[l];
                }
            }
        }
        if let Some(part) = self.entries[first..].first_chunk_mut::<L>() {
            let part = part.each_mut().map(|column| &mut column[rows.clone()]);
            for i in 0..rows.len() {
                let s: f64 = (0..L).map(|l| part[l][i] * v[l]).sum();
                for l in 0..L {
                    part[l][i] -= s * scaled[l];
                }
            }
        }
    }

    fn at(&self, row: usize, col: usize) -> f64 {
        self.entries[col][row]
    }

    /// First row of the unreduced block that ends at `last`.
    fn block_start(&self, last: usize) -> usize {
        let mut first = last;
        while first > 0 {
            let beside = self.at(first, first).abs() + self.at(first - 1, first - 1).abs();
            // Beside zeros a subdiagonal entry is compared with the matrix, which is of the order of one.
            let scale = if beside == 0.0 { 1.0 } else { beside };
            if self.at(first, first - 1).abs() <= f64::EPSILON * scale {
                break;
            }
            first -= 1;
        }
        first
    }

    fn iterate(&mut self) -> Option<Vec<c64>> {
        let mut found = Vec::with_capacity(self.size);
        let (mut left, mut steps) = (self.size, 0);
        while left > 0 {
            let last = left - 1;
            let first = self.block_start(last);
            if last - first >= 2 {
                steps += 1;
                if steps > MAX_STEPS {
                    return None;
                }
                self.double_shift(first, last, steps);
                continue;
            }
            if first == last {
                found.push(c64::new(self.at(last, last), 0.0));
            } else {
                found.extend(self.pair(first));
            }
            left = first;
            steps = 0;
        }
        Some(found)
    }

    /// Eigenvalues of the two-by-two block at `first`.
    fn pair(&self, first: usize) -> [c64; 2] {
        let (a, d) = (self.at(first, first), self.at(first + 1, first + 1));
        let product = self.at(first, first + 1) * self.at(first + 1, first);
        let half = 0.5 * (a - d);
        let discriminant = half * half + product;
        if discriminant < 0.0 {
            let (re, im) = (d + half, (-discriminant).sqrt());
            return [c64::new(re, im), c64::new(re, -im)];
        }
        // The root of larger modulus first: the other one by the product, without cancellation.
        let z = half + discriminant.sqrt().copysign(half);
        let other = if z == 0.0 { 0.0 } else { product / z };
        [c64::new(d + z, 0.0), c64::new(d - other, 0.0)]
    }

    /// One implicit step with both eigenvalues of the trailing pair as shifts.
    fn double_shift(&mut self, first: usize, last: usize, step: usize) {
        let (p, q) = (last - 1, last);
        let (mut sum, mut product) = (
            self.at(p, p) + self.at(q, q),
            self.at(p, p) * self.at(q, q) - self.at(p, q) * self.at(q, p),
        );
        if step.is_multiple_of(10) {
            // Shifts of the trailing entries' size break the rare cycles.
            let size = self.at(q, p).abs() + self.at(p, p - 1).abs();
            (sum, product) = (1.5 * size, size * size);
        }
        let (h00, h10) = (self.at(first, first), self.at(first + 1, first));
        let mut x = [
            h00 * (h00 - sum) + self.at(first, first + 1) * h10 + product,
            h10 * (h00 + self.at(first + 1, first + 1) - sum),
            h10 * self.at(first + 2, first + 1),
        ];
        for k in first..last - 1 {
            if let Some((v, beta)) = reflection(x) {
                let columns = k.saturating_sub(1).max(first)..last + 1;
                self.reflect_short(v, beta, k, columns, first..(k + 4).min(last + 1));
            }
            if k > first {
                self.entries[k - 1][k + 1..=k + 2].fill(0.0);
            }
            x = [
                self.at(k + 1, k),
                self.at(k + 2, k),
                if k + 3 <= last {
                    self.at(k + 3, k)
                } else {
                    0.0
                },
            ];
        }
        if let Some((v, beta)) = reflection([x[0], x[1]]) {
            self.reflect_short(v, beta, p, p - 1..last + 1, first..last + 1);
        }
        self.entries[p - 1][q] = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::{MAX_SIZE, eigenvalues};
    use faer::{Mat, c64};
    use proptest::prelude::*;

    fn of(a: &Mat<f64>) -> Vec<c64> {
        let mut entries = [[0.0; MAX_SIZE]; MAX_SIZE];
        for (j, column) in entries[..a.ncols()].iter_mut().enumerate() {
            column[..a.nrows()].copy_from_slice(a.col_as_slice(j));
        }
        eigenvalues(entries, a.nrows(), 1.0).unwrap_or_default()
    }

    /// Largest distance of an eigenvalue to the nearest one not yet taken.
    fn distance(found: &[c64], mut expected: Vec<c64>) -> f64 {
        let mut worst = 0.0_f64;
        for z in found {
            let gap = |w: &c64| (w.re - z.re).hypot(w.im - z.im);
            let nearest = (0..expected.len())
                .min_by(|&i, &j| gap(&expected[i]).total_cmp(&gap(&expected[j])));
            match nearest {
                Some(i) => worst = worst.max(gap(&expected.swap_remove(i))),
                None => return f64::INFINITY,
            }
        }
        worst
    }

    proptest! {
        #[test]
        fn eigenvalues_are_faers(n in 1..=MAX_SIZE, entries in prop::collection::vec(-1.0..1.0, 144)) {
            let a = Mat::from_fn(n, n, |i, j| entries[i * 12 + j]);
            let found = of(&a);
            prop_assert_eq!(found.len(), n);
            // Two backward stable methods; random matrices have eigenvalue conditions up to 1e5.
            let gap = distance(&found, a.eigenvalues().unwrap());
            prop_assert!(gap < 1e-8, "gap {:e}", gap);
        }

        #[test]
        fn integer_matrices_converge(n in 1..=MAX_SIZE, entries in prop::collection::vec(-1_i8..=1, 144)) {
            let a = Mat::from_fn(n, n, |i, j| f64::from(entries[i * 12 + j]));
            let found = of(&a);
            prop_assert_eq!(found.len(), n);
            // Multiple eigenvalues move by a root of rounding, their sum does not.
            let trace: f64 = (0..n).map(|i| a[(i, i)]).sum();
            let sum: f64 = found.iter().map(|z| z.re).sum();
            prop_assert!((trace - sum).abs() < 1e-11, "trace {trace}, sum {sum}");
        }
    }

    #[test]
    fn cyclic_shifts_have_the_roots_of_unity() {
        for n in 1..=MAX_SIZE {
            let a = Mat::from_fn(n, n, |i, j| f64::from(i == (j + 1) % n));
            let roots = (0..n)
                .map(|k| std::f64::consts::TAU * k as f64 / n as f64)
                .map(|angle| c64::new(angle.cos(), angle.sin()))
                .collect();
            // Normal matrices have eigenvalues conditioned by one.
            let found = of(&a);
            assert_eq!(found.len(), n);
            assert!(distance(&found, roots) < 1e-13, "n = {n}");
        }
    }
}
