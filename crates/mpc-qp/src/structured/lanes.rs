//! Arithmetic on two and four numbers at a time, on AVX2 with fused multiply-add and on the baseline of the target.

use std::fmt::Debug;

/// Two and four numbers at a time on one instruction set.
pub(super) trait Lanes: Copy + Debug {
    /// Four numbers.
    type Four: Copy;
    /// Two numbers.
    type Two: Copy;
    /// Reads four numbers.
    fn load4(self, from: [f64; 4]) -> Self::Four;
    /// Four numbers as an array.
    fn store4(self, four: Self::Four) -> [f64; 4];
    /// a b + c with one number for a.
    fn fma4(self, a: f64, b: Self::Four, c: Self::Four) -> Self::Four;
    /// a b + c of each.
    fn muladd4(self, a: Self::Four, b: Self::Four, c: Self::Four) -> Self::Four;
    /// a b.
    fn mul4(self, a: Self::Four, b: Self::Four) -> Self::Four;
    /// a / b.
    fn div4(self, a: Self::Four, b: Self::Four) -> Self::Four;
    /// -a.
    fn neg4(self, a: Self::Four) -> Self::Four;
    /// a + b.
    fn add4(self, a: Self::Four, b: Self::Four) -> Self::Four;
    /// Magnitudes.
    fn abs4(self, a: Self::Four) -> Self::Four;
    /// The larger of each pair, the second if either is NaN.
    fn larger4(self, a: Self::Four, b: Self::Four) -> Self::Four;
    /// Where `sign` is positive `then`, elsewhere `otherwise`.
    fn choose4(self, sign: Self::Four, then: Self::Four, otherwise: Self::Four) -> Self::Four;
    /// Reads two numbers.
    fn load2(self, from: [f64; 2]) -> Self::Two;
    /// Two numbers as an array.
    fn store2(self, two: Self::Two) -> [f64; 2];
    /// a b + c with one number for a.
    fn fma2(self, a: f64, b: Self::Two, c: Self::Two) -> Self::Two;
    /// a b + c on single numbers, fused only where that is an instruction.
    fn fma1(self, a: f64, b: f64, c: f64) -> f64;
}

/// Plain arithmetic for machines without AVX2; the compiler uses what the target has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Portable;

impl Lanes for Portable {
    type Four = [f64; 4];
    type Two = [f64; 2];
    #[inline(always)]
    fn load4(self, from: [f64; 4]) -> [f64; 4] {
        from
    }
    #[inline(always)]
    fn store4(self, four: [f64; 4]) -> [f64; 4] {
        four
    }
    #[inline(always)]
    fn fma4(self, a: f64, b: [f64; 4], c: [f64; 4]) -> [f64; 4] {
        [
            a * b[0] + c[0],
            a * b[1] + c[1],
            a * b[2] + c[2],
            a * b[3] + c[3],
        ]
    }
    #[inline(always)]
    fn muladd4(self, a: [f64; 4], b: [f64; 4], c: [f64; 4]) -> [f64; 4] {
        [
            a[0] * b[0] + c[0],
            a[1] * b[1] + c[1],
            a[2] * b[2] + c[2],
            a[3] * b[3] + c[3],
        ]
    }
    #[inline(always)]
    fn mul4(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]
    }
    #[inline(always)]
    fn div4(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] / b[0], a[1] / b[1], a[2] / b[2], a[3] / b[3]]
    }
    #[inline(always)]
    fn neg4(self, a: [f64; 4]) -> [f64; 4] {
        [-a[0], -a[1], -a[2], -a[3]]
    }
    #[inline(always)]
    fn add4(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
    }
    #[inline(always)]
    fn abs4(self, a: [f64; 4]) -> [f64; 4] {
        a.map(f64::abs)
    }
    #[inline(always)]
    fn larger4(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [
            larger(a[0], b[0]),
            larger(a[1], b[1]),
            larger(a[2], b[2]),
            larger(a[3], b[3]),
        ]
    }
    #[inline(always)]
    fn choose4(self, sign: [f64; 4], then: [f64; 4], otherwise: [f64; 4]) -> [f64; 4] {
        let mut chosen = otherwise;
        for i in 0..4 {
            if sign[i] > 0.0 {
                chosen[i] = then[i];
            }
        }
        chosen
    }
    #[inline(always)]
    fn load2(self, from: [f64; 2]) -> [f64; 2] {
        from
    }
    #[inline(always)]
    fn store2(self, two: [f64; 2]) -> [f64; 2] {
        two
    }
    #[inline(always)]
    fn fma2(self, a: f64, b: [f64; 2], c: [f64; 2]) -> [f64; 2] {
        [a * b[0] + c[0], a * b[1] + c[1]]
    }
    #[inline(always)]
    fn fma1(self, a: f64, b: f64, c: f64) -> f64 {
        a * b + c
    }
}

