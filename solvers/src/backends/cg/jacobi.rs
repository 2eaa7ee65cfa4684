//! Jacobi: M = diag(A).
//!
//! Costs nothing to set up and 8 bytes per row; iterations grow with the square root of the number of triangles and with
//! the worst triangle. The right choice for matrices dominated by their diagonal (`screened` with small tau, smoothing)
//! and the baseline for everything else.

use super::operator::Csr;
use super::preconditioner::{AnyPreconditioner, Preconditioner, Size};
use super::workers::{Strips, Workers};
use crate::error::PrepareError;

/// The inverse diagonal.
pub(crate) struct Jacobi {
    inverse: Vec<f64>,
    strips: Strips,
}

impl Jacobi {
    /// Reads the diagonal of `matrix`, which is positive in every system.
    pub(crate) fn new(workers: &Workers, matrix: Csr<'_>) -> Self {
        let inverse = matrix.diagonal().into_iter().map(|d| 1.0 / d).collect();
        Self { inverse, strips: workers.strips(matrix.n()) }
    }
}

impl<const W: usize> Preconditioner<f64, W> for Jacobi {
    fn apply(&mut self, workers: &mut Workers, r: &mut [[f64; W]], z: &mut [[f64; W]]) {
        let (inverse, r) = (&self.inverse[..], &*r);
        workers.run(&self.strips, z, |_, rows, z| {
            for ((z, r), &d) in z.iter_mut().zip(&r[rows.clone()]).zip(&inverse[rows]) {
                for c in 0..W {
                    z[c] = d * r[c];
                }
            }
        });
    }
}

impl AnyPreconditioner<f64> for Jacobi {
    fn update(&mut self, workers: &mut Workers, matrix: Csr<'_>) -> Result<(), PrepareError> {
        *self = Self::new(workers, matrix);
        Ok(())
    }

    fn size(&self) -> Size {
        let n = self.inverse.len() as u64;
        Size { entries: n, bytes: 8 * n }
    }
}
