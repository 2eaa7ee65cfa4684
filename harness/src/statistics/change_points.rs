//! Change points of a series: where its distribution changes, by energy statistics and permutation tests.
//!
//! E-divisive (Matteson and James, "A nonparametric approach for multiple change point analysis", JASA 109, 2014), by binary
//! segmentation: the split of a segment with the largest energy distance between both sides is kept if few random orders of
//! the segment have one as large; then both sides are searched. Nothing is assumed of the distribution.

use crate::statistics::random::Random;
use serde::Serialize;

/// A change between two neighbours of a series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ChangePoint {
    /// First place after the change.
    pub at: usize,
    /// Median of the segment after it over that of the segment before it.
    pub ratio: f64,
    /// Share of random orders with a split at least as good.
    pub p: f64,
}

/// Values on each side of a split, at least: one odd run is an outlier, no change.
const LEAST: usize = 2;

/// Random orders per test: the smallest p is 1 / 1000.
const ORDERS: u32 = 999;

/// Changes of a series of positive values with p at most `significance`, ascending. About ten values are needed before any
/// can be significant at 1%. O(n^2) per test and order.
pub fn change_points(values: &[f64], significance: f64) -> Vec<ChangePoint> {
    let logs: Vec<f64> = values.iter().map(|v| v.max(f64::MIN_POSITIVE).ln()).collect();
    let mut random = Random::new(1);
    let mut found: Vec<(usize, f64)> = Vec::new();
    let whole = 0..logs.len();
    let mut segments = vec![whole];
    while let Some(segment) = segments.pop() {
        let part = &logs[segment.clone()];
        let Some((split, energy)) = best_split(part) else { continue };
        let mut shuffled = part.to_vec();
        let as_good = (0..ORDERS)
            .filter(|_| {
                random.shuffle(&mut shuffled);
                best_split(&shuffled).is_some_and(|(_, e)| e >= energy * (1.0 - 1e-12))
            })
            .count();
        let p = (as_good + 1) as f64 / f64::from(ORDERS + 1);
        if p <= significance {
            let at = segment.start + split;
            found.push((at, p));
            segments.extend([segment.start..at, at..segment.end]);
        }
    }
    found.sort_by_key(|f| f.0);
    let borders: Vec<usize> =
        std::iter::once(0).chain(found.iter().map(|f| f.0)).chain([values.len()]).collect();
    let middle = |range: std::ops::Range<usize>| {
        let mut part = logs[range].to_vec();
        part.sort_by(f64::total_cmp);
        part[part.len() / 2]
    };
    found
        .iter()
        .enumerate()
        .map(|(i, &(at, p))| {
            let ratio = (middle(at..borders[i + 2]) - middle(borders[i]..at)).exp();
            ChangePoint { at, ratio, p }
        })
        .collect()
}

/// The split with the largest energy statistic m n / (m + n) (2 E|X - Y| - E|X - X'| - E|Y - Y'|), and that. None where
/// there is no room for one or nothing varies. O(n^2): the sums of distances are carried from split to split.
fn best_split(values: &[f64]) -> Option<(usize, f64)> {
    let n = values.len();
    let distance = |i: usize, j: usize| (values[i] - values[j]).abs();
    // Sums of distances within the left part, within the right part, and between them.
    let (mut left, mut right, mut between) = (0.0, 0.0, 0.0);
    for i in 0..n {
        right += (i + 1..n).map(|j| distance(i, j)).sum::<f64>();
    }
    let mut best: Option<(usize, f64)> = None;
    for split in 1..n {
        let moved = split - 1;
        let to_left: f64 = (0..moved).map(|j| distance(moved, j)).sum();
        let to_right: f64 = (split..n).map(|j| distance(moved, j)).sum();
        left += to_left;
        right -= to_right;
        between += to_right - to_left;
        let (m, k) = (split as f64, (n - split) as f64);
        if split < LEAST || n - split < LEAST {
            continue;
        }
        let within = |sum: f64, count: f64| 2.0 * sum / (count * (count - 1.0));
        let energy = m * k / (m + k) * (2.0 * between / (m * k) - within(left, m) - within(right, k));
        if energy > 0.0 && best.is_none_or(|(_, e)| energy > e) {
            best = Some((split, energy));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(levels: &[(usize, f64)], seed: u64) -> Vec<f64> {
        let mut random = Random::new(seed);
        let mut noise = || 1.0 + 0.03 * ((random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 - 0.5);
        levels.iter().flat_map(|&(n, level)| vec![level; n]).map(|level| level * noise()).collect()
    }

    #[test]
    fn the_sums_are_right() {
        let values = [1.0, 4.0, 2.0, 8.0, 5.0];
        let (split, energy) = best_split(&values).unwrap();
        let mean = |a: &[f64], b: &[f64], pairs: f64| {
            a.iter().flat_map(|x| b.iter().map(move |y| (x - y).abs())).sum::<f64>() / pairs
        };
        let (x, y) = values.split_at(split);
        let (m, n) = (x.len() as f64, y.len() as f64);
        let direct = m * n / (m + n)
            * (2.0 * mean(x, y, m * n) - mean(x, x, m * (m - 1.0)) - mean(y, y, n * (n - 1.0)));
        assert!((direct - energy).abs() < 1e-12, "{direct} {energy}");
    }

    #[test]
    fn steps_are_found_where_they_are() {
        let found = change_points(&noisy(&[(12, 10.0), (9, 12.0), (15, 7.0)], 3), 0.01);
        assert_eq!(found.iter().map(|c| c.at).collect::<Vec<_>>(), [12, 21]);
        assert!(
            (found[0].ratio - 1.2).abs() < 0.03 && (found[1].ratio - 7.0 / 12.0).abs() < 0.03,
            "{found:?}"
        );
    }

    #[test]
    fn noise_alone_seldom_changes() {
        let alarms =
            (0..100).filter(|&seed| !change_points(&noisy(&[(25, 5.0)], seed), 0.01).is_empty()).count();
        assert!(alarms <= 5, "{alarms} of 100");
    }

    #[test]
    fn short_and_flat_series_say_nothing() {
        for values in [vec![], vec![1.0], vec![1.0, 2.0, 3.0], vec![3.0; 20], vec![1.0, 1.0, 9.0, 9.0]] {
            assert!(change_points(&values, 0.01).is_empty(), "{values:?}");
        }
    }
}
