//! The Hodges-Lehmann estimate of the centre of paired differences, and its exact interval (Hodges and Lehmann 1963).
//!
//! As efficient as 95% of the mean where noise is normal, and unharmed by outliers on less than 29% of the differences.

use super::signed_rank;

/// An estimate and the interval around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The estimate.
    pub estimate: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    /// The same estimate, both ends `factor` times as far away from it.
    pub fn widened(self, factor: f64) -> Self {
        let end = |x: f64| self.estimate + factor * (x - self.estimate);
        Self { low: end(self.low), high: end(self.high), ..self }
    }

    /// Half of its width.
    pub fn half_width(&self) -> f64 {
        0.5 * (self.high - self.low)
    }
}

/// The median of all averages (d_i + d_j) / 2, i <= j; `None` without differences. O(n^2 log n).
pub fn estimate(differences: &[f64]) -> Option<f64> {
    middle(&walsh_averages(differences))
}

/// The estimate with the interval that inverts the exact signed-rank test at the one-sided level `alpha`: it misses the
/// centre of a symmetric distribution with probability at most `alpha` on each side, whatever that distribution is.
/// `None` where there are too few differences for that level. O(n^2 log n).
pub fn interval(differences: &[f64], alpha: f64) -> Option<Interval> {
    let outside = signed_rank::outside(differences.len(), alpha)?;
    let averages = walsh_averages(differences);
    let low = *averages.get(outside)?;
    let high = averages[averages.len() - 1 - outside];
    Some(Interval { estimate: middle(&averages)?, low, high })
}

/// All (d_i + d_j) / 2 with i <= j, ascending.
fn walsh_averages(differences: &[f64]) -> Vec<f64> {
    let pairs = differences.iter().enumerate();
    let mut averages: Vec<f64> =
        pairs.flat_map(|(i, a)| differences[i..].iter().map(move |b| 0.5 * (a + b))).collect();
    averages.sort_by(f64::total_cmp);
    averages
}

fn middle(sorted: &[f64]) -> Option<f64> {
    let high = *sorted.get(sorted.len() / 2)?;
    Some(if sorted.len() % 2 == 1 { high } else { 0.5 * (sorted[sorted.len() / 2 - 1] + high) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::random::Random;

    /// Averages of 1, 2, 6: 1, 1.5, 2, 3.5, 4, 6.
    #[test]
    fn three_by_hand() {
        assert_eq!(estimate(&[6.0, 1.0, 2.0]), Some(2.75));
        assert_eq!(interval(&[6.0, 1.0, 2.0], 0.13), Some(Interval { estimate: 2.75, low: 1.0, high: 6.0 }));
        assert_eq!(interval(&[6.0, 1.0, 2.0], 0.25), Some(Interval { estimate: 2.75, low: 1.5, high: 4.0 }));
        assert_eq!((interval(&[6.0, 1.0, 2.0], 0.1), estimate(&[])), (None, None));
    }

    #[test]
    fn a_quarter_of_outliers_moves_it_within_the_bulk_only() {
        let mut d: Vec<f64> = (0..12).map(|i| 0.01 * f64::from(i)).collect();
        let clean = estimate(&d).unwrap();
        d.iter_mut().rev().take(3).for_each(|x| *x = 1e9);
        let spoilt = estimate(&d).unwrap();
        assert!((spoilt - clean).abs() < 0.05, "{clean} {spoilt}");
    }

    /// The interval misses the centre as often as it says: 2 alpha = 0.02 +- 3 sigma in 5,000 draws of a skewless but heavy
    /// distribution (normal of normal width).
    #[test]
    fn covers_as_often_as_it_says() {
        let mut random = Random::new(3);
        let missed = (0..5_000)
            .filter(|_| {
                let d: Vec<f64> = (0..16).map(|_| random.normal() * random.normal()).collect();
                let i = interval(&d, 0.01).unwrap();
                i.low > 0.0 || i.high < 0.0
            })
            .count();
        assert!((60..=130).contains(&missed), "{missed} of 5000");
    }

    #[test]
    fn widening_keeps_the_estimate() {
        let i = Interval { estimate: 1.0, low: 0.5, high: 2.0 }.widened(2.0);
        assert_eq!((i.estimate, i.low, i.high, i.half_width()), (1.0, 0.0, 3.0, 1.5));
    }
}
