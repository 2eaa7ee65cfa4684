//! What column-by-column Cholesky codes without an ordering of their own need: the whole matrix in a fill-reducing
//! order, and right-hand sides carried there and back one column at a time.

use crate::backend::PrepareOptions;
use crate::columns::Columns;
use crate::ordering::{Graph, minimum_degree};
use crate::sparse::{FullPattern, SymmetricCsr};

/// P A P^T with both triangles, and the way back to A.
pub(super) struct Permuted {
    /// `order[k]` is the row of A eliminated k-th.
    pub order: Vec<u32>,
    /// Name of the ordering.
    pub ordering: &'static str,
    /// Both triangles of P A P^T by columns (= by rows), ascending.
    pub pattern: FullPattern,
    /// Values of `pattern`.
    pub values: Vec<f64>,
    /// Stored entry of A behind each entry of `pattern`.
    source: Vec<u32>,
}

impl Permuted {
    /// Orders `matrix` by minimum degree, or as `options` say.
    pub fn new(matrix: &SymmetricCsr, options: &PrepareOptions<'_>) -> Self {
        let (order, ordering) = match options.order {
            Some(order) => (order.to_vec(), "given"),
            None => {
                let graph = Graph::from_triangle_of_matrix(matrix.row_starts(), matrix.columns());
                let ordering = minimum_degree(&graph);
                (ordering.order, ordering.name)
            }
        };
        let (permuted, origin) = matrix.permuted(&order);
        let pattern = permuted.full_pattern();
        let source = pattern.source.iter().map(|&e| origin[e as usize]).collect();
        let mut copy = Self { order, ordering, pattern, values: Vec::new(), source };
        copy.values.resize(copy.source.len(), 0.0);
        copy.update(matrix.values());
        copy
    }

    /// Takes over new values of A, in the order of its stored entries.
    pub fn update(&mut self, values: &[f64]) {
        for (value, &entry) in self.values.iter_mut().zip(&self.source) {
            *value = values[entry as usize];
        }
    }

    /// Order n.
    pub fn n(&self) -> usize {
        self.order.len()
    }

    /// Column `c` of `rhs`, permuted into `column` (length n).
    pub fn gather(&self, rhs: Columns<&[f64]>, c: usize, column: &mut [f64]) {
        for (value, &row) in column.iter_mut().zip(&self.order) {
            *value = rhs.slice()[row as usize * rhs.k() + c];
        }
    }

    /// `column` (length n, permuted) back into column `c` of `x`.
    pub fn scatter(&self, column: &[f64], c: usize, x: &mut Columns<&mut [f64]>) {
        let k = x.k();
        for (value, &row) in column.iter().zip(&self.order) {
            x.data_mut()[row as usize * k + c] = *value;
        }
    }

    /// Bytes of the permuted matrix and the maps.
    pub fn bytes(&self) -> u64 {
        (self.values.len() * (8 + 4 + 4 + 4) + self.n() * 8) as u64
    }
}
