//! One level: Gauss-Seidel smoothing and the way to the next level, in f32.
//!
//! The sweep before the coarse correction starts from x = 0, so it reads the lower triangle only, and the residual it leaves
//! is -U x: both together are one pass over the matrix. The sweep after it runs backwards over all entries, which
//! makes the cycle symmetric. 8 bytes per entry, 2 W flops.

use super::rows::Rows;
use crate::backends::cg::operator::Csr;

/// Matrix, interpolation and workspace of a level.
pub(crate) struct Level {
    lower: Rows<f32>,
    upper: Rows<f32>,
    inverse: Vec<f32>,
    p: Rows<f32>,
    r: Rows<f32>,
    /// Residual of this level.
    residual: Vec<f32>,
    /// What the next level works on.
    pub(crate) coarse: Coarse,
}

/// Right-hand side and iterate of a coarse level, W lanes per row.
#[derive(Default)]
pub(crate) struct Coarse {
    b: Vec<f32>,
    x: Vec<f32>,
}

impl Coarse {
    /// Both, `rows` long.
    pub(crate) fn split<const W: usize>(&mut self, rows: usize) -> (&[[f32; W]], &mut [[f32; W]]) {
        (&self.b.as_chunks().0[..rows], &mut self.x.as_chunks_mut().0[..rows])
    }
}

impl Level {
    /// Packs `a` and its interpolation `p` (`r` = P^T).
    pub(crate) fn new(a: Csr<'_>, p: Rows<f32>, r: Rows<f32>, width: usize) -> Self {
        let n = a.n();
        let half = a.columns.len() / 2;
        let (mut lower, mut upper) = (Rows::with_capacity(n, half), Rows::with_capacity(n, half));
        let mut inverse = Vec::with_capacity(n);
        for i in 0..n {
            let (columns, values) = a.row(i);
            for (&j, &v) in columns.iter().zip(values) {
                match (j as usize).cmp(&i) {
                    std::cmp::Ordering::Less => lower.push(j, v as f32),
                    std::cmp::Ordering::Equal => inverse.push((1.0 / v) as f32),
                    std::cmp::Ordering::Greater => upper.push(j, v as f32),
                }
            }
            lower.end_row();
            upper.end_row();
        }
        let coarse = Coarse { b: vec![0.0; r.n() * width], x: vec![0.0; r.n() * width] };
        Self { lower, upper, inverse, p, r, residual: vec![0.0; n * width], coarse }
    }

    /// The interpolation, to be used again.
    pub(crate) fn into_interpolation(self) -> Rows<f32> {
        self.p
    }

    /// Rows of the next level.
    pub(crate) fn coarse_rows(&self) -> usize {
        self.r.n()
    }

    /// Smooths from zero, x = (D + L)^-1 b, and restricts the residual to the next level.
    pub(crate) fn down<const W: usize>(&mut self, b: &[[f32; W]], x: &mut [[f32; W]]) {
        for i in 0..b.len() {
            let sum = subtract(b[i], self.lower.row(i), x);
            x[i] = sum.map(|s| s * self.inverse[i]);
        }
        let residual = self.residual.as_chunks_mut::<W>().0;
        for i in 0..b.len() {
            residual[i] = subtract([0.0; W], self.upper.row(i), x);
        }
        self.r.multiply(residual, &mut self.coarse.b.as_chunks_mut::<W>().0[..self.r.n()], false);
    }

    /// Adds the coarse correction and smooths backwards: x = (D + U)^-1 (b - L x).
    pub(crate) fn up<const W: usize>(&self, b: &[[f32; W]], x: &mut [[f32; W]]) {
        self.p.multiply(self.coarse.x.as_chunks::<W>().0, x, true);
        for i in (0..b.len()).rev() {
            let sum = subtract(subtract(b[i], self.lower.row(i), x), self.upper.row(i), x);
            x[i] = sum.map(|s| s * self.inverse[i]);
        }
    }

    /// Entries and bytes of matrix and interpolation.
    pub(crate) fn size(&self) -> (usize, usize) {
        let parts = [&self.lower, &self.upper, &self.p, &self.r];
        let entries = parts.iter().map(|m| m.entries()).sum::<usize>() + self.inverse.len();
        (entries, parts.iter().map(|m| m.bytes()).sum::<usize>() + 4 * self.inverse.len())
    }
}

/// sum - row . x
#[inline(always)]
fn subtract<const W: usize>(
    mut sum: [f32; W],
    (columns, values): (&[u32], &[f32]),
    x: &[[f32; W]],
) -> [f32; W] {
    for (&j, &a) in columns.iter().zip(values) {
        let x = &x[j as usize];
        for c in 0..W {
            sum[c] -= a * x[c];
        }
    }
    sum
}
