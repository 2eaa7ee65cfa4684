//! Sparse symmetric matrices: one triangle, stored by rows.

use crate::columns::Columns;
use thiserror::Error;

/// A symmetric n x n matrix of which the **upper triangle is stored by rows**: `u32` row starts and column indices,
/// f64 values, columns ascending, the diagonal entry always present and first in its row.
///
/// Read by columns, the same three arrays are the lower triangle in compressed column form, which is what Cholesky
/// codes ask for. Symmetry therefore holds by construction. Entries of value zero may be stored.
#[derive(Clone, Debug, PartialEq)]
pub struct SymmetricCsr {
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

/// Why three arrays are not a [`SymmetricCsr`].
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MatrixError {
    /// Array lengths do not fit together.
    #[error("{what} has {got} entries, {expected} were expected")]
    Length {
        /// Which array.
        what: &'static str,
        /// What it should hold.
        expected: usize,
        /// What it holds.
        got: usize,
    },
    /// Row `row` does not start with its diagonal entry, is not strictly ascending, or leaves the matrix.
    #[error("row {row} must hold its diagonal first and then ascending column indices below {n}")]
    Row {
        /// 0-based row.
        row: usize,
        /// Order of the matrix.
        n: usize,
    },
    /// A triplet names a row or column outside of the matrix, or lies in the lower triangle.
    #[error("entry ({row}, {column}) is not in the upper triangle of a matrix of order {n}")]
    Entry {
        /// 0-based row.
        row: u32,
        /// 0-based column.
        column: u32,
        /// Order of the matrix.
        n: usize,
    },
    /// More entries than `u32` can count.
    #[error("{entries} entries are more than 2^32 - 1")]
    TooLarge {
        /// How many.
        entries: usize,
    },
}

impl SymmetricCsr {
    /// Checks and takes over the three arrays: `row_starts` (n + 1, ascending from 0), `columns` and `values`
    /// (`row_starts[n]` each).
    ///
    /// # Errors
    /// [`MatrixError`] naming the first offending row. Cost: one pass.
    pub fn new(row_starts: Vec<u32>, columns: Vec<u32>, values: Vec<f64>) -> Result<Self, MatrixError> {
        let n = row_starts.len().checked_sub(1).ok_or(MatrixError::Length {
            what: "row_starts",
            expected: 1,
            got: 0,
        })?;
        let entries = row_starts[n] as usize;
        for (what, got) in [("columns", columns.len()), ("values", values.len())] {
            if got != entries {
                return Err(MatrixError::Length { what, expected: entries, got });
            }
        }
        for row in 0..n {
            let (start, end) = (row_starts[row] as usize, row_starts[row + 1] as usize);
            let in_range = start < end && end <= entries && columns[start] as usize == row;
            let last = if in_range { columns[end - 1] as usize } else { n };
            if last >= n || !columns[start..end].is_sorted_by(|a, b| a < b) {
                return Err(MatrixError::Row { row, n });
            }
        }
        Ok(Self { row_starts, columns, values })
    }

    /// Takes over arrays that were made in the right form.
    pub(crate) fn from_sorted(row_starts: Vec<u32>, columns: Vec<u32>, values: Vec<f64>) -> Self {
        debug_assert!(Self::new(row_starts.clone(), columns.clone(), values.clone()).is_ok());
        Self { row_starts, columns, values }
    }

    /// Row starts, columns and values at once, the values to be changed.
    pub(crate) fn parts_mut(&mut self) -> (&[u32], &[u32], &mut [f64]) {
        (&self.row_starts, &self.columns, &mut self.values)
    }

    /// Sums `(row, column, value)` triplets of the upper triangle (row <= column) into a matrix of order `n`; absent
    /// diagonal entries are stored as zero. Cost: one counting sort by row and a sort within each row.
    ///
    /// # Errors
    /// [`MatrixError::Entry`] for a triplet outside of the upper triangle.
    pub fn from_triplets(n: usize, triplets: &[(u32, u32, f64)]) -> Result<Self, MatrixError> {
        if triplets.len() + n > u32::MAX as usize {
            return Err(MatrixError::TooLarge { entries: triplets.len() + n });
        }
        let mut rows: Vec<Vec<(u32, f64)>> = (0..n as u32).map(|i| vec![(i, 0.0)]).collect();
        for &(row, column, value) in triplets {
            if row > column || column as usize >= n {
                return Err(MatrixError::Entry { row, column, n });
            }
            rows[row as usize].push((column, value));
        }
        let mut row_starts = vec![0];
        let (mut columns, mut values): (Vec<u32>, Vec<f64>) = (Vec::new(), Vec::new());
        for mut row in rows {
            row.sort_by_key(|&(column, _)| column); // stable: duplicates are summed in the order given
            let start = columns.len();
            for (column, value) in row {
                if columns.len() > start && columns.last() == Some(&column) {
                    *values.last_mut().expect("as long as columns") += value;
                } else {
                    columns.push(column);
                    values.push(value);
                }
            }
            row_starts.push(columns.len() as u32);
        }
        Ok(Self { row_starts, columns, values })
    }

