//! Coordinates brought to where products of four of them neither overflow nor underflow.

use std::borrow::Cow;

/// The same points, scaled by a power of two where products of four coordinates would leave the range of f64. Ratios,
/// comparisons of distances and rounding errors stay the same to the last bit.
pub fn within_range(points: &[[f64; 3]]) -> Cow<'_, [[f64; 3]]> {
    match exponent(points) {
        0 => Cow::Borrowed(points),
        exponent => Cow::Owned(points.iter().map(|p| p.map(|x| times_power_of_two(x, exponent))).collect()),
    }
}

/// x 2^exponent for exponents up to +-2000, in two steps because 2^exponent alone may not be a number.
pub fn times_power_of_two(x: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    x * 2f64.powi(half) * 2f64.powi(exponent - half)
}

/// The exponent that [`within_range`] scales by; 0 for all usual coordinates.
pub fn exponent(points: &[[f64; 3]]) -> i32 {
    let largest = points.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if largest == 0.0 || (1e-60..1e60).contains(&largest) { 0 } else { -(largest.log2().floor() as i32) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_points_are_borrowed_and_extreme_ones_scaled_exactly() {
        assert!(matches!(within_range(&[[1.0, -3.0, 0.0]]), Cow::Borrowed(_)));
        assert!(matches!(within_range(&[[0.0; 3]]), Cow::Borrowed(_)));
        for exponent in [-1070, -700, 700, 1023] {
            let s = times_power_of_two(1.0, exponent);
            assert_eq!(within_range(&[[s, -s, 0.0]]).as_ref(), [[1.0, -1.0, 0.0]]);
        }
    }
}
