//! Estimates from samples with 95 % confidence intervals, in memory that does not grow with the number of samples: moments by
//! Welford's update, quantiles from bins of 0.4 % with their exact extremes.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Normal quantile of 97.5 %.
const Z: f64 = 1.959_963_984_540_054;

/// A share of a number of trials, with Wilson's score interval of 95 %.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Trials that count.
    pub count: u64,
    /// All trials.
    pub of: u64,
    /// `count / of`; 0 without trials.
    pub share: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// An estimate with an interval of 95 %.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Lower end of the interval; `None` where the samples are too few for one.
    pub low: Option<f64>,
    /// Upper end of the interval; `None` where the samples are too few for one.
    pub high: Option<f64>,
}

/// How a figure spreads over runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Runs that have the figure.
    pub count: u64,
    /// Mean, with Student's interval.
    pub mean: Estimate,
    /// Standard deviation; 0 for one run.
    pub std: f64,
    /// Value that half of the runs do not exceed, with the interval of order statistics.
    pub median: Estimate,
    /// Value that 95 % of the runs do not exceed, with the interval of order statistics.
    pub p95: Estimate,
    /// Largest value.
    pub worst: f64,
}

impl Share {
    /// Wilson, J. Am. Stat. Assoc. 22 (1927): the values of p whose test does not reject the count.
    #[must_use]
    pub fn new(count: u64, of: u64) -> Self {
        if of == 0 {
            return Self {
                count,
                of,
                share: 0.0,
                low: 0.0,
                high: 1.0,
            };
        }
        let (n, share) = (of as f64, count as f64 / of as f64);
        let shrink = 1.0 / (1.0 + Z * Z / n);
        let centre = shrink * (share + Z * Z / (2.0 * n));
        let half = shrink * Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        Self {
            count,
            of,
            share,
            // At 0 and n the interval ends there exactly; rounding must not move it.
            low: if count == 0 { 0.0 } else { centre - half },
            high: if count == of { 1.0 } else { centre + half },
        }
    }
}

/// A bin's number of values and the largest of them.
#[derive(Debug, Clone, Copy)]
struct Bin {
    count: u64,
    largest: f64,
}

/// Samples of one figure, gathered one by one.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    count: u64,
    mean: f64,
    /// Sum of squared deviations from the mean.
    squares: f64,
    bins: BTreeMap<i64, Bin>,
}

impl Samples {
    /// Takes a value in. What is not finite counts as no value: it has no place in a mean.
    pub(super) fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
        let bin = self.bins.entry(bin(value)).or_insert(Bin {
            count: 0,
            largest: value,
        });
        bin.count += 1;
        bin.largest = bin.largest.max(value);
    }

    /// The spread; `None` without values.
    pub(super) fn spread(&self) -> Option<Spread> {
        let worst = self.bins.values().last()?.largest;
        let n = self.count as f64;
        let variance = self.squares / (n - 1.0).max(1.0);
        let half = student(self.count - 1).map(|t| t * (variance / n).sqrt());
        Some(Spread {
            count: self.count,
            mean: Estimate {
                value: self.mean,
                low: half.map(|half| self.mean - half),
                high: half.map(|half| self.mean + half),
            },
            std: variance.sqrt(),
            median: self.quantile(0.5)?,
            p95: self.quantile(0.95)?,
            worst,
        })
    }

    /// A quantile, to 0.4 %: the largest value of the bin that holds its rank. The interval's ranks follow from the normal
    /// approximation of the binomial; where one lies outside the samples there is no end.
    fn quantile(&self, q: f64) -> Option<Estimate> {
        let n = self.count as f64;
        let half = Z * (n * q * (1.0 - q)).sqrt();
        let value = self.ranked((n * q).ceil().max(1.0))?;
        Some(Estimate {
            value,
            low: self.ranked((n * q - half).floor()),
            high: self.ranked((n * q + half).ceil() + 1.0),
        })
    }

    /// Value of a rank from 1 to the count.
    fn ranked(&self, rank: f64) -> Option<f64> {
        if !(1.0..=self.count as f64).contains(&rank) {
            return None;
        }
        let mut below = 0;
        for bin in self.bins.values() {
            below += bin.count;
            if below as f64 >= rank {
                return Some(bin.largest);
            }
        }
        None
    }
}

/// Number of a value's bin: sign, exponent and the 8 leading bits of the fraction, in the order of the values.
fn bin(value: f64) -> i64 {
    let bits = value.to_bits() as i64;
    let ordered = bits ^ (((bits >> 63) as u64) >> 1) as i64;
    ordered >> (52 - 8)
}

