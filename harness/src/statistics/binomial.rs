//! Exact bounds of a proportion: how often frames can miss at most, given how often they did.

/// Upper end of the one-sided Clopper-Pearson interval: the largest miss rate under which `misses` or fewer in `n`
/// trials still have probability `1 - confidence`. 1 where nothing was tried. (Clopper and Pearson 1934.)
pub fn upper_bound(misses: u64, n: u64, confidence: f64) -> f64 {
    if misses >= n {
        return 1.0;
    }
    bisect(|rate| at_most(misses, n, rate) > 1.0 - confidence)
}

/// Lower end of the one-sided interval: 0 where there was no miss.
pub fn lower_bound(misses: u64, n: u64, confidence: f64) -> f64 {
    if misses == 0 {
        return 0.0;
    }
    bisect(|rate| 1.0 - at_most(misses - 1, n, rate) < 1.0 - confidence)
}

/// The rate in [0, 1] at which `below` turns false; 60 halvings exhaust an f64.
fn bisect(below: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if below(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// P(X <= k) for X binomial (n, p), summed in logarithms so that large n do not underflow. O(k).
fn at_most(k: u64, n: u64, p: f64) -> f64 {
    if p <= 0.0 {
        return 1.0;
    }
    if p >= 1.0 {
        return if k >= n { 1.0 } else { 0.0 };
    }
    let odds = (p / (1.0 - p)).ln();
    let mut log_term = n as f64 * (-p).ln_1p();
    let mut sum = log_term.exp();
    for i in 1..=k.min(n) {
        log_term += ((n - i + 1) as f64 / i as f64).ln() + odds;
        sum += log_term.exp();
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    }

    /// No miss in n: 1 - 0.05^(1/n), about 3 / n.
    #[test]
    fn rule_of_three() {
        close(upper_bound(0, 300, 0.95), 1.0 - 0.05f64.powf(1.0 / 300.0));
        assert!(upper_bound(0, 299, 0.95) < 0.01 && upper_bound(0, 298, 0.95) > 0.01);
        close(upper_bound(0, 0, 0.95), 1.0);
        close(lower_bound(0, 50, 0.95), 0.0);
    }

    /// Tabulated: 5 of 100, two-sided 90% interval 1.991% to 10.225%.
    #[test]
    fn tabulated_interval() {
        assert!((lower_bound(5, 100, 0.95) - 0.01991).abs() < 2e-5);
        assert!((upper_bound(5, 100, 0.95) - 0.10225).abs() < 2e-5);
    }

    #[test]
    fn all_missed_and_many_trials() {
        close(upper_bound(10, 10, 0.95), 1.0);
        close(lower_bound(10, 10, 0.95), 0.05f64.powf(0.1));
        let many = upper_bound(1000, 100_000, 0.95);
        assert!((0.0104..0.0107).contains(&many), "{many}");
    }
}
