//! Residuals that can be believed: b - A x accumulated in twice the working precision.
//!
//! A residual computed in plain f64 is mostly its own rounding error once a solution is good to a few eps. Sums are kept
//! as unevaluated pairs hi + lo (double-double), products are split without error (Dekker 1971, Veltkamp's splitting),
//! so that |error of r_i| is about eps^2 (|A||x| + |b|)_i.

use crate::columns::Columns;
use crate::sparse::SymmetricCsr;

/// hi + lo = a + b exactly (Knuth's TwoSum, 6 flops).
#[inline(always)]
pub(crate) fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let bb = sum - a;
    (sum, (a - (sum - bb)) + (b - bb))
}

/// hi + lo = a * b exactly, unless |a| or |b| exceeds 1e300 (Dekker's product, 17 flops). No fused multiply-add: without
/// that instruction the library's `fma` is a slow call.
#[inline(always)]
pub(crate) fn two_product(a: f64, b: f64) -> (f64, f64) {
    const SPLITTER: f64 = 134_217_729.0; // 2^27 + 1: halves of 26 bits each
    let split = |x: f64| {
        let t = SPLITTER * x;
        let high = t - (t - x);
        (high, x - high)
    };
    let product = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    (product, ((ah * bh - product) + ah * bl + al * bh) + al * bl)
}

/// Adds the product a * b to the pair (hi, lo).
#[inline]
fn accumulate(hi: &mut f64, lo: &mut f64, a: f64, b: f64) {
    let (product, rounding) = two_product(a, b);
    let (sum, carry) = two_sum(*hi, product);
    *hi = sum;
    *lo += carry + rounding;
}

/// r = b - A x, each entry rounded once from a double-double sum. All blocks are n x k; `r` is written.
///
/// Allocates one n x k block; about 50 flops per entry of A and column: a check, not a kernel.
pub fn compensated_residual(
    matrix: &SymmetricCsr,
    x: Columns<&[f64]>,
    b: Columns<&[f64]>,
    mut r: Columns<&mut [f64]>,
) {
    let k = x.k();
    let (x, hi) = (x.slice(), r.data_mut());
    hi.copy_from_slice(b.slice());
    let mut lo = vec![0.0; hi.len()];
    for i in 0..matrix.n() {
        let (columns, values) = matrix.row(i);
        for (&j, &a) in columns.iter().zip(values) {
            let j = j as usize;
            for c in 0..k {
                let (p, q) = (i * k + c, j * k + c);
                accumulate(&mut hi[p], &mut lo[p], -a, x[q]);
                if i != j {
                    accumulate(&mut hi[q], &mut lo[q], -a, x[p]);
                }
            }
        }
    }
    for (h, l) in hi.iter_mut().zip(&lo) {
        *h += l;
    }
}

/// How far a claimed solution is from solving its system, in three measures; each is the largest over the columns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// eta = ||b - A x|| / (||A|| ||x|| + ||b||), infinity norms: the normwise backward error (Rigal and Gaches 1967).
    /// A column with b = x = 0 counts as 0.
    pub backward_error: f64,
    /// omega = max_i |b - A x|_i / (|A||x| + |b|)_i: the componentwise backward error (Oettli and Prager 1964). Rows
    /// whose denominator is below (n + 1) eps ||A||_i ||x|| are guarded with the normwise denominator (Arioli, Demmel and Duff 1989).
    pub componentwise: f64,
    /// ||b - A x||_2 / ||b||_2; infinite where b = 0 and the residual is not.
    pub relative: f64,
}

impl Residual {
    /// Measures `x` against A x = b with a compensated residual. NaN or infinity anywhere gives infinite errors.
    pub fn measure(matrix: &SymmetricCsr, x: Columns<&[f64]>, b: Columns<&[f64]>) -> Self {
        if x.slice().iter().any(|v| !v.is_finite()) {
            return Self {
                backward_error: f64::INFINITY,
                componentwise: f64::INFINITY,
                relative: f64::INFINITY,
            };
        }
        let (n, k) = (x.n(), x.k());
        let mut r = vec![0.0; n * k];
        compensated_residual(matrix, x, b, Columns::new(&mut r[..], n, k));
        let absolute = absolute_product(matrix, x);
        let row_sums = matrix.absolute_row_sums();
        let norm = row_sums.iter().copied().fold(0.0, f64::max);
        let mut worst = Self::default();
        for c in 0..k {
            let column = ColumnView { n, k, c };
            let (norm_x, norm_b) = (column.max(x.slice()), column.max(b.slice()));
            let eta = ratio(column.max(&r), norm * norm_x + norm_b);
            let guard = (n as f64 + 1.0) * f64::EPSILON;
            let omega = (0..n).map(|i| {
                let at = i * k + c;
                let scale = absolute[at] + b.slice()[at].abs();
                let floor = row_sums[i] * norm_x;
                ratio(r[at].abs(), if scale > guard * floor { scale } else { scale + floor })
            });
            worst.backward_error = worst.backward_error.max(eta);
            worst.componentwise = omega.fold(worst.componentwise, f64::max);
            worst.relative = worst.relative.max(ratio(column.euclidean(&r), column.euclidean(b.slice())));
        }
        worst
    }
}

