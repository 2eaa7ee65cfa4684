//! The coarsest level: dense Cholesky.

use crate::backends::cg::operator::Csr;
use crate::isa::Real;

/// L with A = L L^T, the lower triangle by rows, f64.
pub(crate) struct Bottom {
    l: Vec<f64>,
    /// The solution, W lanes per row.
    work: Vec<f64>,
}

impl Bottom {
    /// Factors `a`. n^3 / 3 flops: 9 million for 300 rows.
    ///
    /// # Errors
    /// The row whose pivot is not positive.
    pub(crate) fn new(a: Csr<'_>, width: usize) -> Result<Self, usize> {
        let n = a.n();
        let mut l = vec![0.0; n * n];
        for i in 0..n {
            let (columns, values) = a.row(i);
            for (&j, &v) in columns.iter().zip(values).filter(|(j, _)| **j as usize <= i) {
                l[i * n + j as usize] = v;
            }
        }
        for i in 0..n {
            let (above, row) = l.split_at_mut(i * n);
            for j in 0..i {
                let other = &above[j * n..j * n + j + 1];
                row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
            }
            let pivot = row[i] - dot(&row[..i], &row[..i]);
            if pivot.is_nan() || pivot <= 0.0 {
                return Err(i);
            }
            row[i] = pivot.sqrt();
        }
        Ok(Self { l, work: vec![0.0; n * width] })
    }

    /// Order of the matrix.
    pub(crate) fn n(&self) -> usize {
        self.l.len().isqrt()
    }

    /// x = A^-1 b: 2 n^2 flops per lane.
    pub(crate) fn solve<S: Real, const W: usize>(&mut self, b: &[[S; W]], x: &mut [[S; W]]) {
        let n = self.n();
        let work = &mut self.work.as_chunks_mut::<W>().0[..n];
        for i in 0..n {
            let row = &self.l[i * n..i * n + i + 1];
            let mut sum = b[i].map(S::to_f64);
            for (l, w) in row[..i].iter().zip(&*work) {
                (0..W).for_each(|c| sum[c] -= l * w[c]);
            }
            work[i] = sum.map(|s| s / row[i]);
        }
        for i in (0..n).rev() {
            let row = &self.l[i * n..i * n + i + 1];
            let value = work[i].map(|w| w / row[i]);
            x[i] = value.map(S::from_f64);
            for (l, w) in row[..i].iter().zip(&mut *work) {
                (0..W).for_each(|c| w[c] -= l * value[c]);
            }
        }
    }

    /// Entries.
    pub(crate) fn entries(&self) -> usize {
        self.n() * (self.n() + 1) / 2
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
