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
use crate::backends::cg::workers::{Each, Strips, Workers};
use crate::isa::{Features, Kernel, multiply_add};
use std::ops::Range;

/// P and its transpose.
pub(crate) struct Interpolation {
    /// Rows of this level from those of the next.
    pub(crate) p: Rows<f32>,
    /// P^T.
    pub(crate) r: Rows<f32>,
}

impl Interpolation {
    /// P with its transpose, of `coarse` rows.
    pub(crate) fn new(p: Rows<f32>, coarse: usize) -> Self {
        let r = p.transpose(coarse);
        Self { p, r }
    }
}

/// Matrix, interpolation and workspace of a level.
pub(crate) struct Level {
    strips: Strips,
    /// The matrix, by strips.
    parts: Vec<Part>,
    interpolation: Interpolation,
    /// Residual of this level, W lanes per row.
    residual: Vec<f32>,
    coarse_strips: Strips,
    /// What the next level works on.
    pub(crate) coarse: Coarse,
}

/// The rows of a strip.
#[derive(Default)]
struct Part {
    /// Entries within the strip but the diagonal; rows and columns count from its first row.
    inner: Rows<f32>,
    /// Where the upper triangle of each row begins in `inner`.
    upper: Vec<u32>,
    /// 1 / (a_ii + l1-weight).
    inverse: Vec<f32>,
    /// Rows of the strip with entries outside, ascending.
    border: Vec<u32>,
    /// Those entries, their columns in the numbering of the level.
    outer: Rows<f32>,
    /// The sum of |a_ij| over them.
    weights: Vec<f32>,
    /// What the upward sweep takes from before it, W lanes per row of the border.
    held: Vec<f32>,
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
    /// Packs `a` and its interpolation.
    pub(crate) fn new(workers: &mut Workers, a: Csr<'_>, interpolation: Interpolation, width: usize) -> Self {
        let strips = workers.strips(a.n());
        let mut parts = Vec::new();
        parts.resize_with(strips.count(), Part::default);
        workers.run(&strips, Each(&mut parts), |_, rows, part| *part = Part::new(a, rows, width));
        let coarse = interpolation.r.n();
        Self {
            strips,
            parts,
            residual: vec![0.0; a.n() * width],
            coarse_strips: workers.strips(coarse),
            coarse: Coarse { b: vec![0.0; coarse * width], x: vec![0.0; coarse * width] },
            interpolation,
        }
    }

    /// The interpolation, to be used again.
    pub(crate) fn into_interpolation(self) -> Interpolation {
        self.interpolation
    }

    /// Rows of the next level.
    pub(crate) fn coarse_rows(&self) -> usize {
        self.interpolation.r.n()
    }

    /// Smooths from zero, x = (D + L)^-1 b, and restricts the residual to the next level.
    pub(crate) fn down<const W: usize>(&mut self, workers: &mut Workers, b: &[[f32; W]], x: &mut [[f32; W]]) {
        let isa = workers.isa;
        let parts = &self.parts[..];
        workers.run(&self.strips, &mut *x, |t, rows, x| {
            isa.run(SweepDown { part: &parts[t], b: &b[rows], x });
        });
        let (x, residual) = (&*x, &mut self.residual.as_chunks_mut::<W>().0[..b.len()]);
        workers.run(&self.strips, &mut *residual, |t, rows, residual| {
            isa.run(Remainder { part: &parts[t], first: rows.start, x, residual });
        });
        let r = &self.interpolation.r;
        let coarse = &mut self.coarse.b.as_chunks_mut::<W>().0[..r.n()];
        r.multiply(workers, &self.coarse_strips, residual, coarse, false);
    }

    /// Adds the coarse correction and smooths backwards: x = (D + U)^-1 (b - L x).
    pub(crate) fn up<const W: usize>(&mut self, workers: &mut Workers, b: &[[f32; W]], x: &mut [[f32; W]]) {
        let isa = workers.isa;
        let correction = self.coarse.x.as_chunks::<W>().0;
        self.interpolation.p.multiply(workers, &self.strips, correction, x, true);
        for (t, part) in self.parts.iter_mut().enumerate() {
            isa.run(Hold { part, first: self.strips.range(t).start, x: &*x });
        }
        let parts = &self.parts[..];
        workers.run(&self.strips, x, |t, rows, x| isa.run(SweepUp { part: &parts[t], b: &b[rows], x }));
    }

    /// Entries and bytes of matrix and interpolation.
    pub(crate) fn size(&self) -> (usize, usize) {
        let Interpolation { p, r } = &self.interpolation;
        let own = (p.entries() + r.entries(), p.bytes() + r.bytes());
        self.parts.iter().map(Part::size).fold(own, |sum, part| (sum.0 + part.0, sum.1 + part.1))
    }
}

