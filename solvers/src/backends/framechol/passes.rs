//! The passes of a refinement over the rows of a slab, compiled for every instruction set.
use super::gather::{Group, Source};
use super::norms::Norms;
use super::rows::Rows;
use crate::isa::{Features, Isa, Kernel, Real};
use crate::lanes::{Shape, Vector};
use std::ops::Range;

/// Rows of f64 that are handled together, in the first-level cache.
pub const CHUNK: usize = 512;

/// out := the rows of the matrix from `first` on, times x.
pub struct Product<'a, X: Shape, W: Shape> {
    pub matrix: &'a Rows,
    pub first: usize,
    pub x: &'a [X::Row],
    pub out: &'a mut [W::Row],
}

impl<X: Shape, W: Shape<T = f64>> Kernel for Product<'_, X, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (i, out) in self.out.iter_mut().enumerate() {
            self.matrix.product::<F, X, W>(self.first + i, self.x).store(out);
        }
    }
}

/// The rows that a thread judges.
pub struct Judged<'a, R, S: Shape, W: Shape> {
    pub isa: Isa,
    pub source: &'a R,
    pub group: Group,
    /// Their positions in the elimination order.
    pub positions: Range<usize>,
    pub matrix: &'a Rows,
    /// Local number of the first one.
    pub first: usize,
    /// What others add to A x, row by row; or nothing.
    pub more: &'a [W::Row],
    /// The last step in units of `step_unit`, by local row.
    pub step: &'a [S::Row],
    pub step_unit: f64,
    pub scale: f64,
    /// Becomes `scale` times the residual, by local row.
    pub next: &'a mut [S::Row],
}

/// next := scale * (b - unit * A x), rounded. Returns the largest absolute values of that residual, of unit * x and of the
/// last step.
///
/// Per row of K columns: [`Rows::product`]; 8 K bytes of right-hand side gathered anew, which a copy in elimination order
/// would cost three times; 4 K bytes of step read and 4 K written.
pub struct Judge<'a, R, X: Shape, S: Shape, W: Shape> {
    pub judged: Judged<'a, R, S, W>,
    /// The solution in units of `unit`, by local row.
    pub x: &'a [X::Row],
    pub unit: f64,
}

impl<R: Source, X: Shape, S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Judge<'_, R, X, S, W> {
    type Output = Norms;

    #[inline(always)]
    fn run<F: Features>(self) -> Norms {
        let Self { judged, x, unit } = self;
        let Judged { isa, source, group, positions, matrix, first, more, step, step_unit, scale, next } =
            judged;
        let mut b = [W::Row::default(); CHUNK];
        let mut most = [W::Row::default(); 3];
        for from in (0..positions.len()).step_by(CHUNK) {
            let b = &mut b[..CHUNK.min(positions.len() - from)];
            let start = positions.start + from;
            source.load::<W>(isa, start..start + b.len(), group, 1.0, b);
            for (i, b) in (from..).zip(&*b) {
                let mut product = matrix.product::<F, X, W>(i, x);
                if let Some(more) = more.get(i) {
                    product = product.add(W::Vector::<F>::load(more));
                }
                let row = first + i;
                let mut sizes = [W::Row::default(); 3];
                W::Vector::<F>::load(b).sub_scaled(unit, product).store(&mut sizes[0]);
                scaled::<F, X, W>(&x[row], unit).store(&mut sizes[1]);
                scaled::<F, S, W>(&step[row], step_unit).store(&mut sizes[2]);
                next[row] = narrow::<S, W>(&sizes[0], scale);
                keep_largest::<W>(&mut most[0], &sizes[0]);
                keep_largest::<W>(&mut most[1], &sizes[1]);
                keep_largest::<W>(&mut most[2], &sizes[2]);
            }
        }
        let mut norms = Norms::default();
        keep::<W>(&mut norms.residual, &most[0]);
        keep::<W>(&mut norms.solution, &most[1]);
        keep::<W>(&mut norms.step, &most[2]);
        norms
    }
}

/// Sums := the solution after the pair of this number, from local row `first` on; norms := its largest absolute values and
/// those of the last step.
pub struct Sum<'a, S: Shape, W: Shape> {
    pub first: usize,
    pub work: &'a [S::Row],
    pub unit: f64,
    pub pairs: u32,
    /// The first step, for the second pair.
    pub other: &'a [S::Row],
    /// The sum of the steps before, for later pairs.
    pub solution: &'a [W::Row],
    pub sums: &'a mut [W::Row],
    pub norms: &'a mut Norms,
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Sum<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { first, work, unit, pairs, other, solution, sums, norms } = self;
        let mut most = [W::Row::default(); 2];
        for (i, sum) in sums.iter_mut().enumerate() {
            let row = first + i;
            let last = scaled::<F, S, W>(&work[row], unit);
            let before = if pairs == 2 {
                scaled::<F, S, W>(&other[row], unit)
            } else {
                W::Vector::<F>::load(&solution[row])
            };
            before.add(last).store(sum);
            let mut step = W::Row::default();
            last.store(&mut step);
            keep_largest::<W>(&mut most[0], sum);
            keep_largest::<W>(&mut most[1], &step);
        }
        keep::<W>(&mut norms.solution, &most[0]);
        keep::<W>(&mut norms.step, &most[1]);
    }
}

/// all := max(all, most) in the lanes of `most`.
#[inline(always)]
fn keep<W: Shape<T = f64>>(all: &mut [f64; 8], most: &W::Row) {
    all.iter_mut().zip(most.as_ref()).for_each(|(all, &most)| *all = all.max(most));
}

/// most := max(most, |row|) in every lane: one instruction each. A NaN is passed over; the store of the solution sees it.
#[inline(always)]
fn keep_largest<W: Shape<T = f64>>(most: &mut W::Row, row: &W::Row) {
    for (most, value) in most.as_mut().iter_mut().zip(row.as_ref()) {
        let size = value.abs();
        *most = if size > *most { size } else { *most };
    }
}

/// unit * row in f64.
#[inline(always)]
fn scaled<F: Features, X: Shape, W: Shape<T = f64>>(row: &X::Row, unit: f64) -> W::Vector<F> {
    W::Vector::<F>::zero().add_scaled(unit, W::Vector::<F>::load(&widen::<X, W>(row)))
}

/// The row in f64.
#[inline(always)]
pub fn widen<X: Shape, W: Shape<T = f64>>(row: &X::Row) -> W::Row {
    let mut out = W::Row::default();
    for c in 0..X::K {
        out.as_mut()[c] = row.as_ref()[c].to_f64();
    }
    out
}

/// scale * row, rounded.
#[inline(always)]
fn narrow<S: Shape<T = f32>, W: Shape<T = f64>>(row: &W::Row, scale: f64) -> S::Row {
    let mut out = S::Row::default();
    for c in 0..S::K {
        out.as_mut()[c] = f32::from_f64(row.as_ref()[c] * scale);
    }
    out
}
