//! Rectangular sparse matrices by rows.

use crate::backends::cg::operator::Csr;
use crate::backends::cg::workers::{Each, Strips, Workers};
use crate::isa::{Features, Kernel, Real, multiply_add};
use std::ops::Range;

/// A sparse matrix by rows: entries of row i at `starts[i]..starts[i + 1]`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows<T> {
    /// Start of each row; one more than there are rows.
    pub(crate) starts: Vec<u32>,
    /// Column of each entry.
    pub(crate) columns: Vec<u32>,
    /// Value of each entry.
    pub(crate) values: Vec<T>,
}

impl<T: Real> Rows<T> {
    /// No rows yet, room for `entries`.
    pub(crate) fn with_capacity(rows: usize, entries: usize) -> Self {
        let mut starts = Vec::with_capacity(rows + 1);
        starts.push(0);
        Self { starts, columns: Vec::with_capacity(entries), values: Vec::with_capacity(entries) }
    }

    /// Adds an entry to the row under construction.
    pub(crate) fn push(&mut self, column: u32, value: T) {
        self.columns.push(column);
        self.values.push(value);
    }

    /// Ends the row under construction.
    pub(crate) fn end_row(&mut self) {
        self.starts.push(self.columns.len() as u32);
    }

    /// Number of rows.
    pub(crate) fn n(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of entries.
    pub(crate) fn entries(&self) -> usize {
        self.columns.len()
    }

    /// Columns and values of row `i`.
    #[inline(always)]
    pub(crate) fn row(&self, i: usize) -> (&[u32], &[T]) {
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Bytes of the entries and row starts.
    pub(crate) fn bytes(&self) -> usize {
        self.entries() * (4 + size_of::<T>()) + self.starts.len() * 4
    }

    /// The transpose, which has `columns` rows; entries of a row ascend.
    pub(crate) fn transpose(&self, columns: usize) -> Self {
        let mut starts = vec![0u32; columns + 1];
        self.columns.iter().for_each(|&j| starts[j as usize + 1] += 1);
        for j in 0..columns {
            starts[j + 1] += starts[j];
        }
        let mut cursor = starts.clone();
        let mut t =
            Self { starts, columns: vec![0; self.entries()], values: vec![T::default(); self.entries()] };
        for i in 0..self.n() {
            let (columns, values) = self.row(i);
            for (&j, &value) in columns.iter().zip(values) {
                let at = cursor[j as usize] as usize;
                cursor[j as usize] += 1;
                (t.columns[at], t.values[at]) = (i as u32, value);
            }
        }
        t
    }

    /// y = M x, or y += M x where `add` is set; `strips` are those of y. 2 W flops per entry.
    pub(crate) fn multiply<const W: usize>(
        &self,
        workers: &mut Workers,
        strips: &Strips,
        x: &[[T; W]],
        y: &mut [[T; W]],
        add: bool,
    ) {
        let isa = workers.isa;
        workers.run(strips, y, |_, rows, y| isa.run(Multiply { m: self, rows, x, y, add }));
    }

    /// Strips put together, in order.
    pub(crate) fn concatenate(strips: Vec<Self>) -> Self {
        let (rows, entries) = strips.iter().fold((0, 0), |s, m| (s.0 + m.n(), s.1 + m.entries()));
        let mut strips = strips.into_iter();
        let Some(mut all) = strips.next() else { return Self::with_capacity(0, 0) };
        all.starts.reserve_exact(rows + 1 - all.starts.len());
        all.columns.reserve_exact(entries - all.columns.len());
        all.values.reserve_exact(entries - all.values.len());
        for strip in strips {
            let before = all.columns.len() as u32;
            all.starts.extend(strip.starts[1..].iter().map(|start| before + start));
            all.columns.extend_from_slice(&strip.columns);
            all.values.extend_from_slice(&strip.values);
        }
        all
    }
}

/// One strip of a product.
struct Multiply<'a, T, const W: usize> {
    m: &'a Rows<T>,
    rows: Range<usize>,
    x: &'a [[T; W]],
    y: &'a mut [[T; W]],
    add: bool,
}

impl<T: Real, const W: usize> Kernel for Multiply<'_, T, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (i, y) in self.rows.zip(self.y) {
            let (columns, values) = self.m.row(i);
            let mut sum = if self.add { *y } else { [T::default(); W] };
            for (&j, &a) in columns.iter().zip(values) {
                let x = &self.x[j as usize];
                for c in 0..W {
                    sum[c] = multiply_add::<F, T>(a, x[c], sum[c]);
                }
            }
            *y = sum;
        }
    }
}

impl Workers {
    /// `n` rows of a matrix, every strip made by `strip` on a thread of its own.
    pub(crate) fn rows<T: Real>(
        &mut self,
        n: usize,
        strip: impl Fn(Range<usize>) -> Rows<T> + Sync,
    ) -> Rows<T> {
        let strips = self.strips(n);
        let mut parts = vec![Rows::default(); strips.count()];
        self.run(&strips, Each(&mut parts), |_, rows, part| *part = strip(rows));
        Rows::concatenate(parts)
    }
}

impl Rows<f64> {
    /// The matrix as the setup reads it.
    pub(crate) fn csr(&self) -> Csr<'_> {
        Csr { starts: &self.starts, columns: &self.columns, values: &self.values }
    }
}
