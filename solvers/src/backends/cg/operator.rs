//! Sparse matrices by full rows, and their product with rows of W lanes.

use super::order;
use super::workers::{Strips, Workers};
use crate::isa::{Features, Real, multiply_add};
use crate::sparse::SymmetricCsr;

/// What the Krylov core needs of a matrix.
pub(crate) trait Operator: Send + Sync {
    /// The stored arrays, in the numbering of the iteration.
    fn csr(&self) -> Csr<'_>;

    /// Row of the system behind each row of the iteration.
    fn rows(&self) -> &[u32];

    /// (A x)_i, sums in f64; multiplied and added as fast as the features F allow.
    fn product<F: Features, S: Real, const W: usize>(&self, i: usize, x: &[[S; W]]) -> [f64; W];

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
    #[inline(always)]
    pub(crate) fn row(&self, i: usize) -> (&'a [u32], &'a [f64]) {
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        (&self.columns[range.clone()], &self.values[range])
    }

    /// The diagonal, which every system stores.
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        let entry = |i: usize| {
            let (columns, values) = self.row(i);
            values[columns.binary_search(&(i as u32)).expect("every row stores its diagonal")]
        };
        (0..self.n()).map(entry).collect()
    }
}

/// Both triangles in f64, 12 bytes per entry, rows renumbered so that neighbours lie close together.
pub(crate) struct FullCsr {
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Stored entry of the system behind each entry.
    source: Vec<u32>,
    rows: Vec<u32>,
}

impl FullCsr {
    /// Mirrors the stored triangle of `matrix`, rows in breadth-first order.
    pub(crate) fn new(workers: &mut Workers, matrix: &SymmetricCsr) -> Self {
        let pattern = matrix.full_pattern();
        let rows = order::breadth_first(&pattern.starts, &pattern.columns);
        let mut position = vec![0; rows.len()];
        rows.iter().enumerate().for_each(|(new, &old)| position[old as usize] = new as u32);
        let entries = pattern.columns.len();
        let of = |old: u32| pattern.starts[old as usize] as usize..pattern.starts[old as usize + 1] as usize;
        let mut starts = Vec::with_capacity(rows.len() + 1);
        starts.push(0);
        let mut end = 0;
        starts.extend(rows.iter().map(|&old| {
            end += of(old).len() as u32;
            end
        }));
        let (mut columns, mut source) = (vec![0; entries], vec![0; entries]);
        let strips = workers.strips(rows.len());
        let bounds =
            (0..=strips.count()).map(|t| if t == 0 { 0 } else { starts[strips.range(t - 1).end] as usize });
        let of_entries = Strips::new(bounds.collect());
        workers.run(&of_entries, (&mut columns[..], &mut source[..]), |t, _, (columns, source)| {
            let mut row: Vec<(u32, u32)> = Vec::new();
            let mut at = 0;
            for &old in &rows[strips.range(t)] {
                row.clear();
                row.extend(of(old).map(|e| (position[pattern.columns[e] as usize], pattern.source[e])));
                row.sort_unstable();
                for &(column, entry) in &row {
                    (columns[at], source[at]) = (column, entry);
                    at += 1;
                }
            }
        });
        let mut full = Self { values: vec![0.0; entries], starts, columns, source, rows };
        full.update(matrix.values());
        full
    }
}

impl Operator for FullCsr {
    fn csr(&self) -> Csr<'_> {
        Csr { starts: &self.starts, columns: &self.columns, values: &self.values }
    }

    fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// 2 W flops and 12 bytes of matrix per entry; x is gathered.
    #[inline(always)]
    fn product<F: Features, S: Real, const W: usize>(&self, i: usize, x: &[[S; W]]) -> [f64; W] {
        let (columns, values) = self.csr().row(i);
        let mut sum = [0.0; W];
        for (&j, &a) in columns.iter().zip(values) {
            let x = &x[j as usize];
            for c in 0..W {
                sum[c] = multiply_add::<F, f64>(a, x[c].to_f64(), sum[c]);
            }
        }
        sum
    }

    fn update(&mut self, stored: &[f64]) {
        for (value, &entry) in self.values.iter_mut().zip(&self.source) {
            *value = stored[entry as usize];
        }
    }

    fn bytes(&self) -> usize {
        self.starts.len() * 4 + self.rows.len() * 4 + self.columns.len() * 16
    }
}
