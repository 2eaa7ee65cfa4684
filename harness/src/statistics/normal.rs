//! The standard normal distribution.

/// P(Z > z).
pub fn upper_tail(z: f64) -> f64 {
    0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2)
}

/// The z that Z exceeds with probability `tail`, which lies in (0, 1). 60 halvings of [-40, 40] exhaust an f64.
pub fn upper_quantile(tail: f64) -> f64 {
    let (mut low, mut high) = (-40.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if upper_tail(middle) > tail { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tabulated_quantiles() {
        for (tail, z) in
            [(0.5, 0.0), (0.1, 1.281552), (0.025, 1.959964), (0.001, 3.090232), (0.975, -1.959964)]
        {
            assert!((upper_quantile(tail) - z).abs() < 1e-6, "{tail}");
        }
    }
}
