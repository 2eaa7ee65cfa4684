//! Sparse matrices by full rows, and their product with rows of W lanes.

use crate::sparse::SymmetricCsr;

/// What the Krylov core needs of a matrix.
pub(crate) trait Operator: Send {
    /// The stored arrays.
    fn csr(&self) -> Csr<'_>;

    /// y = A x; returns x . y for every lane.
    fn multiply<const W: usize>(&self, x: &[[f64; W]], y: &mut [[f64; W]]) -> [f64; W];

    /// Takes new values in the order of the prepared system's stored (upper) entries.
    fn update(&mut self, stored: &[f64]);

    /// Bytes held.
    fn bytes(&self) -> usize;
}

/// Both triangles of a symmetric matrix by rows, columns ascending.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Csr<'a> {
    /// Start of each row; length n + 1.
    pub(crate) starts: &'a [u32],
    /// Column of each entry.
    pub(crate) columns: &'a [u32],
    /// Value of each entry.
    pub(crate) values: &'a [f64],
}

impl<'a> Csr<'a> {
    /// Order of the matrix.
    pub(crate) fn n(&self) -> usize {
        self.starts.len() - 1
    }

    /// Columns and values of row `i`.
    #[inline]
    pub(crate) fn row(&self, i: usize) -> (&'a [u32], &'a [f64]) {
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        (&self.columns[range.clone()], &self.values[range])
    }

    /// The diagonal entry of row `i`, which every system has.
    pub(crate) fn diagonal(&self, i: usize) -> f64 {
        let (columns, values) = self.row(i);
        let at = columns.binary_search(&(i as u32)).expect("every row stores its diagonal");
        values[at]
    }
}

/// Both triangles in f64: 12 bytes per entry.
pub(crate) struct FullCsr {
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Stored entry of the system behind each entry.
    source: Vec<u32>,
}

impl FullCsr {
    /// Mirrors the stored triangle of `matrix`.
    pub(crate) fn new(matrix: &SymmetricCsr) -> Self {
        let pattern = matrix.full_pattern();
        let mut full = Self {
            values: vec![0.0; pattern.columns.len()],
            starts: pattern.starts,
            columns: pattern.columns,
            source: pattern.source,
        };
        full.update(matrix.values());
        full
    }

    /// Row starts, columns, values and the stored entry behind each value.
    #[cfg(feature = "sprs")]
    pub(crate) fn into_parts(self) -> (Vec<u32>, Vec<u32>, Vec<f64>, Vec<u32>) {
        (self.starts, self.columns, self.values, self.source)
    }
}

impl Operator for FullCsr {
    fn csr(&self) -> Csr<'_> {
        Csr { starts: &self.starts, columns: &self.columns, values: &self.values }
    }

    /// 2 W flops and 12 bytes of matrix per entry; x is gathered, y written once.
    fn multiply<const W: usize>(&self, x: &[[f64; W]], y: &mut [[f64; W]]) -> [f64; W] {
        let a = self.csr();
        let mut dot = [0.0; W];
        for (i, y) in y.iter_mut().enumerate() {
            let (columns, values) = a.row(i);
            let mut sum = [0.0; W];
            for (&j, &a) in columns.iter().zip(values) {
                let x = &x[j as usize];
                for c in 0..W {
                    sum[c] += a * x[c];
                }
            }
            *y = sum;
            for c in 0..W {
                dot[c] += x[i][c] * sum[c];
            }
        }
        dot
    }

    fn update(&mut self, stored: &[f64]) {
        for (value, &entry) in self.values.iter_mut().zip(&self.source) {
            *value = stored[entry as usize];
        }
    }

    fn bytes(&self) -> usize {
        self.starts.len() * 4 + self.columns.len() * 16
    }
}
