//! One level: Gauss-Seidel smoothing and the way to the next level, in f32.
//!
//! The sweep before the coarse correction starts from x = 0, so it reads the lower triangle only, and the residual it leaves
//! is -U x: both together are one pass over the matrix. The sweep after it runs backwards over all entries, which
//! makes the cycle symmetric. 8 bytes per entry, 2 W flops.
//!
//! Threads sweep their strips at the same time and take the others' values from before the sweep. What this leaves out, the
//! entries O between strips, is answered by l1-weights (Baker, Falgout, Kolev and Yang 2011): the diagonal of a row grows by
//! the sum of |a_ij| over its entries in O, so that M + M^T - A stays positive definite and the sweep converges.
//! Only rows along the borders of strips, some sqrt(n), notice.

use super::rows::Rows;
use crate::backends::cg::operator::Csr;
use crate::backends::cg::workers::{Strips, Workers};
use crate::isa::{Features, Kernel};
use std::ops::Range;

/// Matrix, interpolation and workspace of a level.
pub(crate) struct Level {
    strips: Strips,
    /// Entries within strips but the diagonal.
    inner: Rows<f32>,
    /// Where the upper triangle of each row begins in `inner`.
    upper: Vec<u32>,
    /// 1 / (a_ii + l1-weight).
    inverse: Vec<f32>,
    border: Border,
    p: Rows<f32>,
    r: Rows<f32>,
    /// Residual of this level.
    residual: Vec<f32>,
    /// What the next level works on.
    pub(crate) coarse: Coarse,
}

/// Entries between strips, in the rows that have any.
struct Border {
    /// Those rows, ascending.
    rows: Vec<u32>,
    /// Which of them lie in which strip.
    strips: Strips,
    /// Their entries between strips.
    entries: Rows<f32>,
    /// The sum of |a_ij| over them.
    weights: Vec<f32>,
    /// What a sweep takes from before it, W lanes per row.
    held: Vec<f32>,
}

/// Right-hand side and iterate of a coarse level, W lanes per row.
#[derive(Default)]
pub(crate) struct Coarse {
    strips: Option<Strips>,
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
    pub(crate) fn new(workers: &Workers, a: Csr<'_>, p: Rows<f32>, r: Rows<f32>, width: usize) -> Self {
        let n = a.n();
        let strips = workers.strips(n);
        let mut inner = Rows::with_capacity(n, a.columns.len() - n);
        let (mut upper, mut inverse) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut border = BorderBuilder::default();
        for t in 0..strips.count() {
            let own = strips.range(t);
            for i in own.clone() {
                let (columns, values) = a.row(i);
                let mut diagonal = 0.0;
                for (&j, &v) in columns.iter().zip(values) {
                    let j = j as usize;
                    if j == i {
                        diagonal = v;
                        upper.push(inner.entries() as u32);
                    } else if own.contains(&j) {
                        inner.push(j as u32, v as f32);
                    } else {
                        border.push(j as u32, v);
                    }
                }
                inner.end_row();
                inverse.push((1.0 / (diagonal + border.end_row(i))) as f32);
            }
            border.end_strip();
        }
        let border = border.finish(width);
        let coarse_rows = r.n();
        let coarse = Coarse {
            strips: Some(workers.strips(coarse_rows)),
            b: vec![0.0; coarse_rows * width],
            x: vec![0.0; coarse_rows * width],
        };
        Self { strips, inner, upper, inverse, border, p, r, residual: vec![0.0; n * width], coarse }
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
    pub(crate) fn down<const W: usize>(&mut self, workers: &mut Workers, b: &[[f32; W]], x: &mut [[f32; W]]) {
        let isa = workers.isa;
        let level = &*self;
        workers.run(&self.strips, &mut *x, |_, rows, x| isa.run(SweepDown { level, rows, b, x }));
        let mut buffer = std::mem::take(&mut self.residual);
        let residual = buffer.as_chunks_mut::<W>().0;
        let (level, x) = (&*self, &*x);
        workers.run(&self.strips, &mut residual[..b.len()], |t, rows, residual| {
            isa.run(Remainder { level, border: level.border.strips.range(t), rows, x, residual });
        });
        let coarse = &mut self.coarse;
        let strips = coarse.strips.as_ref().expect("set with the level");
        let out = &mut coarse.b.as_chunks_mut::<W>().0[..self.r.n()];
        self.r.multiply(workers, strips, residual, out, false);
        self.residual = buffer;
    }

    /// Adds the coarse correction and smooths backwards: x = (D + U)^-1 (b - L x).
    pub(crate) fn up<const W: usize>(&mut self, workers: &mut Workers, b: &[[f32; W]], x: &mut [[f32; W]]) {
        let isa = workers.isa;
        self.p.multiply(workers, &self.strips, self.coarse.x.as_chunks::<W>().0, x, true);
        self.border.hold(x);
        let level = &*self;
        workers.run(&self.strips, x, |t, rows, x| {
            isa.run(SweepUp { level, border: level.border.strips.range(t), rows, b, x });
        });
    }

    /// Entries and bytes of matrix and interpolation.
    pub(crate) fn size(&self) -> (usize, usize) {
        let parts = [&self.inner, &self.border.entries, &self.p, &self.r];
        let entries = parts.iter().map(|m| m.entries()).sum::<usize>() + self.inverse.len();
        let vectors = self.inverse.len() + self.upper.len() + 2 * self.border.rows.len();
        (entries, parts.iter().map(|m| m.bytes()).sum::<usize>() + 4 * vectors)
    }
}

impl Border {
    /// What the sweep over x must take from before: weight x_i - sum_j a_ij x_j. A few rows, not worth the threads.
    fn hold<const W: usize>(&mut self, x: &[[f32; W]]) {
        let held = self.held.as_chunks_mut::<W>().0;
        for (k, held) in held[..self.rows.len()].iter_mut().enumerate() {
            let own = &x[self.rows[k] as usize];
            let mut sum = [0.0; W];
            (0..W).for_each(|c| sum[c] = self.weights[k] * own[c]);
            *held = subtract(sum, self.entries.row(k), x, 0);
        }
    }
}

/// A border in the making.
#[derive(Default)]
struct BorderBuilder {
    rows: Vec<u32>,
    bounds: Vec<usize>,
    entries: Option<Rows<f32>>,
    weights: Vec<f32>,
    sum: f64,
}

impl BorderBuilder {
    fn push(&mut self, column: u32, value: f64) {
        self.entries.get_or_insert_with(|| Rows::with_capacity(0, 0)).push(column, value as f32);
        self.sum += value.abs();
    }

