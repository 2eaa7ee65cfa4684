//! Matrix input: an SPD matrix from a file, with a right-hand side of known solution.

use crate::columns::Columns;
use crate::sparse::SymmetricCsr;

/// Columns where nothing else is asked: a frame's three coordinates.
pub const COLUMNS: usize = 3;

/// The solution x_ij = sin(i + 3 j + 1), n x k: bounded, oscillating, no two columns alike.
pub fn default_solution(n: usize, k: usize) -> Vec<f64> {
    (0..n).flat_map(|i| (0..k).map(move |j| (i as f64 + 3.0 * j as f64 + 1.0).sin())).collect()
}

/// b = A x for [`default_solution`], n x k. The rounding of this product makes x its solution to a few condition numbers
/// times eps only; errors are measured against a refined solution, not against x.
pub fn default_right_hand_side(matrix: &SymmetricCsr, k: usize) -> Vec<f64> {
    let n = matrix.n();
    let (x, mut b) = (default_solution(n, k), vec![0.0; n * k]);
    matrix.multiply(Columns::new(&x, n, k), Columns::new(&mut b, n, k));
    b
}
