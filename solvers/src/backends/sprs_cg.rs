//! `sprs-cg`: conjugate gradients with a Jacobi preconditioner on a `sprs` matrix.
//!
//! The Krylov core is that of the `cg-` family; the matrix is stored and multiplied as [`sprs::CsMatI`], one row view at
//! a time. What the row shows is the price of a general sparse-matrix crate in the inner loop.

use super::cg::handle::CgFactor;
use super::cg::jacobi::Jacobi;
use super::cg::krylov::Method;
use super::cg::operator::{Csr, Operator};
use super::cg::workers::Workers;
use crate::backend::{Backend, Description, Factor, Phase, PrepareOptions};
use crate::error::{PrepareError, Unavailable};
use crate::isa::{Features, Real};
use crate::registry::OpenOptions;
use crate::system::System;
use sprs::CsMatI;

/// Opens `sprs-cg`.
pub fn open(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(SprsCg { tolerance: options.tolerance }))
}

struct SprsCg {
    tolerance: f64,
}

impl Backend for SprsCg {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        on(Phase::Symbolic);
        let pattern = system.matrix().full_pattern();
        let n = system.n();
        let values = pattern.source.iter().map(|&entry| system.matrix().values()[entry as usize]).collect();
        let matrix = SprsMatrix {
            matrix: CsMatI::new((n, n), pattern.starts, pattern.columns, values),
            source: pattern.source,
            rows: (0..n as u32).collect(),
        };
        on(Phase::Numeric);
        let workers = Workers::new(1)?;
        let jacobi = Box::new(Jacobi::new(&workers, matrix.csr()));
        Ok(Box::new(CgFactor::new(
            matrix,
            jacobi,
            workers,
            Method::Conjugate,
            self.tolerance,
            options.max_columns,
        )))
    }
}

/// A `sprs` matrix with both triangles, and the system's stored entry behind each of its own.
struct SprsMatrix {
    matrix: CsMatI<f64, u32, u32>,
    source: Vec<u32>,
    /// The identity: rows stay where they are.
    rows: Vec<u32>,
}

impl Operator for SprsMatrix {
    fn csr(&self) -> Csr<'_> {
        Csr {
            starts: self.matrix.indptr().into_raw_storage(),
            columns: self.matrix.indices(),
            values: self.matrix.data(),
        }
    }

    fn rows(&self) -> &[u32] {
        &self.rows
    }

    #[inline(always)]
    fn product<F: Features, S: Real, const W: usize>(&self, i: usize, x: &[[S; W]]) -> [f64; W] {
        let mut sum = [0.0; W];
        if let Some(row) = self.matrix.outer_view(i) {
            for (j, &a) in row.iter() {
                for c in 0..W {
                    sum[c] += a * x[j][c].to_f64();
                }
            }
        }
        sum
    }

    fn update(&mut self, stored: &[f64]) {
        for (value, &entry) in self.matrix.data_mut().iter_mut().zip(&self.source) {
            *value = stored[entry as usize];
        }
    }

    fn bytes(&self) -> usize {
        self.matrix.indptr().len() * 4 + self.rows.len() * 4 + self.matrix.nnz() * 16
    }
}