    /// Ends row `i`; its weight.
    fn end_row(&mut self, i: usize) -> f64 {
        let sum = std::mem::take(&mut self.sum);
        if let Some(entries) = self.entries.as_mut().filter(|e| e.starts[e.n()] < e.entries() as u32) {
            entries.end_row();
            self.rows.push(i as u32);
            self.weights.push(sum as f32);
        }
        sum
    }

    fn end_strip(&mut self) {
        self.bounds.push(self.rows.len());
    }

    fn finish(mut self, width: usize) -> Border {
        self.bounds.insert(0, 0);
        let held = vec![0.0; self.rows.len() * width];
        let entries = self.entries.unwrap_or_else(|| Rows::with_capacity(0, 0));
        Border { rows: self.rows, strips: Strips::new(self.bounds), entries, weights: self.weights, held }
    }
}

/// sum - row . x, where `x` starts at row `first`.
#[inline(always)]
fn subtract<const W: usize>(
    mut sum: [f32; W],
    (columns, values): (&[u32], &[f32]),
    x: &[[f32; W]],
    first: usize,
) -> [f32; W] {
    for (&j, &a) in columns.iter().zip(values) {
        let x = &x[j as usize - first];
        for c in 0..W {
            sum[c] -= a * x[c];
        }
    }
    sum
}

/// x = (D + L)^-1 b within a strip; `x` is its part.
struct SweepDown<'a, const W: usize> {
    level: &'a Level,
    rows: Range<usize>,
    b: &'a [[f32; W]],
    x: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for SweepDown<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Level { inner, upper, inverse, .. } = self.level;
        let first = self.rows.start;
        for i in self.rows {
            let lower = inner.starts[i] as usize..upper[i] as usize;
            let mut sum =
                subtract(self.b[i], (&inner.columns[lower.clone()], &inner.values[lower]), self.x, first);
            (0..W).for_each(|c| sum[c] *= inverse[i]);
            self.x[i - first] = sum;
        }
    }
}

/// residual = b - A x after [`SweepDown`]: -U x, and along the border weight x - O x.
struct Remainder<'a, const W: usize> {
    level: &'a Level,
    /// The strip's part of the border.
    border: Range<usize>,
    rows: Range<usize>,
    x: &'a [[f32; W]],
    residual: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for Remainder<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Level { inner, upper, border, .. } = self.level;
        let first = self.rows.start;
        for i in self.rows {
            let upper = upper[i] as usize..inner.starts[i + 1] as usize;
            let row = (&inner.columns[upper.clone()], &inner.values[upper]);
            self.residual[i - first] = subtract([0.0; W], row, self.x, 0);
        }
        for k in self.border {
            let i = border.rows[k] as usize;
            let mut sum = self.residual[i - first];
            (0..W).for_each(|c| sum[c] += border.weights[k] * self.x[i][c]);
            self.residual[i - first] = subtract(sum, border.entries.row(k), self.x, 0);
        }
    }
}

/// x = (D + U)^-1 (b - L x) within a strip, backwards; `x` is its part.
struct SweepUp<'a, const W: usize> {
    level: &'a Level,
    /// The strip's part of the border.
    border: Range<usize>,
    rows: Range<usize>,
    b: &'a [[f32; W]],
    x: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for SweepUp<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Level { inner, inverse, border, .. } = self.level;
        let (first, held) = (self.rows.start, border.held.as_chunks::<W>().0);
        let mut ahead = self.border;
        for i in self.rows.rev() {
            let mut sum = self.b[i];
            if !ahead.is_empty() && border.rows[ahead.end - 1] as usize == i {
                ahead.end -= 1;
                (0..W).for_each(|c| sum[c] += held[ahead.end][c]);
            }
            let mut sum = subtract(sum, inner.row(i), self.x, first);
            (0..W).for_each(|c| sum[c] *= inverse[i]);
            self.x[i - first] = sum;
        }
    }
}
