//! The matrix of a refinement, in the numbers of the threads' slabs.
use super::passes::widen;
use super::symbolic::Symbolic;
use crate::isa::Features;
use crate::lanes::{Shape, Vector};
use crate::sparse::SymmetricCsr;

/// Rows of the matrix in local numbers. A thread has the rows of its pivots, and of the rows of the top the entries in
/// its pivots' columns; the top has its own block.
pub struct Rows {
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Where each value is found in the matrix.
    source: Vec<u32>,
}

impl Rows {
    /// The rows of part `part` (the number of threads: the top) of `matrix`, values zero; `position` holds the place of every
    /// row in the elimination order. Two passes over the matrix.
    pub fn new(symbolic: &Symbolic, part: usize, matrix: &SymmetricCsr, position: &[u32]) -> Self {
        let own = &symbolic.parts[part];
        let first = own.first_position;
        let top = symbolic.top_positions().start as u32;
        let is_top = part == symbolic.threads();
        // By local number, counted from the part's first.
        let local = |k: u32| if !is_top && k >= top { k - top + own.pivots() as u32 } else { k - first };
        let rows = if is_top { own.pivots() } else { own.slab as usize };
        // Entry (a, b) with a < b belongs to the part of a: found from either side of the stored triangle.
        let range = first..first + own.pivots() as u32;
        let visit = |each: &mut dyn FnMut(u32, u32, u32)| {
            for i in 0..matrix.n() {
                for entry in matrix.row_range(i) {
                    let (a, b) = (position[i], position[matrix.columns()[entry] as usize]);
                    let (a, b) = (a.min(b), a.max(b));
                    if range.contains(&a) {
                        each(local(a), local(b), entry as u32);
                        if a != b {
                            each(local(b), local(a), entry as u32);
                        }
                    }
                }
            }
        };
        let mut starts = vec![0_u32; rows + 1];
        visit(&mut |row, _, _| starts[row as usize + 1] += 1);
        for row in 0..rows {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); starts[rows] as usize];
        visit(&mut |row, column, entry| {
            entries[next[row as usize] as usize] = (column + own.first_local, entry);
            next[row as usize] += 1;
        });
        for row in starts.windows(2) {
            entries[row[0] as usize..row[1] as usize].sort_unstable();
        }
        let (columns, source): (Vec<u32>, Vec<u32>) = entries.into_iter().unzip();
        Self { values: vec![0.0; columns.len()], starts, columns, source }
    }

    /// Takes new values, in the order of the prepared matrix's stored entries.
    pub fn update(&mut self, values: &[f64]) {
        for (value, &source) in self.values.iter_mut().zip(&self.source) {
            *value = values[source as usize];
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bytes_read() + size_of_val(&self.source[..]) as u64
    }

    /// Bytes of one product.
    pub fn bytes_read(&self) -> u64 {
        (size_of_val(&self.starts[..]) + size_of_val(&self.columns[..]) + size_of_val(&self.values[..]))
            as u64
    }

    /// Row `i` of the matrix times `x`. Per entry: 12 bytes of matrix, a row of `x`, one multiply-add of K lanes.
    #[inline(always)]
    pub fn product<F: Features, X: Shape, W: Shape<T = f64>>(&self, i: usize, x: &[X::Row]) -> W::Vector<F> {
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        let mut sum = W::Vector::<F>::zero();
        for (&column, &value) in self.columns[range.clone()].iter().zip(&self.values[range]) {
            let row = widen::<X, W>(&x[column as usize]);
            sum = sum.add_scaled(value, W::Vector::<F>::load(&row));
        }
        sum
    }
}
