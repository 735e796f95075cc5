//! Textbook structure-preserving doubling and nothing else: what a solution costs without a single check.
//!
//! No balancing, no residual, no spectrum, no test of the input; it answers wrongly, or with NaN, where the library refuses.

pub(crate) type Square<const N: usize> = [[f64; N]; N];

fn mul<const N: usize>(a: &Square<N>, b: &Square<N>) -> Square<N> {
    let mut c = [[0.0; N]; N];
    for j in 0..N {
        for k in 0..N {
            for i in 0..N {
                c[j][i] += a[k][i] * b[j][k];
            }
        }
    }
    c
}

fn transposed<const N: usize>(a: &Square<N>) -> Square<N> {
    std::array::from_fn(|j| std::array::from_fn(|i| a[i][j]))
}

fn sum<const N: usize>(a: &Square<N>, b: &Square<N>) -> Square<N> {
    std::array::from_fn(|j| std::array::from_fn(|i| a[j][i] + b[j][i]))
}

fn norm<const N: usize>(a: &Square<N>) -> f64 {
    a.iter().flatten().map(|x| x * x).sum::<f64>().sqrt()
}

/// w^-1 [x, y] by elimination with row pivots.
fn solve<const N: usize>(
    mut w: Square<N>,
    mut x: Square<N>,
    mut y: Square<N>,
) -> (Square<N>, Square<N>) {
    for k in 0..N {
        let pivot = (k..N)
            .max_by(|&i, &j| w[k][i].abs().total_cmp(&w[k][j].abs()))
            .unwrap_or(k);
        let factors: [f64; N] = {
            for m in [&mut w, &mut x, &mut y] {
                m.iter_mut().for_each(|column| column.swap(k, pivot));
            }
            std::array::from_fn(|i| if i > k { w[k][i] / w[k][k] } else { 0.0 })
        };
        for m in [&mut w, &mut x, &mut y] {
            for column in m.iter_mut() {
                let s = column[k];
                for i in 0..N {
                    column[i] -= s * factors[i];
                }
            }
        }
    }
    for m in [&mut x, &mut y] {
        for column in m.iter_mut() {
            for k in (0..N).rev() {
                column[k] /= w[k][k];
                let s = column[k];
                for i in 0..k {
                    column[i] -= s * w[k][i];
                }
            }
        }
    }
    (x, y)
}

/// P for A, G = BR^-1B' and Q, columns first.
pub(crate) fn plain_doubling<const N: usize>(
    mut a: Square<N>,
    mut g: Square<N>,
    mut h: Square<N>,
) -> Square<N> {
    let identity = std::array::from_fn(|j| std::array::from_fn(|i| f64::from(i == j)));
    for _ in 0..50 {
        let (wa, wg) = solve(sum(&identity, &mul(&g, &h)), a, g);
        let growth = mul(&transposed(&a), &mul(&h, &wa));
        g = sum(&g, &mul(&mul(&a, &wg), &transposed(&a)));
        h = sum(&h, &growth);
        a = mul(&a, &wa);
        if norm(&growth) <= 1e-15 * norm(&h) {
            break;
        }
    }
    h
}
