//! Rectangular sparse matrices by rows.

use crate::backends::cg::operator::Csr;
use crate::isa::Real;

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
    #[inline]
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

    /// y = M x, or y += M x where `add` is set. 2 W flops per entry.
    #[inline]
    pub(crate) fn multiply<const W: usize>(&self, x: &[[T; W]], y: &mut [[T; W]], add: bool) {
        for (i, y) in y.iter_mut().enumerate() {
            let (columns, values) = self.row(i);
            let mut sum = if add { *y } else { [T::default(); W] };
            for (&j, &a) in columns.iter().zip(values) {
                let x = &x[j as usize];
                for c in 0..W {
                    sum[c] += a * x[c];
                }
            }
            *y = sum;
        }
    }
}

impl Rows<f64> {
    /// The matrix as the setup reads it.
    pub(crate) fn csr(&self) -> Csr<'_> {
        Csr { starts: &self.starts, columns: &self.columns, values: &self.values }
    }
}
