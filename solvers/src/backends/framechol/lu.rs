//! LU factorisation with partial pivoting of a small dense matrix.

/// P A = L U; of a matrix of order 0 before the first factorisation.
#[derive(Default)]
pub struct Lu {
    /// L below the diagonal (its own is 1), U from the diagonal on; by rows.
    entries: Vec<f64>,
    /// Row that was swapped with row k in step k.
    swaps: Vec<usize>,
}

impl Lu {
    /// Factors the m x m matrix given by rows. False where it is singular to working precision or not finite.
    /// 2/3 m^3 flops.
    pub fn factorise(&mut self, matrix: Vec<f64>, m: usize) -> bool {
        assert_eq!(matrix.len(), m * m, "matrix: m x m");
        let scale = matrix.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        (self.entries, self.swaps) = (matrix, Vec::with_capacity(m));
        let a = &mut self.entries;
        for k in 0..m {
            let size = |i: usize| a[i * m + k].abs();
            let pivot = (k..m).fold(k, |best, i| if size(i) > size(best) { i } else { best });
            // NaN fails too: no comparison with it holds.
            if !(size(pivot) > f64::EPSILON * scale) {
                return false;
            }
            self.swaps.push(pivot);
            let (above, below) = a.split_at_mut((k + 1) * m);
            let own = &mut above[k * m..];
            if pivot > k {
                own.swap_with_slice(&mut below[(pivot - k - 1) * m..][..m]);
            }
            for row in below.chunks_exact_mut(m) {
                let factor = row[k] / own[k];
                row[k] = factor;
                for j in k + 1..m {
                    row[j] -= factor * own[j];
                }
            }
        }
        a.iter().all(|v| v.is_finite())
    }

    /// x := A^-1 x for k columns, m x k by rows. No allocation.
    pub fn solve(&self, x: &mut [f64], k: usize) {
        let m = self.swaps.len();
        assert_eq!(x.len(), m * k, "x: m x k");
        for (i, &pivot) in self.swaps.iter().enumerate() {
            (0..k).for_each(|c| x.swap(i * k + c, pivot * k + c));
        }
        let subtract = |x: &mut [f64], i: usize, j: usize| {
            let factor = self.entries[i * m + j];
            (0..k).for_each(|c| x[i * k + c] -= factor * x[j * k + c]);
        };
        for i in 0..m {
            (0..i).for_each(|j| subtract(x, i, j));
        }
        for i in (0..m).rev() {
            (i + 1..m).for_each(|j| subtract(x, i, j));
            let pivot = self.entries[i * m + i];
            x[i * k..(i + 1) * k].iter_mut().for_each(|v| *v /= pivot);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_that_need_their_rows_swapped_are_solved() {
        let (m, k) = (9, 2);
        let entry = |i: usize, j: usize| if i == j { 0.0 } else { ((7 * i + 3 * j) % 11) as f64 - 5.0 };
        let matrix: Vec<f64> = (0..m * m).map(|at| entry(at / m, at % m)).collect();
        let exact: Vec<f64> = (0..m * k).map(|at| (at as f64).cos()).collect();
        let mut x: Vec<f64> = (0..m * k)
            .map(|at| (0..m).map(|j| matrix[at / k * m + j] * exact[j * k + at % k]).sum())
            .collect();
        let mut lu = Lu::default();
        assert!(lu.factorise(matrix, m));
        lu.solve(&mut x, k);
        assert!(x.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-12), "{x:?}");
    }

    #[test]
    fn singular_and_damaged_matrices_are_refused() {
        let mut lu = Lu::default();
        assert!(!lu.factorise(vec![1.0, 2.0, 2.0, 4.0], 2));
        assert!(!lu.factorise(vec![f64::NAN, 2.0, 2.0, 4.0], 2));
        assert!(!lu.factorise(vec![0.0], 1));
        assert!(lu.factorise(Vec::new(), 0));
    }
}
