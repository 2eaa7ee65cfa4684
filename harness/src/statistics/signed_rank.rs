//! The exact null distribution of Wilcoxon's signed-rank statistic (Wilcoxon 1945).

/// P(W+ <= w) for w = 0, 1, .., n (n + 1) / 2, where W+ is the sum of a random subset of the ranks 1 .. n: each
/// difference is as likely positive as negative. O(n^3).
pub fn cumulative(n: usize) -> Vec<f64> {
    let mut mass = vec![0.0; n * (n + 1) / 2 + 1];
    mass[0] = 1.0;
    for rank in 1..=n {
        // Rank `rank` is in the subset or not: halve, and add the shifted half. Downwards, so that it is added once.
        for w in (0..mass.len()).rev() {
            let without = mass[w];
            let with = if w >= rank { mass[w - rank] } else { 0.0 };
            mass[w] = 0.5 * (without + with);
        }
    }
    let mut sum = 0.0;
    mass.iter()
        .map(|p| {
            sum += p;
            sum
        })
        .collect()
}

/// How many of the sorted Walsh averages lie outside an interval for the centre, on each side: the largest k with
/// P(W+ <= k) <= `alpha`, where alpha is the error allowed on **one** side. `None` where n differences are too few for
/// any statement at this level (2^-n > alpha).
pub fn outside(n: usize, alpha: f64) -> Option<usize> {
    cumulative(n).iter().take_while(|&&p| p <= alpha).count().checked_sub(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// n = 3: the subsets of {1, 2, 3} have sums 0, 1, 2, 3, 3, 4, 5, 6.
    #[test]
    fn three_by_hand() {
        assert_eq!(cumulative(3), [1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 8.0].map(|c| c / 8.0));
        assert_eq!(cumulative(0), [1.0]);
    }

    /// Tabulated one-sided critical values (Hollander and Wolfe, table A.4): n = 10: P(W+ <= 8) = 0.024, P(W+ <= 10) =
    /// 0.042; n = 15: P(W+ <= 25) = 0.024, P(W+ <= 30) = 0.047.
    #[test]
    fn tabulated_values() {
        let close = |n: usize, w: usize, p: f64| assert!((cumulative(n)[w] - p).abs() < 6e-4, "{n} {w}");
        close(10, 8, 0.024);
        close(10, 10, 0.042);
        close(15, 25, 0.024);
        close(15, 30, 0.047);
        assert_eq!(outside(10, 0.025), Some(8));
    }

    /// Ten differences are the fewest that can say anything at 0.001.
    #[test]
    fn too_few_say_nothing() {
        assert_eq!((outside(9, 0.001), outside(10, 0.001)), (None, Some(0)));
        assert_eq!(outside(0, 0.5), None);
    }

    #[test]
    fn all_mass_is_there() {
        assert!((cumulative(64).last().unwrap() - 1.0).abs() < 1e-12);
    }
}
