//! A confidence interval of the median that assumes nothing about the distribution.

/// Confidence of the intervals in results.
pub const CONFIDENCE: f64 = 0.95;

/// The interval [x_(r), x_(n+1-r)] of order statistics with the largest r that covers the median with probability of at
/// least `confidence`; the coverage is exactly 1 - 2 P(B < r), B binomial (n, 1/2), whatever the samples are distributed as
/// (David and Nagaraja, Order Statistics, section 7.1). `None` where even the extremes do not cover it: below 6 samples
/// at 95%. Samples must be sorted; independent ones are assumed, so slow drift within a run is not in it. O(n).
pub fn median_interval(sorted: &[u64], confidence: f64) -> Option<(u64, u64)> {
    let r = largest_rank(sorted.len(), 0.5 * (1.0 - confidence))?;
    Some((sorted[r - 1], sorted[sorted.len() - r]))
}

/// The largest r >= 1 with P(B < r) <= `tail`. Terms in logarithms: 2^-n underflows from n = 1075 on.
fn largest_rank(n: usize, tail: f64) -> Option<usize> {
    let mut log_term = -(n as f64) * std::f64::consts::LN_2;
    let mut below = 0.0;
    for r in 1..=n / 2 + 1 {
        below += log_term.exp(); // P(B = r - 1)
        if below > tail {
            return (r > 1).then(|| r - 1);
        }
        log_term += ((n - r + 1) as f64 / r as f64).ln();
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tabulated ranks of 95% intervals (Conover, Practical Nonparametric Statistics, table A3).
    #[test]
    fn tabulated_ranks() {
        for (n, r) in [
            (5, None),
            (6, Some(1)),
            (8, Some(1)),
            (9, Some(2)),
            (15, Some(4)),
            (20, Some(6)),
            (100, Some(40)),
        ] {
            assert_eq!(largest_rank(n, 0.025), r, "n = {n}");
        }
    }

    /// Large n: the normal approximation n / 2 - 0.98 sqrt(n).
    #[test]
    fn many_samples() {
        let sorted: Vec<u64> = (0..10_000).collect();
        let (low, high) = median_interval(&sorted, CONFIDENCE).unwrap();
        assert!((4899..=4903).contains(&low) && (5096..=5100).contains(&high), "{low} {high}");
        assert_eq!(median_interval(&[], CONFIDENCE), None);
    }

    /// 1,000 samples of 25 from a skewed distribution: the true median is outside in at most 5%, give or take.
    #[test]
    fn covers_the_median_as_often_as_it_says() {
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1u64 << 31) as f64
        };
        let outside = (0..1000)
            .filter(|_| {
                let mut samples: Vec<u64> = (0..25).map(|_| (1e6 * random().powi(4)) as u64).collect();
                samples.sort_unstable();
                let (low, high) = median_interval(&samples, CONFIDENCE).unwrap();
                !(low..=high).contains(&62_500) // 1e6 / 2^4
            })
            .count();
        assert!((15..65).contains(&outside), "{outside} of 1000"); // exact coverage at n = 25: 95.67%
    }
}
