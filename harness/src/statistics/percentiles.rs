//! Percentiles, given only where there are enough samples for them.

use super::median_interval::{self, median_interval};

/// Percentiles of a set of samples, each a sample that really occurred (nearest rank); `None` where there are too few.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Percentiles {
    /// Smallest.
    pub min: Option<u64>,
    /// Median.
    pub p50: Option<u64>,
    /// Its distribution-free 95% interval, from 6 samples on.
    pub p50_interval: Option<(u64, u64)>,
    /// From [`SAMPLES_FOR_P95`] samples on.
    pub p95: Option<u64>,
    /// From [`SAMPLES_FOR_P99`] samples on.
    pub p99: Option<u64>,
    /// From [`SAMPLES_FOR_P999`] samples on.
    pub p999: Option<u64>,
    /// Largest.
    pub max: Option<u64>,
}

/// Ten samples lie beyond a percentile before it is given: with fewer it is mostly the largest one or two.
pub const SAMPLES_FOR_P95: usize = 200;
/// As [`SAMPLES_FOR_P95`].
pub const SAMPLES_FOR_P99: usize = 1_000;
/// As [`SAMPLES_FOR_P95`].
pub const SAMPLES_FOR_P999: usize = 10_000;

impl Percentiles {
    /// Percentiles of `samples`, in any order. O(n log n).
    pub fn of(samples: &[u64]) -> Self {
        let mut sorted = samples.to_vec();
        sorted.sort_unstable();
        let from = |least: usize, share: f64| {
            (sorted.len() >= least).then(|| nearest_rank(&sorted, share)).flatten()
        };
        Self {
            min: sorted.first().copied(),
            p50: median(&sorted),
            p50_interval: median_interval(&sorted, median_interval::CONFIDENCE),
            p95: from(SAMPLES_FOR_P95, 0.95),
            p99: from(SAMPLES_FOR_P99, 0.99),
            p999: from(SAMPLES_FOR_P999, 0.999),
            max: sorted.last().copied(),
        }
    }
}

/// The smallest sample that at least `share` of all samples do not exceed.
fn nearest_rank(sorted: &[u64], share: f64) -> Option<u64> {
    let rank = (share * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).copied()
}

/// The middle sample, or the mean of the two middle ones, rounded down.
pub fn median(sorted: &[u64]) -> Option<u64> {
    let high = *sorted.get(sorted.len() / 2)?;
    if sorted.len() % 2 == 1 {
        return Some(high);
    }
    Some(sorted[sorted.len() / 2 - 1].midpoint(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_one_to_a_thousand() {
        let samples: Vec<u64> = (1..=1000).rev().collect();
        let all = Percentiles::of(&samples);
        assert_eq!((all.min, all.p50, all.p95, all.p99), (Some(1), Some(500), Some(950), Some(990)));
        assert_eq!((all.p999, all.max), (None, Some(1000)));
    }

    #[test]
    fn too_few_samples_give_none() {
        assert_eq!(Percentiles::of(&[]), Percentiles::default());
        let few = Percentiles::of(&[7; 199]);
        assert_eq!((few.p50, few.p95), (Some(7), None));
        assert_eq!(Percentiles::of(&[7; 200]).p95, Some(7));
        assert_eq!(Percentiles::of(&[3; 9_999]).p999, None);
        assert_eq!(Percentiles::of(&[3; 10_000]).p999, Some(3));
    }

    #[test]
    fn medians_of_even_and_huge_samples() {
        assert_eq!(median(&[1, 4]), Some(2));
        assert_eq!(median(&[u64::MAX - 2, u64::MAX]), Some(u64::MAX - 1));
    }
}
