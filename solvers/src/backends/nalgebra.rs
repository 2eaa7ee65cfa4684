//! `nalgebra-cholesky`: the column-by-column Cholesky of nalgebra-sparse, given a fill-reducing permutation.
//!
//! The library reduces no fill by itself, which would make it a straw man; it gets our minimum degree ordering. Its
//! in-place solve works on column-major blocks, so right-hand sides are carried into an own buffer first. Serial.

use super::permuted::Permuted;
use crate::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::registry::OpenOptions;
use crate::system::System;
use nalgebra_sparse::factorization::{CscCholesky, CscSymbolicCholesky};
use nalgebra_sparse::na::DMatrixViewMut;
use nalgebra_sparse::pattern::SparsityPattern;

/// Opens the backend; there is nothing to choose.
pub fn open(_: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Nalgebra))
}

struct Nalgebra;

impl Backend for Nalgebra {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        on(Phase::Order);
        let matrix = Permuted::new(system.matrix(), options);
        on(Phase::Symbolic);
        let n = matrix.n();
        let usizes = |indices: &[u32]| indices.iter().map(|&i| i as usize).collect();
        let (starts, rows) = (usizes(&matrix.pattern.starts), usizes(&matrix.pattern.columns));
        let pattern = SparsityPattern::try_from_offsets_and_indices(n, n, starts, rows)
            .expect("a full pattern is ascending and in range");
        let symbolic = CscSymbolicCholesky::factor(pattern);
        on(Phase::Numeric);
        let cholesky = CscCholesky::factor_numerical(symbolic, &matrix.values);
        let Ok(cholesky) = cholesky else { return Err(not_positive_definite()) };
        let mut factor = NalgebraFactor { matrix, cholesky, block: vec![0.0; n * options.max_columns] };
        factor.check_pivots()?;
        Ok(Box::new(factor))
    }
}

/// The library does not say where elimination broke down.
fn not_positive_definite() -> PrepareError {
    PrepareError::NotPositiveDefinite { row: 0 }
}

struct NalgebraFactor {
    matrix: Permuted,
    cholesky: CscCholesky<f64>,
    /// n x max_columns, column-major, permuted.
    block: Vec<f64>,
}

impl NalgebraFactor {
    /// Infinite pivots pass the library's test.
    fn check_pivots(&mut self) -> Result<(), PrepareError> {
        let l = self.cholesky.l();
        let broken = (0..l.ncols()).find(|&j| !l.values()[l.col_offsets()[j]].is_finite());
        match broken {
            Some(k) => Err(PrepareError::NonFinite { row: self.matrix.order[k] as usize }),
            None => Ok(()),
        }
    }
}

impl Factor for NalgebraFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.matrix.n(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let block = &mut self.block[..n * k];
        for (c, column) in block.chunks_exact_mut(n).enumerate() {
            self.matrix.gather(rhs, c, column);
        }
        self.cholesky.solve_mut(DMatrixViewMut::from_slice(block, n, k));
        for (c, column) in block.chunks_exact(n).enumerate() {
            if let Some(at) = column.iter().position(|v| !v.is_finite()) {
                return Err(SolveError::NonFinite { row: self.matrix.order[at] as usize });
            }
            self.matrix.scatter(column, c, &mut x);
        }
        Ok(Solved::default())
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.matrix.update(values);
        self.cholesky.refactor(&self.matrix.values).map_err(|_| not_positive_definite())?;
        self.check_pivots()
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.matrix.order)
    }

    fn footprint(&self) -> Footprint {
        let entries = self.cholesky.l().nnz() as u64;
        // L holds values and 64-bit row indices; the pattern of L^T is kept beside it.
        let factor = entries * 16;
        let pattern = self.matrix.values.len() as u64 * 8 + self.matrix.n() as u64 * 32;
        Footprint {
            host_bytes: Some(
                factor + entries * 8 + pattern + self.matrix.bytes() + self.block.len() as u64 * 8,
            ),
            factor_nonzeros: Some(entries),
            factor_bytes: Some(factor),
            bytes_per_solve: Some(2 * factor),
            ordering: Some(self.matrix.ordering),
            ..Footprint::default()
        }
    }
}
