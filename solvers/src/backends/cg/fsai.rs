//! FSAI: M^-1 = G^T G, G a sparse lower triangle with G A G^T near the identity (Kolotilina and Yeremin 1993).
//!
//! Row i of G: on its pattern P (columns <= i), solve A[P, P] y = e_i and take y / sqrt(y_i). The small systems are
//! principal submatrices of A, so the result is positive definite for every SPD matrix, M-matrix or not. Applying it is
//! two products and no triangular solve, which is why GPUs like it. On one core IC(0) is
//! faster: it takes two thirds of the iterations, with a quarter of the entries. FSAI is the choice where IC(0) needs a
//! large shift, or where triangular solves do not run in parallel.

use super::operator::Csr;
use super::preconditioner::{AnyPreconditioner, Preconditioner, Size};
use super::workers::{Strips, Workers};
use crate::backends::multigrid::rows::Rows;
use crate::error::PrepareError;

/// Where G may have entries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pattern {
    /// The lower triangle of A: about 4 entries per row of a mesh.
    #[cfg(test)]
    LowerTriangle,
    /// This many entries per row: of the neighbours, and theirs, those that couple to the row most.
    Width(usize),
}

/// G and its transpose, and G r.
pub(crate) struct Fsai {
    pattern: Pattern,
    g: Rows<f64>,
    transposed: Rows<f64>,
    work: Vec<f64>,
    strips: Strips,
}

impl Fsai {
    /// Computes G for `a`. Cost: a dense factorisation of the width per row, some 300 flops for width 8.
    ///
    /// # Errors
    /// The row whose small system is not positive definite: then A is not.
    pub(crate) fn new(
        workers: &Workers,
        a: Csr<'_>,
        pattern: Pattern,
        width: usize,
    ) -> Result<Self, PrepareError> {
        let n = a.n();
        let diagonal = a.diagonal();
        let mut g = Rows::with_capacity(n, 8 * n);
        let (mut chosen, mut dense) = (Vec::new(), Vec::new());
        for i in 0..n {
            choose(a, &diagonal, pattern, i, &mut chosen);
            let y =
                last_column(a, &chosen, &mut dense).ok_or(PrepareError::NotPositiveDefinite { row: i })?;
            let scale = 1.0 / y[chosen.len() - 1].sqrt();
            chosen.iter().zip(y).for_each(|(&j, y)| g.push(j, scale * y));
            g.end_row();
        }
        let transposed = g.transpose(n);
        Ok(Self { pattern, g, transposed, work: vec![0.0; n * width], strips: workers.strips(n) })
    }
}

#[cfg(feature = "vulkan")]
impl Fsai {
    /// G and G^T.
    pub(crate) fn into_factors(self) -> (Rows<f64>, Rows<f64>) {
        (self.g, self.transposed)
    }
}

/// The columns of row `i` of G, ascending; the last one is i.
fn choose(a: Csr<'_>, diagonal: &[f64], pattern: Pattern, i: usize, chosen: &mut Vec<u32>) {
    chosen.clear();
    let (columns, values) = a.row(i);
    let below = |j: u32| (j as usize) < i;
    match pattern {
        #[cfg(test)]
        Pattern::LowerTriangle => chosen.extend(columns.iter().filter(|&&j| below(j))),
        Pattern::Width(width) => {
            // Strength a_ij^2 / (a_ii a_jj); along a path of two couplings, the product.
            let strength = |p: usize, q: u32, v: f64| v * v / (diagonal[p] * diagonal[q as usize]);
            let mut candidates: Vec<(f64, u32)> = Vec::new();
            for (&j, &v) in columns.iter().zip(values).filter(|(j, _)| **j as usize != i) {
                let first = strength(i, j, v);
                candidates.push((first, j));
                let (next, further) = a.row(j as usize);
                let paths = next.iter().zip(further).filter(|(k, _)| **k != j);
                candidates.extend(paths.map(|(&k, &w)| (first * strength(j as usize, k, w), k)));
            }
            candidates.retain(|&(_, j)| below(j));
            candidates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for (_, j) in candidates {
                if chosen.len() + 1 < width && !chosen.contains(&j) {
                    chosen.push(j);
                }
            }
        }
    }
    chosen.sort_unstable();
    chosen.push(i as u32);
}

/// y with A[P, P] y = e_last, by dense Cholesky in `dense`. None where a pivot is not positive.
fn last_column<'a>(a: Csr<'_>, columns: &[u32], dense: &'a mut Vec<f64>) -> Option<&'a [f64]> {
    let m = columns.len();
    dense.clear();
    dense.resize(m * m + m, 0.0);
    let (l, y) = dense.split_at_mut(m * m);
    for (row, &i) in columns.iter().enumerate() {
        let (others, values) = a.row(i as usize);
        for (&j, &v) in others.iter().zip(values) {
            if let Ok(column) = columns[..=row].binary_search(&j) {
                l[row * m + column] = v;
            }
        }
        for j in 0..=row {
            let known: f64 = (0..j).map(|k| l[row * m + k] * l[j * m + k]).sum();
            let value = l[row * m + j] - known;
            if j < row {
                l[row * m + j] = value / l[j * m + j];
            } else if value > 0.0 {
                l[row * m + row] = value.sqrt();
            } else {
                return None;
            }
        }
    }
    // L z = e_last has z_last = 1 / l_last only; then L^T y = z.
    for i in (0..m).rev() {
        let known: f64 = (i + 1..m).map(|k| l[k * m + i] * y[k]).sum();
        let z = if i + 1 == m { 1.0 / l[i * m + i] } else { 0.0 };
        y[i] = (z - known) / l[i * m + i];
    }
    Some(y)
}

impl<const W: usize> Preconditioner<f64, W> for Fsai {
    /// z = G^T (G r): 4 W flops and 24 bytes per entry of G.
    fn apply(&mut self, workers: &mut Workers, r: &mut [[f64; W]], z: &mut [[f64; W]]) {
        let work = &mut self.work.as_chunks_mut::<W>().0[..r.len()];
        self.g.multiply(workers, &self.strips, r, work, false);
        self.transposed.multiply(workers, &self.strips, work, z, false);
    }
}

impl AnyPreconditioner<f64> for Fsai {
    /// The pattern follows the couplings, so it is chosen anew with them.
    fn update(&mut self, workers: &mut Workers, a: Csr<'_>) -> Result<(), PrepareError> {
        *self = Self::new(workers, a, self.pattern, self.work.len() / a.n())?;
        Ok(())
    }

    fn size(&self) -> Size {
        let entries = 2 * self.g.entries() as u64;
        Size { entries, bytes: (self.g.bytes() + self.transposed.bytes()) as u64 }
    }
}
