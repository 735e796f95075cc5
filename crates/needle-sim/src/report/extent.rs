//! The box that a scene shows.

/// Least side of the box as a fraction of its longest: a straight path needs room beside it.
const LEAST_SIDE: f64 = 0.35;

/// Free space around the points, as a fraction of a side.
const MARGIN: f64 = 0.06;

/// Drawn length of the longest side; the camera's distance is in the same unit.
const LONGEST_DRAWN: f64 = 1.55;

/// A box around points, never flat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    middle: [f64; 3],
    side: [f64; 3],
}

impl Extent {
    /// Around the points that are finite; a box of 1 mm around the origin where there is none.
    pub(super) fn of(points: impl Iterator<Item = [f64; 3]>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in points.filter(|point| point.iter().all(|x| x.is_finite())) {
            for i in 0..3 {
                low[i] = low[i].min(point[i]);
                high[i] = high[i].max(point[i]);
            }
        }
        let mut extent = Self {
            middle: [0.0; 3],
            side: [1.0; 3],
        };
        if low[0] > high[0] {
            return extent;
        }
        let longest = (0..3).map(|i| high[i] - low[i]).fold(0.0, f64::max);
        let longest = if longest > 0.0 { longest } else { 1.0 };
        for i in 0..3 {
            extent.middle[i] = 0.5 * low[i] + 0.5 * high[i];
            extent.side[i] = (high[i] - low[i]).max(LEAST_SIDE * longest) * (1.0 + 2.0 * MARGIN);
        }
        extent
    }

    /// Lower and upper end of an axis.
    pub(super) fn range(&self, axis: usize) -> [f64; 2] {
        let half = 0.5 * self.side[axis];
        [self.middle[axis] - half, self.middle[axis] + half]
    }

    /// Lengths at which plotly draws the axes, in its own unit: the same scale on all three.
    pub(super) fn aspect_ratio(&self) -> (f64, f64, f64) {
        let [x, y, z] = self
            .side
            .map(|side| LONGEST_DRAWN * side / self.largest_span());
        (x, y, z)
    }

    /// The longest side.
    pub(super) fn largest_span(&self) -> f64 {
        self.side.into_iter().fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finite_point_is_inside_and_no_side_is_flat() {
        let points = [[0.0, 0.0, 0.0], [f64::NAN, 9.0, 9.0], [0.0, -2.0, 100.0]];
        let extent = Extent::of(points.into_iter());
        for axis in 0..3 {
            let [low, high] = extent.range(axis);
            assert!(low <= points[0][axis].min(points[2][axis]));
            assert!(high >= points[0][axis].max(points[2][axis]));
            assert!(high - low >= LEAST_SIDE * 100.0);
        }
        let [low, high] = extent.range(2);
        // Rounding of 1 + 2 * 0.06.
        assert!((low + 6.0).abs() < 1e-12 && (high - 106.0).abs() < 1e-12);
        let (x, _, z) = extent.aspect_ratio();
        // 35 mm against 100 mm.
        assert!((x / z - 0.35).abs() < 1e-12);
    }

    #[test]
    fn no_points_and_one_point_make_a_box() {
        assert_eq!(Extent::of(std::iter::empty()).largest_span(), 1.0);
        let one = Extent::of(std::iter::once([5.0; 3]));
        assert!(one.largest_span() > 0.0);
        assert_eq!(one.range(0)[0] + one.range(0)[1], 10.0);
    }
}
