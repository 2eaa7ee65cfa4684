//! The passes of a refinement over the rows of a slab, compiled for every instruction set.
use super::refine::Norms;
use super::rows::Rows;
use crate::isa::{Features, Kernel, Real};
use crate::lanes::{Shape, Vector};
use std::ops::Range;

/// work := scale * residual, rounded; most := max(most, |residual|).
pub struct Round<'a, S: Shape, W: Shape> {
    pub residual: &'a [W::Row],
    pub scale: f64,
    pub work: &'a mut [S::Row],
    pub most: &'a mut W::Row,
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Round<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let mut most = *self.most; // in a register
        for (work, residual) in self.work.iter_mut().zip(self.residual) {
            *work = narrow::<S, W>(residual, self.scale);
            keep_largest::<W>(&mut most, residual);
        }
        *self.most = most;
    }
}

/// out := the rows of the matrix from `first` on, times work.
pub struct Product<'a, S: Shape, W: Shape> {
    pub matrix: &'a Rows,
    pub first: usize,
    pub work: &'a [S::Row],
    pub out: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Product<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (i, out) in self.out.iter_mut().enumerate() {
            self.matrix.product::<F, S, W>(self.first + i, self.work).store(out);
        }
    }
}

/// The norms of residual - A d, x + d and d, with d = unit * work and x the sum of the steps before; with `keep` these are
/// stored, and the residual times it becomes `other`.
///
/// Per row of K columns: [`Rows::product`]; 8 K bytes of residual and 4 K of each step read, with `keep` 12 K written.
pub struct Judge<'a, S: Shape, W: Shape> {
    pub matrix: &'a Rows,
    /// Local numbers of the matrix's first rows.
    pub rows: Range<usize>,
    /// What others add to A work, row by row; or nothing.
    pub more: &'a [W::Row],
    pub work: &'a [S::Row],
    pub unit: f64,
    pub pairs: u32,
    pub keep: Option<f64>,
    pub residual: &'a mut [W::Row],
    pub other: &'a mut [S::Row],
    pub solution: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Judge<'_, S, W> {
    type Output = Norms;

    #[inline(always)]
    fn run<F: Features>(self) -> Norms {
        let Self { matrix, rows, more, work, unit, pairs, keep, residual, other, solution } = self;
        let mut most = [W::Row::default(); 3];
        for (i, row) in rows.enumerate() {
            let mut product = matrix.product::<F, S, W>(i, work);
            if let Some(more) = more.get(i) {
                product = product.add(W::Vector::<F>::load(more));
            }
            let (mut left, mut step, mut sum) = (W::Row::default(), W::Row::default(), W::Row::default());
            W::Vector::<F>::load(&residual[row]).sub_scaled(unit, product).store(&mut left);
            let last = scaled::<F, S, W>(&work[row], unit);
            last.store(&mut step);
            before::<F, S, W>(pairs, row, other, unit, solution).add(last).store(&mut sum);
            keep_largest::<W>(&mut most[0], &left);
            keep_largest::<W>(&mut most[1], &sum);
            keep_largest::<W>(&mut most[2], &step);
            if let Some(scale) = keep {
                residual[row] = left;
                other[row] = narrow::<S, W>(&left, scale);
                if pairs > 1 {
                    solution[row] = sum;
                }
            }
        }
        let mut norms = Norms::default();
        for c in 0..W::K {
            norms.residual[c] = most[0].as_ref()[c];
            norms.solution[c] = most[1].as_ref()[c];
            norms.step[c] = most[2].as_ref()[c];
        }
        norms
    }
}

/// sums\[i\] := the solution in local row first + i after the pair of this number.
pub struct Sum<'a, S: Shape, W: Shape> {
    pub first: usize,
    pub work: &'a [S::Row],
    pub unit: f64,
    pub pairs: u32,
    pub other: &'a [S::Row],
    pub solution: &'a [W::Row],
    pub sums: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Sum<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { first, work, unit, pairs, other, solution, sums } = self;
        for (i, sum) in sums.iter_mut().enumerate() {
            let row = first + i;
            let last = scaled::<F, S, W>(&work[row], unit);
            before::<F, S, W>(pairs, row, other, unit, solution).add(last).store(sum);
        }
    }
}

/// The sum of the steps before the pair of this number.
#[inline(always)]
fn before<F: Features, S: Shape<T = f32>, W: Shape<T = f64>>(
    pairs: u32,
    row: usize,
    other: &[S::Row],
    unit: f64,
    solution: &[W::Row],
) -> W::Vector<F> {
    match pairs {
        1 => W::Vector::<F>::zero(),
        2 => scaled::<F, S, W>(&other[row], unit),
        _ => W::Vector::<F>::load(&solution[row]),
    }
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
fn scaled<F: Features, S: Shape<T = f32>, W: Shape<T = f64>>(row: &S::Row, unit: f64) -> W::Vector<F> {
    W::Vector::<F>::zero().add_scaled(unit, W::Vector::<F>::load(&widen::<S, W>(row)))
}

/// The row in f64.
#[inline(always)]
pub fn widen<S: Shape<T = f32>, W: Shape<T = f64>>(row: &S::Row) -> W::Row {
    let mut out = W::Row::default();
    for c in 0..S::K {
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
