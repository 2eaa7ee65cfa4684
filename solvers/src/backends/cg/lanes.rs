//! Columns in and out of rows of W lanes.

use crate::columns::Columns;

/// Up to W neighbouring columns of a wider block, each with a power of two that brings its right-hand side to unit size.
///
/// The scaling is exact and keeps squares of norms, and preconditioners in f32, far from overflow and underflow. Lanes
/// beyond the last column read 0 and are never written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window<const W: usize> {
    first: usize,
    count: usize,
    /// 2^-e per lane, with 2^e <= max |b| < 2^(e+1); 0 where b = 0.
    scale: [f64; W],
}

impl<const W: usize> Window<W> {
    /// Columns `first .. first + W` of `rhs`, as far as there are any. `Err` holds the first row that is not finite.
    pub(crate) fn new(rhs: Columns<&[f64]>, first: usize) -> Result<Self, usize> {
        let count = W.min(rhs.k() - first);
        let mut window = Self { first, count, scale: [1.0; W] };
        let mut largest = [0.0f64; W];
        for i in 0..rhs.n() {
            let row = window.read(rhs, i);
            if row.iter().any(|b| !b.is_finite()) {
                return Err(i);
            }
            for c in 0..W {
                largest[c] = largest[c].max(row[c].abs());
            }
        }
        window.scale = largest.map(inverse_power_of_two);
        Ok(window)
    }

    /// True where lane `c` has a right-hand side other than zero.
    pub(crate) fn is_used(&self, c: usize) -> bool {
        self.scale[c] != 0.0
    }

    /// Row `i` of the window, scaled.
    #[inline(always)]
    pub(crate) fn read(&self, block: Columns<&[f64]>, i: usize) -> [f64; W] {
        let row = &block.row(i)[self.first..self.first + self.count];
        let mut lanes = [0.0; W];
        for (c, &value) in row.iter().enumerate() {
            lanes[c] = value * self.scale[c];
        }
        lanes
    }

    /// Writes `value(c)`, unscaled, to the columns `c` of row `i` that `mask` names.
    #[inline]
    pub(crate) fn write(
        &self,
        block: &mut Columns<&mut [f64]>,
        i: usize,
        mask: &[bool; W],
        value: &[f64; W],
    ) {
        let row = &mut block.row_mut(i)[self.first..self.first + self.count];
        for (c, slot) in row.iter_mut().enumerate() {
            if mask[c] {
                *slot = if self.is_used(c) { value[c] / self.scale[c] } else { 0.0 };
            }
        }
    }
}

/// 2^-e for 2^e <= x < 2^(e+1), within the range whose inverse is also normal; 0 for 0.
fn inverse_power_of_two(x: f64) -> f64 {
    if x == 0.0 {
        return 0.0;
    }
    let biased = (x.to_bits() >> 52).clamp(1, 2045); // the exponent field; subnormals count as the smallest normal
    f64::from_bits((2046 - biased) << 52)
}

/// Width of the lanes that serve k columns with the least waste: 1, 4 or 8.
pub(crate) fn width(k: usize) -> usize {
    match k {
        1 => 1,
        2..=4 => 4,
        _ => 8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_is_an_exact_inverse_power_of_two() {
        for (x, expected) in [(1.0, 1.0), (3.0, 0.5), (0.75, 2.0), (0.0, 0.0), (1e300, 2f64.powi(-996))] {
            assert_eq!(inverse_power_of_two(x), expected, "{x}");
        }
        for x in [f64::MIN_POSITIVE / 8.0, f64::MAX] {
            let scale = inverse_power_of_two(x);
            assert!(scale.is_normal() && (1.0 / scale).is_normal(), "{x}: {scale}");
        }
    }

    #[test]
    fn reads_and_writes_only_its_columns() {
        let b: Vec<f64> = (1..=10).map(f64::from).collect();
        let rhs = Columns::new(&b[..], 2, 5);
        let window = Window::<4>::new(rhs, 4).expect("finite");
        assert_eq!((window.count, window.read(rhs, 1)), (1, [1.25, 0.0, 0.0, 0.0])); // 10 / 2^3
        let mut x = vec![7.0; 10];
        window.write(&mut Columns::new(&mut x[..], 2, 5), 0, &[true; 4], &[0.5; 4]);
        assert_eq!(x, [7.0, 7.0, 7.0, 7.0, 4.0, 7.0, 7.0, 7.0, 7.0, 7.0]);
    }
}
