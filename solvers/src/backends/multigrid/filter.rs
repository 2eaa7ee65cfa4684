//! The filtered matrix: what is left of A when weak and positive couplings are lumped into the diagonal.
//!
//! Aggregates and interpolation are built from it. Cotangent weights of obtuse triangles give A positive off-diagonal
//! entries; interpolating along those, or along entries that are tiny beside their rows, makes coarse functions that
//! no smoother can mend. Lumping keeps row sums, so constants stay constants:
//! f_ij = a_ij where -a_ij >= 0.08 sqrt(a_ii a_jj), else 0; f_ii = a_ii + sum of what was dropped,
//! but at least sum_j |f_ij| (then f is an M-matrix and Jacobi steps on it never overshoot).

use crate::backends::cg::operator::Csr;

/// A coupling is strong from this share of its diagonals: half of what a regular triangulation has (1/6).
const STRONG: f64 = 0.08;

/// Off-diagonal couplings of the filtered matrix, by rows, and its diagonal.
pub(crate) struct Filtered {
    /// Start of each row; length n + 1.
    pub(crate) starts: Vec<u32>,
    /// Column of each coupling, ascending within a row.
    pub(crate) columns: Vec<u32>,
    /// Strength -f_ij > 0 of each coupling.
    pub(crate) strengths: Vec<f64>,
    /// f_ii.
    pub(crate) diagonal: Vec<f64>,
}

impl Filtered {
    /// Filters `a`. Cost: two passes over it.
    pub(crate) fn new(a: Csr<'_>) -> Self {
        let n = a.n();
        let diagonal = a.diagonal();
        let mut f = Self {
            starts: vec![0; n + 1],
            columns: Vec::with_capacity(a.columns.len()),
            strengths: Vec::with_capacity(a.columns.len()),
            diagonal: vec![0.0; n],
        };
        for i in 0..n {
            let (columns, values) = a.row(i);
            let bound = STRONG * STRONG * diagonal[i];
            let (mut lumped, mut kept) = (diagonal[i], 0.0);
            for (&j, &v) in columns.iter().zip(values) {
                if j as usize == i {
                    continue;
                }
                if v < 0.0 && v * v >= bound * diagonal[j as usize] {
                    f.columns.push(j);
                    f.strengths.push(-v);
                    kept -= v;
                } else {
                    lumped += v;
                }
            }
            f.starts[i + 1] = f.columns.len() as u32;
            f.diagonal[i] = lumped.max(kept);
        }
        f
    }

    /// Couplings of row `i`.
    pub(crate) fn row(&self, i: usize) -> (&[u32], &[f64]) {
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        (&self.columns[range.clone()], &self.strengths[range])
    }
}