    /// Order n of the matrix.
    pub fn n(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Number of stored entries (diagonal and strict upper triangle).
    pub fn stored(&self) -> usize {
        self.columns.len()
    }

    /// Number of entries of the whole matrix, 2 stored - n.
    pub fn nonzeros(&self) -> usize {
        2 * self.stored() - self.n()
    }

    /// Start of each row in `columns` and `values`; length n + 1.
    pub fn row_starts(&self) -> &[u32] {
        &self.row_starts
    }

    /// Column index of each stored entry.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// Value of each stored entry.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The values, to be changed on the same pattern.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// A + diag(d), in place.
    ///
    /// # Panics
    /// If `diagonal` has not one entry per row.
    pub fn add_diagonal(&mut self, diagonal: &[f64]) {
        assert_eq!(diagonal.len(), self.n(), "diagonal: one entry per row");
        for (&start, d) in self.row_starts.iter().zip(diagonal) {
            self.values[start as usize] += d;
        }
    }

    /// Range of row `i` in `columns` and `values`.
    pub fn row_range(&self, i: usize) -> std::ops::Range<usize> {
        self.row_starts[i] as usize..self.row_starts[i + 1] as usize
    }

    /// Column indices and values of the stored part of row `i`; the first entry is the diagonal.
    pub fn row(&self, i: usize) -> (&[u32], &[f64]) {
        let range = self.row_range(i);
        (&self.columns[range.clone()], &self.values[range])
    }

    /// The diagonal entry of row `i`.
    pub fn diagonal(&self, i: usize) -> f64 {
        self.values[self.row_starts[i] as usize]
    }

    /// True where row `i` couples to nothing and its diagonal is zero: an unreferenced vertex, left out of systems.
    /// Needs `coupled` from [`coupled_rows`](Self::coupled_rows), because the lower triangle is not stored.
    pub fn is_absent(&self, i: usize, coupled: &[bool]) -> bool {
        !coupled[i] && self.diagonal(i) == 0.0
    }

    /// For each row, whether any off-diagonal entry is stored in it or in its column.
    pub fn coupled_rows(&self) -> Vec<bool> {
        let mut coupled = vec![false; self.n()];
        for i in 0..self.n() {
            for &j in &self.row(i).0[1..] {
                coupled[i] = true;
                coupled[j as usize] = true;
            }
        }
        coupled
    }

    /// y = A x for all columns in one pass over the stored triangle; `x` and `y` are n x k.
    ///
    /// 4 k flops and 12 bytes per stored off-diagonal entry. Serial: backends that multiply in every iteration keep
    /// their own layout.
    ///
    /// # Panics
    /// If a shape does not fit.
    pub fn multiply(&self, x: Columns<&[f64]>, mut y: Columns<&mut [f64]>) {
        assert_eq!((x.n(), y.n(), x.k()), (self.n(), self.n(), y.k()), "x, y: both must be n x k");
        y.data_mut().fill(0.0);
        let k = x.k();
        let (x, y) = (x.slice(), y.data_mut());
        for i in 0..self.n() {
            let (columns, values) = self.row(i);
            for c in 0..k {
                y[i * k + c] += values[0] * x[i * k + c];
            }
            for (&j, &a) in columns[1..].iter().zip(&values[1..]) {
                let j = j as usize;
                for c in 0..k {
                    y[i * k + c] += a * x[j * k + c];
                    y[j * k + c] += a * x[i * k + c];
                }
            }
        }
    }

    /// The infinity norm, max_i sum_j |a_ij|.
    pub fn infinity_norm(&self) -> f64 {
        self.absolute_row_sums().into_iter().fold(0.0, f64::max)
    }

    /// sum_j |a_ij| for every row i.
    pub fn absolute_row_sums(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.n()];
        for i in 0..self.n() {
            let (columns, values) = self.row(i);
            sums[i] += values[0].abs();
            for (&j, &a) in columns[1..].iter().zip(&values[1..]) {
                sums[i] += a.abs();
                sums[j as usize] += a.abs();
            }
        }
        sums
    }

    /// The pattern of both triangles by rows, each entry with the index of the stored entry it mirrors.
    pub fn full_pattern(&self) -> FullPattern {
        let n = self.n();
        let mut starts = vec![0u32; n + 1];
        for i in 0..n {
            let columns = self.row(i).0;
            starts[i + 1] += columns.len() as u32;
            for &j in &columns[1..] {
                starts[j as usize + 1] += 1;
            }
        }
        for i in 0..n {
            starts[i + 1] += starts[i];
        }
        let mut cursor = starts.clone();
        let mut columns = vec![0; starts[n] as usize];
        let mut source = vec![0; starts[n] as usize];
        let mut put = |row: usize, column: u32, entry: usize| {
            let slot = cursor[row] as usize;
            cursor[row] += 1;
            (columns[slot], source[slot]) = (column, entry as u32);
        };
        // Row i receives its lower entries while the rows above it are visited, so every row comes out ascending.
        for i in 0..n {
            for entry in self.row_range(i) {
                let j = self.columns[entry];
                put(i, j, entry);
                if j as usize != i {
                    put(j as usize, i as u32, entry);
                }
            }
        }
        FullPattern { starts, columns, source }
    }

