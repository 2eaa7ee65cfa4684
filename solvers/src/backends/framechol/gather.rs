//! Right-hand sides in, solutions out: the permutation and the conversion to the factor's numbers, row by row.
use crate::columns::Columns;
use crate::isa::{Features, Kernel, Real};
use crate::lanes::{Shape, Vector};

/// A group of columns of a wider block.
#[derive(Clone, Copy)]
pub struct Group {
    /// First column.
    pub from: usize,
    /// Number of columns, at most the lanes of the shape.
    pub count: usize,
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

/// work[k] := row `order[k]` of the block, for all k; lanes without a column become zero.
pub struct Gather<'a, S: Shape> {
    /// Rows to take.
    pub order: &'a [u32],
    /// n x k.
    pub block: Columns<&'a [f64]>,
    /// Columns to take.
    pub group: Group,
    /// One row per entry of `order`.
    pub work: &'a mut [S::Row],
}

impl<S: Shape> Kernel for Gather<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let (k, data) = (self.block.k(), self.block.slice());
        with_count!(self.group.count, C, {
            for (w, &row) in self.work.iter_mut().zip(self.order) {
                let b = data[row as usize * k + self.group.from..].first_chunk::<C>().expect("C columns");
                *w = S::Row::default();
                w.as_mut().iter_mut().zip(b).for_each(|(w, &b)| *w = S::T::from_f64(b));
            }
        });
    }
}

/// Row `order[k]` of the block := work[k], for all k. Returns whether all of `work` was finite.
pub struct Scatter<'a, S: Shape> {
    /// Rows to write.
    pub order: &'a [u32],
    /// n x k.
    pub block: Columns<&'a mut [f64]>,
    /// Columns to write.
    pub group: Group,
    /// One row per entry of `order`.
    pub work: &'a [S::Row],
}

impl<S: Shape> Kernel for Scatter<'_, S> {
    type Output = bool;

    #[inline(always)]
    fn run<F: Features>(mut self) -> bool {
        let k = self.block.k();
        let data = self.block.data_mut();
        let mut check = S::Vector::<F>::zero();
        with_count!(self.group.count, C, {
            for (w, &row) in self.work.iter().zip(self.order) {
                // 0 * w is NaN for an infinity or a NaN, and stays in the sum.
                check = check.add_scaled(S::T::default(), S::Vector::<F>::load(w));
                let x = data[row as usize * k + self.group.from..].first_chunk_mut::<C>().expect("C columns");
                x.iter_mut().zip(w.as_ref()).for_each(|(x, w)| *x = w.to_f64());
            }
        });
        let mut lanes = S::Row::default();
        check.store(&mut lanes);
        lanes.as_ref().iter().all(|v| v.to_f64() == 0.0)
    }
}
