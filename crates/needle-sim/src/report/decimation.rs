//! Fewer points for a picture: files stay small and browsers quick, whatever the number of samples.
//!
//! Lines over time keep the first, least, largest and last value of each stretch (M4 aggregation, Jugel et al., VLDB 2014), so no
//! peak is lost. Curves in space keep evenly spaced points: a needle has no peaks.

/// Indices of at most `4 * stretches + 1` values, in order, with every extreme among them. Values that are not finite are kept only
/// where they stand first or last in a stretch.
pub(super) fn keeping_extremes(values: &[f64], stretches: usize) -> Vec<usize> {
    if values.len() <= 4 * stretches {
        return (0..values.len()).collect();
    }
    let length = values.len().div_ceil(stretches.max(1));
    let mut kept = Vec::with_capacity(4 * stretches + 1);
    for start in (0..values.len()).step_by(length) {
        let end = (start + length).min(values.len());
        let finite = || (start..end).filter(|&i| values[i].is_finite());
        let by_value = |&i: &usize, &j: &usize| values[i].total_cmp(&values[j]);
        let mut stretch = vec![start, end - 1];
        stretch.extend(finite().min_by(by_value));
        stretch.extend(finite().max_by(by_value));
        stretch.sort_unstable();
        stretch.dedup();
        kept.extend(stretch);
    }
    kept
}

/// Indices of at most `most` of `count` items, evenly spaced, the first and the last among them.
pub(super) fn evenly(count: usize, most: usize) -> Vec<usize> {
    if count <= most || most < 2 {
        return (0..count.min(most.max(1))).collect();
    }
    (0..most).map(|i| i * (count - 1) / (most - 1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn short_series_are_kept_whole() {
        assert_eq!(keeping_extremes(&[1.0, 2.0, 0.0], 1), [0, 1, 2]);
        assert_eq!(keeping_extremes(&[], 5), [0usize; 0]);
        assert_eq!(evenly(3, 5), [0, 1, 2]);
    }

    #[test]
    fn evenly_keeps_both_ends() {
        assert_eq!(evenly(11, 3), [0, 5, 10]);
        assert_eq!(evenly(100_000, 2), [0, 99_999]);
        assert_eq!(evenly(5, 1), [0]);
        assert_eq!(evenly(0, 4), [0usize; 0]);
    }

    proptest! {
        #[test]
        fn no_extreme_is_lost_and_the_size_is_bounded(
            values in prop::collection::vec(prop_oneof![9 => -1e3f64..1e3, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)], 1..400),
            stretches in 1usize..20,
        ) {
            let kept = keeping_extremes(&values, stretches);
            prop_assert!(kept.len() <= 4 * stretches);
            prop_assert!(kept.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert_eq!((kept[0], kept[kept.len() - 1]), (0, values.len() - 1));
            let finite = |indices: &mut dyn Iterator<Item = usize>| {
                indices.map(|i| values[i]).filter(|x| x.is_finite()).fold(
                    (f64::INFINITY, f64::NEG_INFINITY),
                    |(low, high), x| (low.min(x), high.max(x)),
                )
            };
            let all = finite(&mut (0..values.len()));
            prop_assert_eq!(finite(&mut kept.iter().copied()), all);
        }
    }
}
