//! Dependence of neighbours in a series.

/// Sample autocorrelation at lag 1: sum (d_i - m)(d_i+1 - m) / sum (d_i - m)^2. 0 where there are fewer than three values
/// or they are all the same. O(n).
pub fn lag1(series: &[f64]) -> f64 {
    if series.len() < 3 {
        return 0.0;
    }
    let mean = series.iter().sum::<f64>() / series.len() as f64;
    let total: f64 = series.iter().map(|d| (d - mean).powi(2)).sum();
    let shared: f64 = series.windows(2).map(|pair| (pair[0] - mean) * (pair[1] - mean)).sum();
    if total > 0.0 { shared / total } else { 0.0 }
}

/// By how much an interval for the centre must be wider than for independent values, where neighbours correlate with `r`
/// and that fades like a geometric series (AR(1)): sqrt((1 + r) / (1 - r)).
pub fn widening(r: f64) -> f64 {
    /// Beyond this the estimate of r itself says nothing; the factor is then 4.4.
    const LARGEST: f64 = 0.9;
    let r = r.clamp(0.0, LARGEST);
    ((1.0 + r) / (1.0 - r)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::random::Random;

    #[test]
    fn alternating_and_constant_series() {
        assert_eq!(lag1(&[1.0, -1.0, 1.0, -1.0]), -0.75);
        assert_eq!((lag1(&[2.0; 9]), lag1(&[1.0, 2.0])), (0.0, 0.0));
        assert_eq!((widening(-0.5), widening(0.6)), (1.0, 2.0));
    }

    #[test]
    fn finds_the_coefficient_of_an_autoregressive_series() {
        let mut random = Random::new(5);
        let mut x = 0.0;
        let series: Vec<f64> = (0..20_000)
            .map(|_| {
                x = 0.6 * x + random.normal();
                x
            })
            .collect();
        assert!((lag1(&series) - 0.6).abs() < 0.02);
    }
}
