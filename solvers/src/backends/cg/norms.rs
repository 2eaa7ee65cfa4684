//! How large the residual of a solve is.

use super::operator::Csr;

/// Squares of two norms of W columns v: the 2-norm of v, and the largest entry of D^-1 v, D the diagonal of the matrix.
///
/// The 2-norm of a residual says little of rows with small entries: where a mass rules the matrix, and a vertex owns a
/// hundredth of the usual area, its value may be off by hundreds of tolerances when the norm has long been reached. There
/// D^-1 r is the error. So a column is solved only when both are small enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Norms<const W: usize> {
    /// ||v||_2^2.
    pub(crate) plain: [f64; W],
    /// ||D^-1 v||_max^2.
    pub(crate) scaled: [f64; W],
}

impl<const W: usize> Norms<W> {
    /// Of W zero columns.
    pub(crate) const ZERO: Self = Self { plain: [0.0; W], scaled: [0.0; W] };

    /// Takes in a row `v` whose diagonal entry has the inverse `inverse`. 5 flops per column.
    #[inline(always)]
    pub(crate) fn add(&mut self, v: &[f64; W], inverse: f64) {
        for c in 0..W {
            let scaled = v[c] * inverse;
            self.plain[c] += v[c] * v[c];
            self.scaled[c] = larger(self.scaled[c], scaled * scaled);
        }
    }

    /// Square of the relative size of column `c`: the larger of both norms over those of `whole`; 0 where both are zero there.
    pub(crate) fn relative(&self, whole: &Self, c: usize) -> f64 {
        let ratio = |own: f64, whole: f64| if own == 0.0 && whole == 0.0 { 0.0 } else { own / whole };
        let plain = ratio(self.plain[c], whole.plain[c]);
        if plain.is_nan() { plain } else { larger(ratio(self.scaled[c], whole.scaled[c]), plain) }
    }
}

/// The larger number; `b` where `a` is none. One instruction where there are vectors, unlike [`f64::max`].
#[inline(always)]
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The inverse of every diagonal entry of `matrix`, 0 for those that are not positive: their rows count in the plain norm
/// alone.
pub(crate) fn inverse_diagonal(matrix: Csr<'_>) -> Vec<f64> {
    matrix.diagonal().into_iter().map(|d| if d > 0.0 { 1.0 / d } else { 0.0 }).collect()
}