/// 0 / 0 = 0: nothing asked, nothing wrong. NaN counts as infinitely wrong.
fn ratio(numerator: f64, denominator: f64) -> f64 {
    match numerator {
        0.0 => 0.0,
        x if x.is_nan() => f64::INFINITY,
        x => x / denominator,
    }
}

struct ColumnView {
    n: usize,
    k: usize,
    c: usize,
}

impl ColumnView {
    fn values<'a>(&self, block: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let (k, c) = (self.k, self.c);
        (0..self.n).map(move |i| block[i * k + c])
    }
    fn max(&self, block: &[f64]) -> f64 {
        self.values(block).fold(0.0, |m, v| if v.is_nan() { f64::NAN } else { m.max(v.abs()) })
    }
    /// Scaled, so that neither 1e200 nor 1e-200 squared leaves the range.
    fn euclidean(&self, block: &[f64]) -> f64 {
        let scale = self.max(block);
        if scale == 0.0 {
            0.0
        } else {
            scale * self.values(block).map(|v| (v / scale).powi(2)).sum::<f64>().sqrt()
        }
    }
}

/// |A| |x|, n x k.
fn absolute_product(matrix: &SymmetricCsr, x: Columns<&[f64]>) -> Vec<f64> {
    let k = x.k();
    let x = x.slice();
    let mut y = vec![0.0; x.len()];
    for i in 0..matrix.n() {
        let (columns, values) = matrix.row(i);
        for (&j, &a) in columns.iter().zip(values) {
            let j = j as usize;
            for c in 0..k {
                y[i * k + c] += (a * x[j * k + c]).abs();
                if i != j {
                    y[j * k + c] += (a * x[i * k + c]).abs();
                }
            }
        }
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sees_what_plain_f64_cannot() {
        // 1e16 + 1 - 1e16: the plain sum loses the 1.
        let matrix = SymmetricCsr::from_triplets(
            3,
            &[(0, 0, 1.0), (0, 1, 1e16), (0, 2, -1e16), (1, 1, 1.0), (2, 2, 1.0)],
        )
        .expect("valid");
        let x = [1.0; 3];
        let b = [0.0, 1e16 + 2.0, -1e16];
        let mut r = [0.0; 3];
        compensated_residual(
            &matrix,
            Columns::new(&x, 3, 1),
            Columns::new(&b, 3, 1),
            Columns::new(&mut r[..], 3, 1),
        );
        assert_eq!(r, [-1.0, 1.0, -1.0]);
    }

    #[test]
    fn exact_solution_has_no_error_and_nan_is_infinitely_wrong() {
        let matrix =
            SymmetricCsr::from_triplets(2, &[(0, 0, 2.0), (0, 1, -1.0), (1, 1, 2.0)]).expect("valid");
        let measure = |x: [f64; 2], b: [f64; 2]| {
            Residual::measure(&matrix, Columns::new(&x, 2, 1), Columns::new(&b, 2, 1))
        };
        assert_eq!(measure([1.0, 1.0], [1.0, 1.0]), Residual::default());
        assert_eq!(measure([0.0, 0.0], [0.0, 0.0]), Residual::default());
        assert_eq!(measure([f64::NAN, 1.0], [1.0, 1.0]).backward_error, f64::INFINITY);
        let off = measure([1.0, 1.5], [1.0, 1.0]); // r = (0.5, -1)
        assert_eq!(off.backward_error, 1.0 / (3.0 * 1.5 + 1.0));
        assert_eq!(off.componentwise, 1.0 / (1.0 + 3.0 + 1.0));
    }
}
