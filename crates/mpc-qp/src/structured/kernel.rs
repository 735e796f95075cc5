//! Small dense products on fixed arrays, and the run-time choice of instruction set.
//!
//! Every product is a sum of scaled columns, four rows at a time, then two, then one: stores and later
//! loads have the same widths, so that the processor can forward one to the other. The functions are always
//! inlined into a [`Phase`], compiled once for AVX2 with fused multiply-add and once for the
//! baseline of the target; [`run`] picks at run time, so a plain release build uses the fast path
//! wherever the machine has it. AVX-512 is left out on purpose: blocks of six to twelve rows do not
//! fill its registers, and it was slower.

use super::lanes::Portable;
pub(super) use super::lanes::{Lanes, larger};

/// A piece of work that is compiled once per instruction set.
pub(super) trait Phase {
    /// What the work returns.
    type Output;
    /// Does the work with the given arithmetic. Implement with `#[inline(always)]`.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
struct Fused<P>(P, pulp::x86::V3);

#[cfg(target_arch = "x86_64")]
impl<P: Phase> pulp::NullaryFnOnce for Fused<P> {
    type Output = P::Output;
    #[inline(always)]
    fn call(self) -> P::Output {
        self.0.run(self.1)
    }
}

#[cfg(test)]
thread_local! {
    /// Whether this thread keeps to the baseline, as a machine without AVX2 does.
    pub(super) static BASELINE: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Runs a phase with the widest instruction set that pays.
#[inline]
pub(super) fn run<P: Phase>(phase: P) -> P::Output {
    #[cfg(test)]
    if BASELINE.get() {
        return phase.run(Portable);
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = pulp::x86::V3::try_new() {
        return avx2.vectorize(Fused(phase, avx2));
    }
    phase.run(Portable)
}

// No closures in the products: a closure is a function of its own, which an unoptimised build leaves outside the
// functions compiled for AVX2.

#[inline(always)]
fn four_at<L: Lanes, const R: usize>(lanes: L, v: &[f64; R], at: usize) -> L::Four {
    lanes.load4([v[at], v[at + 1], v[at + 2], v[at + 3]])
}

#[inline(always)]
fn two_at<L: Lanes, const R: usize>(lanes: L, v: &[f64; R], at: usize) -> L::Two {
    lanes.load2([v[at], v[at + 1]])
}

/// y + sum over j of columns[j] x[j].
#[inline(always)]
pub(super) fn add_product<L: Lanes, const R: usize, const C: usize>(
    lanes: L,
    columns: &[[f64; R]; C],
    x: &[f64; C],
    y: &[f64; R],
) -> [f64; R] {
    let mut sum = *y;
    let mut at = 0;
    // Two parts at a time: each spread entry of x serves both.
    while R - at >= 8 {
        let (mut low, mut high) = (four_at(lanes, y, at), four_at(lanes, y, at + 4));
        for j in 0..C {
            low = lanes.fma4(x[j], four_at(lanes, &columns[j], at), low);
            high = lanes.fma4(x[j], four_at(lanes, &columns[j], at + 4), high);
        }
        sum[at..at + 4].copy_from_slice(&lanes.store4(low));
        sum[at + 4..at + 8].copy_from_slice(&lanes.store4(high));
        at += 8;
    }
    if R - at >= 6 {
        let (mut low, mut high) = (four_at(lanes, y, at), two_at(lanes, y, at + 4));
        for j in 0..C {
            low = lanes.fma4(x[j], four_at(lanes, &columns[j], at), low);
            high = lanes.fma2(x[j], two_at(lanes, &columns[j], at + 4), high);
        }
        sum[at..at + 4].copy_from_slice(&lanes.store4(low));
        sum[at + 4..at + 6].copy_from_slice(&lanes.store2(high));
        at += 6;
    } else if R - at >= 4 {
        let mut part = four_at(lanes, y, at);
        for j in 0..C {
            part = lanes.fma4(x[j], four_at(lanes, &columns[j], at), part);
        }
        sum[at..at + 4].copy_from_slice(&lanes.store4(part));
        at += 4;
    } else if R - at >= 2 {
        let mut part = two_at(lanes, y, at);
        for j in 0..C {
            part = lanes.fma2(x[j], two_at(lanes, &columns[j], at), part);
        }
        sum[at..at + 2].copy_from_slice(&lanes.store2(part));
        at += 2;
    }
    if at < R {
        for j in 0..C {
            sum[at] = lanes.fma1(x[j], columns[j][at], sum[at]);
        }
    }
    sum
}

/// y - sum over j of columns[j] x[j].
#[inline(always)]
pub(super) fn sub_product<L: Lanes, const R: usize, const C: usize>(
    lanes: L,
    columns: &[[f64; R]; C],
    x: &[f64; C],
    y: &[f64; R],
) -> [f64; R] {
    let mut minus = *x;
    for value in &mut minus {
        *value = -*value;
    }
    add_product(lanes, columns, &minus, y)
}

/// Inner product.
#[inline(always)]
pub(super) fn dot<L: Lanes, const R: usize>(lanes: L, a: &[f64; R], b: &[f64; R]) -> f64 {
    let mut even = 0.0;
    let mut odd = 0.0;
    for i in 0..R {
        if i % 2 == 0 {
            even = lanes.fma1(a[i], b[i], even);
        } else {
            odd = lanes.fma1(a[i], b[i], odd);
        }
    }
    even + odd
}
