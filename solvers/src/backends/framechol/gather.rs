//! Right-hand sides in, solutions out: the permutation and the conversion to the factor's numbers, row by row.
use crate::columns::Columns;
use crate::isa::{Features, Isa, Kernel, ROWS_AHEAD, Real, prefetch_near};
use crate::lanes::{Shape, Vector};
use std::marker::PhantomData;
use std::ops::Range;

/// A group of columns of a wider block.
#[derive(Clone, Copy)]
pub struct Group {
    /// First column.
    pub from: usize,
    /// Number of columns, at most the lanes of the shape.
    pub count: usize,
}

/// Where right-hand sides come from.
pub trait Source: Sync {
    /// Writes `scale` times the rows eliminated at positions `range` to `work`, one row each; lanes without a column become
    /// zero. Returns the largest absolute value of every column before scaling.
    fn load<S: Shape>(
        &self,
        isa: Isa,
        range: Range<usize>,
        group: Group,
        scale: f64,
        work: &mut [S::Row],
    ) -> [f64; 8];

    /// The panels of a part that the forward sweep must visit, ascending; `None`: all.
    fn active(&self, part: usize) -> Option<&[u32]>;
}

/// Runs `$body` with the constant `$c` equal to `$count`, for 1 to 8 columns.
macro_rules! with_count {
    ($count:expr, $c:ident, $body:block) => {
        with_count!(@ $count, $c, $body, 1 2 3 4 5 6 7 8)
    };
    (@ $count:expr, $c:ident, $body:block, $($n:literal)*) => {
        match $count {
            $($n => { const $c: usize = $n; $body })*
            other => unreachable!("a group of {other} columns"),
        }
    };
}

/// A dense right-hand side.
pub struct Dense<'a> {
    /// Row eliminated k-th.
    pub order: &'a [u32],
    /// n x k.
    pub block: Columns<&'a [f64]>,
}

impl Source for Dense<'_> {
    fn load<S: Shape>(
        &self,
        isa: Isa,
        range: Range<usize>,
        group: Group,
        scale: f64,
        work: &mut [S::Row],
    ) -> [f64; 8] {
        isa.run(Gather::<S> { order: &self.order[range.start..], block: self.block, group, scale, work })
    }

    fn active(&self, _: usize) -> Option<&[u32]> {
        None
    }
}

/// work\[i\] := scale times row `order\[i\]` of the block. Streams `work` and 4 bytes of index, gathers 8 bytes per number.
struct Gather<'a, S: Shape> {
    /// Longer than `work` where more rows will be gathered next: they are asked for.
    order: &'a [u32],
    block: Columns<&'a [f64]>,
    group: Group,
    scale: f64,
    work: &'a mut [S::Row],
}

impl<S: Shape> Kernel for Gather<'_, S> {
    type Output = [f64; 8];

    #[inline(always)]
    fn run<F: Features>(self) -> [f64; 8] {
        let (k, data) = (self.block.k(), self.block.slice());
        let mut largest = [0.0_f64; 8];
        with_count!(self.group.count, C, {
            for (i, (w, &row)) in self.work.iter_mut().zip(self.order).enumerate() {
                let later = self.order[(i + ROWS_AHEAD).min(self.order.len() - 1)] as usize;
                let later = data.as_ptr().wrapping_add(later * k + self.group.from);
                prefetch_near(later);
                prefetch_near(later.wrapping_add(C - 1)); // a row may lie in two lines
                let b = data[row as usize * k + self.group.from..].first_chunk::<C>().expect("C columns");
                // All lanes, also those without a column: whole registers.
                let mut row = [0.0; 8];
                row[..C].copy_from_slice(b);
                for c in 0..S::K {
                    w.as_mut()[c] = S::T::from_f64(row[c] * self.scale);
                    largest[c] = if row[c].abs() > largest[c] { row[c].abs() } else { largest[c] };
                }
            }
        });
        largest
    }
}

/// An n x k block that several threads write to, each to rows of its own.
pub struct Output<'a> {
    data: *mut f64,
    len: usize,
    k: usize,
    lifetime: PhantomData<&'a mut [f64]>,
}

// SAFETY: rows are written by `Scatter` alone, whose maker promises that no row is written by two threads.
unsafe impl Sync for Output<'_> {}

impl<'a> Output<'a> {
    /// The block, borrowed for as long as threads write to it.
    pub fn new(block: &'a mut Columns<&mut [f64]>) -> Self {
        let k = block.k();
        Self::rows(block.data_mut(), k)
    }

    /// Rows of k numbers.
    pub fn rows(data: &'a mut [f64], k: usize) -> Self {
        Self { data: data.as_mut_ptr(), len: data.len(), k, lifetime: PhantomData }
    }
}

/// Row `order\[i\]` of the block := scale times work\[i\]. Returns whether all of `work` was finite.
pub struct Scatter<'a, S: Shape> {
    /// Longer than `work` where more rows will be written next: they are asked for.
    order: &'a [u32],
    block: &'a Output<'a>,
    group: Group,
    scale: f64,
    work: &'a [S::Row],
}

impl<'a, S: Shape> Scatter<'a, S> {
    /// At least one entry of `order` per row of `work`.
    ///
    /// # Safety
    /// No other thread writes to the first `work.len()` rows of `order` while this runs.
    pub unsafe fn new(
        order: &'a [u32],
        block: &'a Output<'a>,
        group: Group,
        scale: f64,
        work: &'a [S::Row],
    ) -> Self {
        Self { order, block, group, scale, work }
    }
}

impl<S: Shape> Kernel for Scatter<'_, S> {
    type Output = bool;

    #[inline(always)]
    fn run<F: Features>(self) -> bool {
        let Output { data, len, k, .. } = *self.block;
        let mut check = S::Vector::<F>::zero();
        with_count!(self.group.count, C, {
            for (i, (w, &row)) in self.work.iter().zip(self.order).enumerate() {
                let later = self.order[(i + ROWS_AHEAD).min(self.order.len() - 1)] as usize;
                let later = data.wrapping_add(later * k + self.group.from);
                prefetch_near(later);
                prefetch_near(later.wrapping_add(C - 1));
                // 0 * w is NaN for an infinity or a NaN, and stays in the sum.
                check = check.add_scaled(S::T::default(), S::Vector::<F>::load(w));
                let at = row as usize * k + self.group.from;
                assert!(at + C <= len, "row {row} is outside of the block");
                // SAFETY: in bounds; the row is this thread's alone by the promise of `new`.
                let x = unsafe { &mut *data.add(at).cast::<[f64; C]>() };
                let mut row = [0.0; 8];
                for c in 0..S::K {
                    row[c] = w.as_ref()[c].to_f64() * self.scale;
                }
                x.copy_from_slice(&row[..C]);
            }
        });
        let mut lanes = S::Row::default();
        check.store(&mut lanes);
        lanes.as_ref().iter().all(|v| v.to_f64() == 0.0)
    }
}
