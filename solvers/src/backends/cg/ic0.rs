//! IC(0): M = L L^T, L with the pattern of A's lower triangle (Meijerink and van der Vorst 1977).
//!
//! Where a pivot is not safely positive (positive off-diagonals make that happen) the factorisation starts again on
//! A + alpha diag(A) with a larger alpha (Manteuffel 1980). A third of the iterations of Jacobi at some one and a half
//! times its cost each, growing with the mesh just as fast. The right choice where a multilevel hierarchy is too much to set up: a few
//! solves of moderate accuracy on well-shaped meshes.

use super::operator::Csr;
use super::preconditioner::{AnyPreconditioner, Preconditioner, Size};
use super::workers::Workers;
use crate::backends::multigrid::rows::Rows;
use crate::error::PrepareError;

/// Smallest pivot, as a share of the diagonal: smaller ones make L^-1 grow without bound.
const SMALLEST_PIVOT: f64 = 1e-2;
/// The first shift; each further one is twice as large. At the size of the row sums (a few times the diagonal) no pivot
/// can fail, so some 15 attempts are the most.
const FIRST_SHIFT: f64 = 1e-3;

/// L without its diagonal, by rows, and the inverse diagonal.
pub(crate) struct IncompleteCholesky {
    lower: Rows<f64>,
    inverse: Vec<f64>,
}

impl IncompleteCholesky {
    /// Factors `a`, shifted as little as need be.
    pub(crate) fn new(a: Csr<'_>) -> Self {
        let diagonal = a.diagonal();
        let mut shift = 0.0;
        loop {
            if let Some(factor) = Self::factor(a, &diagonal, shift) {
                return factor;
            }
            shift = f64::max(2.0 * shift, FIRST_SHIFT);
        }
    }

    /// l_ij = (a_ij - sum_k l_ik l_jk) / l_jj on the pattern, l_ii^2 = (1 + shift) a_ii - sum_k l_ik^2. None where a pivot fails.
    pub(super) fn factor(a: Csr<'_>, diagonal: &[f64], shift: f64) -> Option<Self> {
        let n = a.n();
        let mut lower = Rows::with_capacity(n, a.columns.len() / 2);
        let mut inverse = Vec::with_capacity(n);
        for i in 0..n {
            let (columns, values) = a.row(i);
            let start = lower.entries();
            let mut pivot = (1.0 + shift) * diagonal[i];
            for (&j, &v) in columns.iter().zip(values).take_while(|(j, _)| (**j as usize) < i) {
                let own = (&lower.columns[start..], &lower.values[start..]);
                let l = (v - sparse_dot(own, lower.row(j as usize))) * inverse[j as usize];
                lower.push(j, l);
                pivot -= l * l;
            }
            lower.end_row();
            if pivot.is_nan() || pivot <= SMALLEST_PIVOT * diagonal[i] {
                return None;
            }
            inverse.push(1.0 / pivot.sqrt());
        }
        Some(Self { lower, inverse })
    }
}

/// Inner product of two sparse rows with ascending columns.
fn sparse_dot(a: (&[u32], &[f64]), b: (&[u32], &[f64])) -> f64 {
    let (mut i, mut j, mut sum) = (0, 0, 0.0);
    while i < a.0.len() && j < b.0.len() {
        match a.0[i].cmp(&b.0[j]) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => {
                sum += a.1[i] * b.1[j];
                (i, j) = (i + 1, j + 1);
            }
        }
    }
    sum
}

impl<const W: usize> Preconditioner<f64, W> for IncompleteCholesky {
    /// L y = r forwards, L^T z = y backwards: 4 W flops and 24 bytes per entry of L.
    fn apply(&mut self, _: &mut Workers, r: &mut [[f64; W]], z: &mut [[f64; W]]) {
        for i in 0..r.len() {
            let (columns, values) = self.lower.row(i);
            let mut sum = r[i];
            for (&j, &l) in columns.iter().zip(values) {
                let y = &z[j as usize];
                (0..W).for_each(|c| sum[c] -= l * y[c]);
            }
            z[i] = sum.map(|s| s * self.inverse[i]);
        }
        for i in (0..r.len()).rev() {
            let (columns, values) = self.lower.row(i);
            let value = z[i].map(|v| v * self.inverse[i]);
            z[i] = value;
            for (&j, &l) in columns.iter().zip(values) {
                let y = &mut z[j as usize];
                (0..W).for_each(|c| y[c] -= l * value[c]);
            }
        }
    }
}

impl AnyPreconditioner<f64> for IncompleteCholesky {
    fn update(&mut self, _: &mut Workers, a: Csr<'_>) -> Result<(), PrepareError> {
        *self = Self::new(a);
        Ok(())
    }

    fn size(&self) -> Size {
        let (entries, n) = (self.lower.entries(), self.inverse.len());
        Size { entries: (entries + n) as u64, bytes: (self.lower.bytes() + 8 * n) as u64 }
    }
}