    /// P A P^T with row k of the result = row `order[k]` of this matrix, and for every stored entry of the result the
    /// index of the stored entry it came from (so that new values can be permuted without repeating the work).
    ///
    /// # Panics
    /// If `order` is not a permutation of 0..n.
    pub fn permuted(&self, order: &[u32]) -> (Self, Vec<u32>) {
        let n = self.n();
        let position = inverse_permutation(order);
        assert_eq!(order.len(), n, "order: one entry per row");
        let ends = |i: usize, j: u32| {
            let (a, b) = (position[i], position[j as usize]);
            (a.min(b), a.max(b))
        };
        let mut row_starts = vec![0u32; n + 1];
        for i in 0..n {
            for &j in self.row(i).0 {
                row_starts[ends(i, j).0 as usize + 1] += 1;
            }
        }
        for i in 0..n {
            row_starts[i + 1] += row_starts[i];
        }
        let mut cursor = row_starts.clone();
        let mut entries = vec![(0u32, 0u32); self.stored()];
        for i in 0..n {
            for entry in self.row_range(i) {
                let (a, b) = ends(i, self.columns[entry]);
                entries[cursor[a as usize] as usize] = (b, entry as u32);
                cursor[a as usize] += 1;
            }
        }
        for i in 0..n {
            entries[row_starts[i] as usize..row_starts[i + 1] as usize].sort_unstable();
        }
        let columns = entries.iter().map(|e| e.0).collect();
        let source: Vec<u32> = entries.iter().map(|e| e.1).collect();
        let values = source.iter().map(|&e| self.values[e as usize]).collect();
        (Self { row_starts, columns, values }, source)
    }
}

/// Both triangles of a [`SymmetricCsr`] by rows, columns ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct FullPattern {
    /// Start of each row; length n + 1.
    pub starts: Vec<u32>,
    /// Column index of each entry.
    pub columns: Vec<u32>,
    /// For each entry the index of the stored entry that holds its value.
    pub source: Vec<u32>,
}

/// `position[order[k]] = k`.
///
/// # Panics
/// If `order` is not a permutation of 0..order.len().
pub fn inverse_permutation(order: &[u32]) -> Vec<u32> {
    let mut position = vec![u32::MAX; order.len()];
    for (k, &row) in order.iter().enumerate() {
        let slot = position.get_mut(row as usize).expect("order: an index is out of range");
        assert_eq!(*slot, u32::MAX, "order: row {row} occurs twice");
        *slot = k as u32;
    }
    position
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> SymmetricCsr {
        SymmetricCsr::from_triplets(3, &[(0, 0, 4.0), (0, 2, -1.0), (1, 1, 3.0), (1, 2, -2.0), (2, 2, 5.0)])
            .expect("a valid matrix")
    }

    #[test]
    fn multiplies_with_both_triangles() {
        let mut y = [0.0; 6];
        example().multiply(Columns::new(&[1.0, 0.0, 0.0, 1.0, 1.0, 1.0], 3, 2), Columns::new(&mut y, 3, 2));
        assert_eq!(y, [3.0, -1.0, -2.0, 1.0, 4.0, 3.0]);
    }

    #[test]
    fn full_pattern_is_symmetric_and_ascending() {
        let full = example().full_pattern();
        assert_eq!(full.starts, [0, 2, 4, 7]);
        assert_eq!(full.columns, [0, 2, 1, 2, 0, 1, 2]);
        assert_eq!(full.source, [0, 1, 2, 3, 1, 3, 4]);
    }

    #[test]
    fn permutes_values_and_pattern() {
        let (p, source) = example().permuted(&[2, 0, 1]);
        assert_eq!(p.row(0), (&[0, 1, 2][..], &[5.0, -1.0, -2.0][..]));
        assert_eq!(p.row(1), (&[1][..], &[4.0][..]));
        assert_eq!(source, [4, 1, 3, 0, 2]);
    }

    #[test]
    fn refuses_bad_arrays() {
        assert!(matches!(SymmetricCsr::new(vec![], vec![], vec![]), Err(MatrixError::Length { .. })));
        assert!(matches!(
            SymmetricCsr::new(vec![0, 1], vec![1], vec![1.0]),
            Err(MatrixError::Row { row: 0, n: 1 })
        ));
        assert!(matches!(
            SymmetricCsr::new(vec![0, 2, 1], vec![0], vec![1.0]),
            Err(MatrixError::Row { row: 0, .. })
        ));
        assert!(SymmetricCsr::from_triplets(2, &[(1, 0, 1.0)]).is_err());
    }
}