impl Part {
    /// The rows `own` of `a`.
    fn new(a: Csr<'_>, own: Range<usize>, width: usize) -> Self {
        let (n, first) = (own.len(), own.start);
        let entries = (a.starts[own.end] - a.starts[first]) as usize;
        let mut part = Self {
            inner: Rows::with_capacity(n, entries - n),
            upper: Vec::with_capacity(n),
            inverse: Vec::with_capacity(n),
            outer: Rows::with_capacity(0, 0),
            ..Self::default()
        };
        for i in own.clone() {
            let (columns, values) = a.row(i);
            let (mut diagonal, mut weight) = (0.0, 0.0);
            let before = part.outer.entries();
            for (&j, &v) in columns.iter().zip(values) {
                let column = j as usize;
                if column == i {
                    diagonal = v;
                    part.upper.push(part.inner.entries() as u32);
                } else if own.contains(&column) {
                    part.inner.push((column - first) as u32, v as f32);
                } else {
                    part.outer.push(j, v as f32);
                    weight += v.abs();
                }
            }
            part.inner.end_row();
            part.inverse.push((1.0 / (diagonal + weight)) as f32);
            if part.outer.entries() > before {
                part.outer.end_row();
                part.border.push((i - first) as u32);
                part.weights.push(weight as f32);
            }
        }
        part.held = vec![0.0; part.border.len() * width];
        part
    }

    /// Entries and bytes.
    fn size(&self) -> (usize, usize) {
        let entries = self.inner.entries() + self.outer.entries() + self.inverse.len();
        let vectors = self.inverse.len() + self.upper.len() + 2 * self.border.len();
        (entries, self.inner.bytes() + self.outer.bytes() + 4 * vectors)
    }
}

/// What the upward sweep must take from before it: weight x_i - sum_j a_ij x_j along the border. A few rows, not worth the
/// threads.
struct Hold<'a, const W: usize> {
    part: &'a mut Part,
    /// First row of the strip.
    first: usize,
    /// All strips.
    x: &'a [[f32; W]],
}

impl<const W: usize> Kernel for Hold<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Part { border, outer, weights, held, .. } = self.part;
        let held = held.as_chunks_mut::<W>().0;
        for (k, held) in held[..border.len()].iter_mut().enumerate() {
            let own = self.x[self.first + border[k] as usize].map(|x| weights[k] * x);
            *held = subtract::<F, W>(own, outer.row(k), self.x);
        }
    }
}

/// sum - row . x
#[inline(always)]
fn subtract<F: Features, const W: usize>(
    mut sum: [f32; W],
    (columns, values): (&[u32], &[f32]),
    x: &[[f32; W]],
) -> [f32; W] {
    for (&j, &a) in columns.iter().zip(values) {
        let x = &x[j as usize];
        for c in 0..W {
            sum[c] = multiply_add::<F, f32>(-a, x[c], sum[c]);
        }
    }
    sum
}

/// x = (D + L)^-1 b within a strip.
struct SweepDown<'a, const W: usize> {
    part: &'a Part,
    b: &'a [[f32; W]],
    x: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for SweepDown<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Part { inner, upper, inverse, .. } = self.part;
        for i in 0..self.x.len() {
            let lower = inner.starts[i] as usize..upper[i] as usize;
            let row = (&inner.columns[lower.clone()], &inner.values[lower]);
            let mut sum = subtract::<F, W>(self.b[i], row, self.x);
            (0..W).for_each(|c| sum[c] *= inverse[i]);
            self.x[i] = sum;
        }
    }
}

/// residual = b - A x after [`SweepDown`]: -U x, and along the border weight x - O x.
struct Remainder<'a, const W: usize> {
    part: &'a Part,
    /// First row of the strip.
    first: usize,
    /// All strips.
    x: &'a [[f32; W]],
    residual: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for Remainder<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Part { inner, upper, border, outer, weights, .. } = self.part;
        let own = &self.x[self.first..self.first + self.residual.len()];
        for (i, residual) in self.residual.iter_mut().enumerate() {
            let upper = upper[i] as usize..inner.starts[i + 1] as usize;
            *residual =
                subtract::<F, W>([0.0; W], (&inner.columns[upper.clone()], &inner.values[upper]), own);
        }
        for (k, &i) in border.iter().enumerate() {
            let residual = &mut self.residual[i as usize];
            (0..W).for_each(|c| residual[c] += weights[k] * own[i as usize][c]);
            *residual = subtract::<F, W>(*residual, outer.row(k), self.x);
        }
    }
}

/// x = (D + U)^-1 (b - L x) within a strip, backwards.
struct SweepUp<'a, const W: usize> {
    part: &'a Part,
    b: &'a [[f32; W]],
    x: &'a mut [[f32; W]],
}

impl<const W: usize> Kernel for SweepUp<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Part { inner, inverse, border, held, .. } = self.part;
        let held = held.as_chunks::<W>().0;
        let mut ahead = border.len();
        for i in (0..self.x.len()).rev() {
            let mut sum = self.b[i];
            if ahead > 0 && border[ahead - 1] as usize == i {
                ahead -= 1;
                (0..W).for_each(|c| sum[c] += held[ahead][c]);
            }
            let mut sum = subtract::<F, W>(sum, inner.row(i), self.x);
            (0..W).for_each(|c| sum[c] *= inverse[i]);
            self.x[i] = sum;
        }
    }
}
