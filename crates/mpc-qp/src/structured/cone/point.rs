//! Points of the second-order cone's space and their distance from its boundary.

/// A point of the cone's space: first component, then the others.
#[derive(Clone, Copy, Debug)]
pub(in crate::structured) struct Point<const NX: usize> {
    /// First component.
    pub(in crate::structured) head: f64,
    /// The others.
    pub(in crate::structured) tail: [f64; NX],
}

impl<const NX: usize> Point<NX> {
    pub(super) const ZERO: Self = Self {
        head: 0.0,
        tail: [0.0; NX],
    };

    pub(super) fn norm(&self) -> f64 {
        self.tail.iter().map(|t| t * t).sum::<f64>().sqrt()
    }

    /// head^2 - |tail|^2.
    pub(super) fn det(&self) -> f64 {
        let norm = self.norm();
        (self.head - norm) * (self.head + norm)
    }

    pub(super) fn inner(&self, other: &Self) -> f64 {
        self.head * other.head + self.tail_inner(other)
    }

    pub(super) fn tail_inner(&self, other: &Self) -> f64 {
        self.tail.iter().zip(&other.tail).map(|(a, b)| a * b).sum()
    }

    /// self + factor other.
    pub(super) fn plus(&self, factor: f64, other: &Self) -> Self {
        let mut sum = *self;
        sum.head += factor * other.head;
        for (sum, other) in sum.tail.iter_mut().zip(&other.tail) {
            *sum += factor * other;
        }
        sum
    }

    /// Distance inside the cone.
    pub(super) fn depth(&self) -> f64 {
        self.head - self.norm()
    }

    /// The reciprocal of the longest step along `d`.
    pub(super) fn ratio(&self, d: &Self) -> f64 {
        let a = d.det();
        let b = self.head * d.head - self.tail_inner(d);
        let c = self.det();
        let discriminant = b * b - a * c;
        if discriminant < 0.0 {
            0.0
        } else {
            ((discriminant.sqrt() - b) / c).max(0.0)
        }
    }
}
