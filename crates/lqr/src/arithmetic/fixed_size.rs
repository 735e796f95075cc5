//! Kernels of one square matrix at sizes known to the compiler: sums of powers, definiteness, the norm of an inverse.
//!
//! A handful of states is the common case, and there allocation and dispatch cost more than arithmetic. A matrix of up to 12 rows is padded
//! to the next size that is compiled. Larger ones take the same formulas over faer's matrices, in the modules that call these.

use crate::arithmetic::fixed_block::Block;
use faer::Mat;
use pulp::NullaryFnOnce;

/// Calls a kernel that is generic in the number of states; `None` for more than 12.
macro_rules! by_states {
    ($n:expr, $kernel:ident ( $($argument:expr),* )) => {
        match $n {
            1..=2 => Some($kernel::<2>($($argument),*)),
            3..=4 => Some($kernel::<4>($($argument),*)),
            5..=6 => Some($kernel::<6>($($argument),*)),
            7..=8 => Some($kernel::<8>($($argument),*)),
            9..=12 => Some($kernel::<12>($($argument),*)),
            _ => None,
        }
    };
}
pub(crate) use by_states;

/// Runs a kernel, which is compiled for AVX2 as well, on what the machine has. Rows are independent and nothing is contracted, so the
/// result is the same to the last bit.
pub(crate) fn widest<K: NullaryFnOnce>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = pulp::x86::V3::try_new() {
        return avx2.vectorize(kernel);
    }
    kernel.call()
}

/// X = A'XA + Q by squaring, as `spectrum::lyapunov_sum`.
pub(crate) fn smith_sum<const N: usize>(
    a: &Mat<f64>,
    q: &Mat<f64>,
    max_squarings: usize,
) -> Option<Mat<f64>> {
    let states = a.nrows();
    let x = widest(Smith::<N> {
        power: Block::padded(a),
        x: Block::padded(q),
        max_squarings,
    })?;
    Some(x.corner(states, states))
}

struct Smith<const N: usize> {
    power: Block<N, N>,
    x: Block<N, N>,
    max_squarings: usize,
}

impl<const N: usize> NullaryFnOnce for Smith<N> {
    type Output = Option<Block<N, N>>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let (mut power, mut x) = (self.power, self.x);
        for _ in 0..self.max_squarings {
            let size = power.norm();
            if !size.is_finite() || size > 1e120 {
                return None;
            }
            let carried = power.transposed().mul_inlined(&x.mul_inlined(&power));
            x = x.plus(1.0, &carried.symmetric_part());
            if size < 1e-9 {
                return x.norm().is_finite().then_some(x);
            }
            power = power.mul_inlined(&power);
        }
        None
    }
}

/// Bound on the sum of |A^j|, as `spectrum::sum_of_powers`.
pub(crate) fn power_sum<const N: usize>(a: &Mat<f64>, max_squarings: usize) -> f64 {
    let (mut power, mut sum) = (Block::<N, N>::padded(a), 1.0);
    for _ in 0..max_squarings {
        let size = power.norm();
        if size < 1e-3 {
            return sum / (1.0 - 2.0 * size);
        }
        sum *= 1.0 + size;
        power = power.mul(&power);
    }
    f64::INFINITY
}

/// Whether `w + shift I` is numerically positive definite.
pub(crate) fn is_definite<const N: usize>(w: &Mat<f64>, shift: f64) -> bool {
    corner_is_definite(Block::<N, N>::padded(w), w.nrows(), shift)
}

/// Whether `p - a'pa - least I` is numerically positive definite.
pub(crate) fn decreases<const N: usize>(p: &Mat<f64>, a: &Mat<f64>, least: f64) -> bool {
    let (states, p) = (p.nrows(), Block::<N, N>::padded(p));
    let fall = p.plus(-1.0, &p.congruence(&Block::padded(a)));
    corner_is_definite(fall, states, -least)
}

fn corner_is_definite<const N: usize>(mut w: Block<N, N>, states: usize, shift: f64) -> bool {
    for i in 0..N {
        w.0[i][i] = if i < states { w.0[i][i] + shift } else { 1.0 };
    }
    w.cholesky_solve(Block::<N, 0>::ZERO).is_some()
}

/// One-norm of `p^-1`; infinite where `p` is not numerically positive definite.
pub(crate) fn inverse_norm_one<const N: usize>(p: &Mat<f64>) -> f64 {
    let n = p.nrows();
    let mut block = Block::<N, N>::padded(p);
    for i in n..N {
        block.0[i][i] = 1.0;
    }
    match block.cholesky_solve(Block::identity()) {
        Some(inverse) => inverse.0[..n]
            .iter()
            .map(|column| column.iter().map(|x| x.abs()).sum())
            .fold(0.0, f64::max),
        None => f64::INFINITY,
    }
}
