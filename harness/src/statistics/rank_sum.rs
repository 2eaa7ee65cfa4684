//! The ratio of two independent sets of times, with a distribution-free interval.

/// An estimate with the ends of its interval.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Ratio {
    /// Median of all ratios of a time of the second set to one of the first.
    pub estimate: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// How much slower `head` is than `base`: the Hodges-Lehmann estimate over all pairs, and the interval from inverting the
/// Wilcoxon rank-sum test, exact for any continuous distribution of independent times that differ by a factor (Hodges and
/// Lehmann, Ann. Math. Statist. 34, 1963; Lehmann, *Nonparametrics*, 1975, section 2.4). Null where a set is too small for
/// the confidence, or holds a time that is not above 0. O(m n log(m n)) for m and n times.
pub fn ratio(base: &[f64], head: &[f64], confidence: f64) -> Option<Ratio> {
    if base.iter().chain(head).any(|&t| !(t > 0.0 && t.is_finite())) {
        return None;
    }
    let outside = quantile(base.len(), head.len(), 0.5 * (1.0 - confidence))?;
    let mut ratios: Vec<f64> = base.iter().flat_map(|b| head.iter().map(move |h| h / b)).collect();
    ratios.sort_by(f64::total_cmp);
    let (low, high) = (ratios[outside], ratios[ratios.len() - 1 - outside]);
    let middle = ratios.len() / 2;
    let below = if ratios.len() % 2 == 1 { ratios[middle] } else { ratios[middle - 1] };
    Some(Ratio { estimate: (below * ratios[middle]).sqrt(), low, high })
}

/// How many ratios may lie below the interval: the largest c with P(U <= c) <= `tail` for the Mann-Whitney U of m and n
/// values. None where even c = 0 exceeds it.
fn quantile(m: usize, n: usize, tail: f64) -> Option<usize> {
    if m == 0 || n == 0 {
        return None;
    }
    let probabilities = distribution(m, n);
    let mut sum = 0.0;
    let mut last = None;
    for (u, p) in probabilities.iter().enumerate() {
        sum += p;
        if sum > tail {
            break;
        }
        last = Some(u);
    }
    last
}

/// P(U = u) for u = 0 .. m n: the number of ways to choose m of m + n ranks with that sum, by the recurrence of Mann and
/// Whitney (1947) on probabilities, p_{m,n}(u) = m/(m+n) p_{m-1,n}(u-n) + n/(m+n) p_{m,n-1}(u). O(m^2 n^2).
fn distribution(m: usize, n: usize) -> Vec<f64> {
    let mut rows: Vec<Vec<f64>> = vec![vec![1.0]; n + 1]; // no value of the first set
    for i in 1..=m {
        let mut next: Vec<Vec<f64>> = vec![vec![1.0]]; // no value of the second set
        for j in 1..=n {
            let mut p = vec![0.0; i * j + 1];
            let (first, second) = (i as f64 / (i + j) as f64, j as f64 / (i + j) as f64);
            for (u, q) in rows[j].iter().enumerate() {
                p[u + j] += first * q;
            }
            for (u, q) in next[j - 1].iter().enumerate() {
                p[u] += second * q;
            }
            next.push(p);
        }
        rows = next;
    }
    rows.swap_remove(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::random::Random;

    /// U of 2 and 2 values: 0, 1, 2, 2, 3, 4 of six orders.
    #[test]
    fn small_distributions_by_hand() {
        let sixths: Vec<f64> = distribution(2, 2).iter().map(|p| p * 6.0).collect();
        assert!(
            sixths.iter().zip([1.0, 1.0, 2.0, 1.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12),
            "{sixths:?}"
        );
        assert!((distribution(7, 10).iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    /// Tabulated critical values of U, two-sided 5%: 2 for 5 and 5, 23 for 10 and 10, 8 for 6 and 9 ... of `U <= c`.
    #[test]
    fn tabulated_critical_values() {
        let critical = |m, n| quantile(m, n, 0.025);
        assert_eq!([critical(5, 5), critical(10, 10), critical(4, 4)], [Some(2), Some(23), Some(0)]);
        assert_eq!((critical(3, 3), critical(0, 9)), (None, None));
    }

    #[test]
    fn a_known_factor_is_found() {
        let base = [1.0, 1.1, 0.9, 1.05, 0.95, 1.02];
        let head = base.map(|t| 2.0 * t);
        let ratio = ratio(&base, &head, 0.95).unwrap();
        assert!((ratio.estimate - 2.0).abs() < 0.05 && ratio.low < 2.0 && ratio.high > 2.0, "{ratio:?}");
        assert!(ratio.low > 1.5 && ratio.high < 2.5, "{ratio:?}");
    }

    #[test]
    fn times_that_are_none_give_none() {
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(ratio(&[1.0, 1.1, 1.2, 1.3, wrong], &[1.0; 5], 0.95), None);
        }
    }

    /// 95% intervals hold the truth in about 95% of the cases, for a skewed distribution.
    #[test]
    fn the_interval_covers() {
        let mut random = Random::new(7);
        let mut time =
            || 1.0 - 0.3 * ((random.next_u64() >> 11) as f64 / (1u64 << 53) as f64).max(1e-12).ln();
        let covered = (0..2000)
            .filter(|_| {
                let base: Vec<f64> = (0..8).map(|_| time()).collect();
                let head: Vec<f64> = (0..8).map(|_| 1.3 * time()).collect();
                ratio(&base, &head, 0.95).is_some_and(|r| r.low <= 1.3 && 1.3 <= r.high)
            })
            .count();
        assert!((1880..=1960).contains(&covered), "{covered} of 2000");
    }
}