#[cfg(target_arch = "x86_64")]
impl Lanes for pulp::x86::V3 {
    type Four = pulp::f64x4;
    type Two = pulp::f64x2;
    #[inline(always)]
    fn load4(self, from: [f64; 4]) -> pulp::f64x4 {
        pulp::cast(from)
    }
    #[inline(always)]
    fn store4(self, four: pulp::f64x4) -> [f64; 4] {
        pulp::cast(four)
    }
    #[inline(always)]
    fn fma4(self, a: f64, b: pulp::f64x4, c: pulp::f64x4) -> pulp::f64x4 {
        self.mul_add_f64x4(self.splat_f64x4(a), b, c)
    }
    #[inline(always)]
    fn muladd4(self, a: pulp::f64x4, b: pulp::f64x4, c: pulp::f64x4) -> pulp::f64x4 {
        self.mul_add_f64x4(a, b, c)
    }
    #[inline(always)]
    fn div4(self, a: pulp::f64x4, b: pulp::f64x4) -> pulp::f64x4 {
        self.div_f64x4(a, b)
    }
    #[inline(always)]
    fn neg4(self, a: pulp::f64x4) -> pulp::f64x4 {
        self.xor_f64x4(a, self.splat_f64x4(-0.0))
    }
    #[inline(always)]
    fn mul4(self, a: pulp::f64x4, b: pulp::f64x4) -> pulp::f64x4 {
        self.mul_f64x4(a, b)
    }
    #[inline(always)]
    fn add4(self, a: pulp::f64x4, b: pulp::f64x4) -> pulp::f64x4 {
        self.add_f64x4(a, b)
    }
    #[inline(always)]
    fn abs4(self, a: pulp::f64x4) -> pulp::f64x4 {
        self.abs_f64x4(a)
    }
    #[inline(always)]
    fn larger4(self, a: pulp::f64x4, b: pulp::f64x4) -> pulp::f64x4 {
        self.max_f64x4(a, b)
    }
    #[inline(always)]
    fn choose4(self, sign: pulp::f64x4, then: pulp::f64x4, otherwise: pulp::f64x4) -> pulp::f64x4 {
        let positive = self.cmp_lt_f64x4(self.splat_f64x4(0.0), sign);
        self.select_f64x4(positive, then, otherwise)
    }
    #[inline(always)]
    fn load2(self, from: [f64; 2]) -> pulp::f64x2 {
        pulp::cast(from)
    }
    #[inline(always)]
    fn store2(self, two: pulp::f64x2) -> [f64; 2] {
        pulp::cast(two)
    }
    #[inline(always)]
    fn fma2(self, a: f64, b: pulp::f64x2, c: pulp::f64x2) -> pulp::f64x2 {
        self.mul_add_f64x2(self.splat_f64x2(a), b, c)
    }
    #[inline(always)]
    fn fma1(self, a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

/// Larger of two numbers, one instruction; the second if either is NaN.
#[inline(always)]
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
