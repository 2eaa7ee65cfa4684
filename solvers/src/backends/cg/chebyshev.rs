//! Chebyshev polynomial in D^-1 A (Saad 2003, section 12.3.2).
//!
//! M^-1 r is what a few steps of Chebyshev iteration make of r, on the interval [b / 30, b] with b a bound on the eigenvalues
//! of D^-1/2 A D^-1/2. As many products with A as CG with Jacobi, but a fifth of its dot products and vector updates, and
//! the products are in f32: worth it where those cost more than the matrix (many threads, GPUs); on one core Jacobi is as fast. The bound is
//! Gershgorin's, which holds for every matrix, so the polynomial is positive on the whole spectrum.

use super::operator::Csr;
use super::preconditioner::{AnyPreconditioner, Budget, Preconditioner, Size};
use super::workers::{Strips, Workers};
use crate::backends::multigrid::rows::Rows;
use crate::error::PrepareError;
use crate::isa::{Features, Kernel};
use std::ops::Range;

/// Products with A per application.
const DEGREE: usize = 4;
/// Upper over lower end of the interval: about where a polynomial of that degree still damps all of it by half.
const RATIO: f64 = 30.0;

/// D^-1/2 A D^-1/2 in f32, D^-1/2, and the bound b.
pub(crate) struct Chebyshev {
    scaled: Rows<f32>,
    root: Vec<f32>,
    bound: f64,
    /// Scaled residual and direction, W lanes per row.
    work: [Vec<f32>; 2],
    strips: Strips,
}

impl Chebyshev {
    /// Scales `a` and bounds its spectrum. One pass.
    pub(crate) fn new(workers: &Workers, a: Csr<'_>, width: usize) -> Self {
        let root: Vec<f64> = a.diagonal().into_iter().map(|d| 1.0 / d.sqrt()).collect();
        let n = a.n();
        let mut scaled = Rows::with_capacity(n, a.columns.len());
        let mut bound = 0.0f64;
        for i in 0..n {
            let (columns, values) = a.row(i);
            let mut sum = 0.0;
            for (&j, &v) in columns.iter().zip(values) {
                let value = v * root[i] * root[j as usize];
                scaled.push(j, value as f32);
                sum += value.abs();
            }
            scaled.end_row();
            bound = bound.max(sum);
        }
        let work = std::array::from_fn(|_| vec![0.0; n * width]);
        let root = root.into_iter().map(|r| r as f32).collect();
        Self { scaled, root, bound, work, strips: workers.strips(n) }
    }
}

impl<const W: usize> Preconditioner<f32, W> for Chebyshev {
    /// Chebyshev iteration from zero on the scaled matrix: x += d, r -= A d, d = beta d + gamma r.
    fn apply(&mut self, workers: &mut Workers, r: &mut [[f32; W]], z: &mut [[f32; W]]) {
        let n = r.len();
        let [residual, direction] = self.work.each_mut().map(|v| &mut v.as_chunks_mut::<W>().0[..n]);
        let (low, high) = (self.bound / RATIO, self.bound);
        let (centre, half) = ((high + low) / 2.0, (high - low) / 2.0);
        let (isa, root, r, strips) = (workers.isa, &self.root[..], &*r, &self.strips);
        let parts = (&mut *residual, &mut *direction, &mut *z);
        workers.run(strips, parts, |_, rows, (residual, direction, z)| {
            for (at, i) in rows.enumerate() {
                let scaled = r[i].map(|v| v * root[i]);
                residual[at] = scaled;
                direction[at] = scaled.map(|v| v / centre as f32);
                z[at] = direction[at];
            }
        });
        let mut rho = half / centre;
        for _ in 1..DEGREE {
            let next = 1.0 / (2.0 * centre / half - rho);
            let (keep, add) = ((next * rho) as f32, (2.0 * next / half) as f32);
            let (matrix, old) = (&self.scaled, &*direction);
            workers.run(strips, &mut *residual, |_, rows, residual| {
                isa.run(Subtract { matrix, rows, direction: old, residual });
            });
            let residual = &*residual;
            workers.run(strips, (&mut *direction, &mut *z), |_, rows, (direction, z)| {
                for ((d, z), residual) in direction.iter_mut().zip(z).zip(&residual[rows]) {
                    for c in 0..W {
                        d[c] = keep * d[c] + add * residual[c];
                        z[c] += d[c];
                    }
                }
            });
            rho = next;
        }
        for (z, root) in z.iter_mut().zip(&self.root) {
            (0..W).for_each(|c| z[c] *= root);
        }
    }
}

/// residual -= M direction for one strip.
struct Subtract<'a, const W: usize> {
    matrix: &'a Rows<f32>,
    rows: Range<usize>,
    direction: &'a [[f32; W]],
    residual: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for Subtract<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (i, residual) in self.rows.zip(self.residual) {
            let (columns, values) = self.matrix.row(i);
            for (&j, &a) in columns.iter().zip(values) {
                let d = &self.direction[j as usize];
                for c in 0..W {
                    residual[c] -= a * d[c];
                }
            }
        }
    }
}

impl AnyPreconditioner<f32> for Chebyshev {
    fn update(&mut self, workers: &mut Workers, a: Csr<'_>) -> Result<(), PrepareError> {
        *self = Self::new(workers, a, self.work[0].len() / a.n());
        Ok(())
    }

    fn budget(&self) -> Budget {
        Budget::SIMPLE
    }

    fn size(&self) -> Size {
        let entries = self.scaled.entries() + self.root.len();
        Size { entries: entries as u64, bytes: (self.scaled.bytes() + 4 * self.root.len()) as u64 }
    }
}