/// Student's quantile of 97.5 % for `degrees` of freedom: tables for 1 and 2, beyond by the expansion in powers of 1 / degrees
/// (Abramowitz and Stegun 26.7.5), whose error is 0.1 % for 3 and falls fast. `None` for 0.
fn student(degrees: u64) -> Option<f64> {
    match degrees {
        0 => None,
        1 => Some(12.706_204_736),
        2 => Some(4.302_652_730),
        _ => {
            let (z2, v) = (Z * Z, degrees as f64);
            let terms = [
                (z2 + 1.0) / 4.0,
                ((5.0 * z2 + 16.0) * z2 + 3.0) / 96.0,
                (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0,
                ((((79.0 * z2 + 776.0) * z2 + 1482.0) * z2 - 1920.0) * z2 - 945.0) / 92160.0,
            ];
            let sum = terms.iter().rev().fold(0.0, |sum, term| (sum + term) / v);
            Some(Z * (1.0 + sum))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_interval_of_a_published_example() {
        // 81 of 263 (Newcombe, Stat. Med. 17 (1998), table I, method 3): 0.2553 to 0.3662.
        let share = Share::new(81, 263);
        assert!((share.low - 0.2553).abs() < 5e-5, "{share:?}");
        assert!((share.high - 0.3662).abs() < 5e-5, "{share:?}");
        // The same table: 0 of 20 gives 0 to 0.1611, 1 of 29 gives 0.0061 to 0.1718.
        let none = Share::new(0, 20);
        assert_eq!(none.low, 0.0);
        assert!((none.high - 0.1611).abs() < 5e-5, "{none:?}");
        let one = Share::new(1, 29);
        assert!((one.low - 0.0061).abs() < 5e-5 && (one.high - 0.1718).abs() < 5e-5);
    }

    #[test]
    fn student_quantiles_of_the_tables() {
        for (degrees, expected, tolerance) in [
            (1, 12.706, 1e-3),
            (2, 4.303, 1e-3),
            // The expansion's own error.
            (3, 3.182, 5e-3),
            (4, 2.776, 1e-3),
            (9, 2.262, 5e-4),
            (30, 2.042, 5e-4),
            (1_000_000, 1.960, 5e-5),
        ] {
            let found = student(degrees).unwrap();
            assert!((found - expected).abs() < tolerance, "{degrees}: {found}");
        }
        assert_eq!(student(0), None);
    }

    #[test]
    fn moments_and_quantiles_by_hand() {
        let mut samples = Samples::default();
        for value in [5.0, 1.0, 4.0, 2.0, 3.0, f64::NAN, f64::INFINITY] {
            samples.add(value);
        }
        let spread = samples.spread().unwrap();
        assert_eq!((spread.count, spread.worst), (5, 5.0));
        assert!((spread.mean.value - 3.0).abs() < 1e-15);
        assert!((spread.std - 2.5_f64.sqrt()).abs() < 1e-15);
        // 2.776 * sqrt(2.5 / 5), from the table of Student's quantiles.
        assert!((spread.mean.high.unwrap() - (3.0 + 1.963)).abs() < 1e-3);
        assert_eq!(spread.median.value, 3.0);
        assert_eq!(spread.p95.value, 5.0);
        assert_eq!(spread.p95.high, None);
    }

    #[test]
    fn quantiles_of_many_values_are_within_the_bin_of_the_sorted_ones() {
        let mut samples = Samples::default();
        let mut values: Vec<f64> = (0..20_000)
            .map(|i| 1e-3 * f64::from(i * 7919 % 20_000).powi(2) - 5.0)
            .collect();
        for value in &values {
            samples.add(*value);
        }
        values.sort_by(f64::total_cmp);
        let spread = samples.spread().unwrap();
        for (found, rank) in [(spread.median, 10_000), (spread.p95, 19_000)] {
            let exact = values[rank - 1];
            assert!((found.value - exact).abs() <= exact / 256.0);
            assert!(found.low.unwrap() < exact && exact < found.high.unwrap());
        }
        assert_eq!(spread.worst, values[19_999]);
        assert!(samples.bins.len() < 5000, "{}", samples.bins.len());
    }

    #[test]
    fn bins_are_in_the_order_of_the_values() {
        let values = [-1e9, -2.0, -1.0, -1e-300, 0.0, 1e-300, 1.0, 2.0, 1e9];
        assert!(values.windows(2).all(|pair| bin(pair[0]) < bin(pair[1])));
    }
}
